"""The Reynolds film from one UFL form against the derivatives written by hand.

    python benchmarks/film_forms.py compare      every element, mesh and law, to 1e-12
    python benchmarks/film_forms.py cost         forms, compilations, seconds; a second mesh
    python benchmarks/film_forms.py killed       a compilation that is killed, and what cures it

Differences are largest ones over the largest entry. `film_forms_loop.py` has the ratio in the loop.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import film_forms_compat
import numpy as np
from dolfinx import __version__ as dolfinx_version
from film_forms_film import SECONDS, FormsEquation, compiled

from fenics_ehd.film import Film, FilmParameters, Gap, Lubricant, uniform_grid
from fenics_ehd.film.asperities import Asperities
from fenics_ehd.film.feed import Feed
from fenics_ehd.film.feed_region import FeedGroove, FeedHole
from fenics_ehd.film.grid import FilmGrid, aligned_grid
from fenics_ehd.film.kinematics import GapDerivatives
from fenics_ehd.film.lubricant import Barus, DowsonHigginson, Roelands
from fenics_ehd.film.oil_balance import OilBalance
from fenics_ehd.film.reynolds import DensityRate, ReynoldsEquation
from fenics_ehd.film.rough_surfaces import RoughSurfaces
from fenics_ehd.film.supply import AxialGroove, Sides
from fenics_ehd.film.thinning import Cross

R, C, OMEGA, ETA = 0.0225, 17e-6, 500.0, 0.01
FAMILIES = ("lagrange", "serendipity", "bilinear")
SHIFT = 3e4
LIMIT = 1e-12


def meshes(family: str) -> dict[str, tuple[FilmGrid, dict[str, Any]]]:
    """Uniform; graded both ways; aligned to a groove under pressure, sides at another one."""
    share = np.linspace(0.0, 2 * np.pi, 25)
    graded = FilmGrid(
        R,
        0.4 + share - 0.6 * np.sin(share),
        R * np.array([-1.0, -0.8, -0.4, 0.0, 0.4, 0.7, 0.9, 1.0]),
        family,
    )
    groove = AxialGroove(1.1, 0.3, 4e5, length=0.6 * R)
    aligned = aligned_grid(
        uniform_grid(R, 2 * R, (24, 6), family, start=0.2), np.array([0.95, 1.25])
    )
    given = {"sides": Sides(1e5, 3e5), "regions": (groove,)}
    return {
        "uniform": (uniform_grid(R, 2 * R, (16, 6), family), {}),
        "graded, one side closed": (graded, {"sides": Sides(None, 2e5)}),
        "aligned, groove and sides": (aligned, given),
    }


def rough(share: float = 0.5, *, flow_factors: bool = True) -> RoughSurfaces:
    """Roughness 0.5 um, `share` of its square the journal's."""
    journal, bore = np.sqrt(share) * 5e-7, np.sqrt(1 - share) * 5e-7
    asperities = Asperities(float(np.hypot(journal, bore)), 0.04, 0.01, 1e11)
    return RoughSurfaces(journal, bore, asperities, 0.1, flow_factors)


def place(angle: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Factor of a viscosity that depends on the place."""
    return 1 + 0.3 * np.cos(angle) + 5 * height


HOLE = Feed("hole", FeedHole(2.0, 0.1 * R, 0.9 * R), 3e5, 2e11, on_journal=True)
GROOVE = Feed("groove", FeedGroove(4.0, 0.0, 0.9, R), 2e5)

#: Oils and whatever else changes the law.
CASES: dict[str, dict[str, Any]] = {
    "constant": {},
    "Barus": {"viscosity_law": Barus(2e-8)},
    "Roelands": {"viscosity_law": Roelands(ETA)},
    "Dowson-Higginson": {"density_law": DowsonHigginson()},
    "its rate": {"density_law": DowsonHigginson(), "history": True},
    "Roelands, Dowson-Higginson": {
        "viscosity_law": Roelands(ETA), "density_law": DowsonHigginson(),
    },
    "Cross, m = 0.5": {"shear_law": Cross(1e5, 0.5)},
    "Cross, m = 1": {"shear_law": Cross(1e5)},
    "Cross, m = 2.3, Barus": {"shear_law": Cross(1e5, 2.3, 0.1), "viscosity_law": Barus(2e-8)},
    "viscosity field, Barus": {"viscosity_field": place, "viscosity_law": Barus(2e-8)},
    "hole and groove": {"feeds": (HOLE, GROOVE)},
    "hole, Barus": {"feeds": (HOLE,), "viscosity_law": Barus(2e-8)},
    "rough, no factors": {"surfaces": rough(flow_factors=False)},
    "Patir-Cheng, equal": {"surfaces": rough()},
    "Patir-Cheng, rough journal": {"surfaces": rough(0.9)},
    "Patir-Cheng, rough bore, Cross, Barus, Dowson-Higginson": {
        "surfaces": rough(0.2), "viscosity_law": Barus(2e-8), "density_law": DowsonHigginson(),
        "shear_law": Cross(1e5, 0.7),
    },
}  # fmt: skip

#: Gaps over sigma between rough surfaces, and over the clearance between smooth ones.
RANGES = {
    "all": (-8.0, 12.0),
    "thin": (0.0, 0.7),
    "overlapping": (-4.0, -0.1),
    "below -6": (-8.0, -6.0),
}


def gaps(film: Film, random: np.random.Generator) -> Iterator[tuple[str, Gap]]:
    """Rough in space; sliding of both signs and none at some points."""
    shape, p = film.points.angle.shape, film.parameters
    ranges = RANGES if p.surfaces else {"": (0.02, 2.0)}
    unit = p.surfaces.roughness if p.surfaces else C
    for name, (low, high) in ranges.items():
        thickness = unit * random.uniform(low, high, shape)
        if p.surfaces and name == "all":
            # Where branches end.
            thickness.flat[:5] = unit * np.array([0.0, 0.5, 5.0, -3.0, -4.0])
        sliding = OMEGA * R * random.uniform(-2, 2, shape) * (random.uniform(size=shape) > 0.2)
        yield name, Gap(
            thickness, OMEGA * C * random.uniform(-1, 1, shape),
            OMEGA * R * random.uniform(-1, 1, shape), sliding, turn=0.7,
        )  # fmt: skip


def far(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference over the largest entry."""
    largest = np.abs(expected).max(initial=0.0)
    return float(np.abs(found - expected).max(initial=0.0) / (largest or 1.0))


def parameters(grid: FilmGrid, given: dict, case: dict) -> FilmParameters:
    """Of one case."""
    laws = {k: v for k, v in case.items() if k.endswith(("law", "field"))}
    more = {k: v for k, v in case.items() if k in ("feeds", "surfaces")}
    return FilmParameters(grid, C, Lubricant(ETA, **laws), OMEGA, **given, **more)


def difference(family: str, case: dict, worst: dict[str, float]) -> None:
    """Of one case on all meshes, into `worst`."""
    random = np.random.default_rng(3)
    for grid, given in meshes(family).values():
        p = parameters(grid, given, case)
        film = Film(p)
        own = FormsEquation(p)
        shape = film.points.angle.shape
        history = None
        if case.get("history"):
            history = DensityRate(2e4, -2e4 * random.uniform(0.9, 1.1, shape))
            own = FormsEquation(p, replace(own.laws, history=True))
        for _, gap in gaps(film, random):
            # Shape functions undershoot: so do these values between nodes.
            pressure = random.uniform(-0.3, 1.0, len(film.free)) * min(1.0, 3e8 / p.pressure_scale)
            compare(film.equation, own, gap, pressure, history, worst)


def compare(
    hand: ReynoldsEquation,
    own: FormsEquation,
    gap: Gap,
    pressure: np.ndarray,
    history: DensityRate | None,
    worst: dict[str, float],
) -> None:
    """All derivatives at one point."""

    def note(name: str, found: np.ndarray, expected: np.ndarray) -> None:
        worst[name] = max(worst.get(name, 0.0), far(found, expected))

    first, second = hand.problem(gap, history), own.problem(gap, history)
    note("R", second.residual(pressure), first.residual(pressure))
    note("dR/dp", second.entries(pressure), first.entries(pressure))
    nodal = hand.nodal(pressure)
    if history is not None:
        random = np.random.default_rng(4)
        direction = [
            random.uniform(-1, 1, (*gap.thickness.shape, 1)) * s for s in (C, C * OMEGA, 1.0, 1.0)
        ]
        expected = hand.change(gap, nodal, GapDerivatives(*direction), history)
        own._put_once(gap, history)
        own.arrays["pressure"][:] = nodal
        total = np.zeros(len(nodal))
        own.set(rate_shift=0.0)
        still = own.matrix("thickness")
        own.set(rate_shift=1.0)
        total = (
            still @ direction[0].ravel() + (own.matrix("thickness") - still) @ direction[1].ravel()
        )
        total += own.matrix("mean_velocity") @ direction[2].ravel()
        note("dR/dh", total[own.free], expected[:, 0])
        return
    expected, found = (e.gap_derivatives(gap, nodal, 0.0) for e in (hand, own))
    shifted = [e.gap_derivatives(gap, nodal, SHIFT)[0] for e in (hand, own)]
    note("dR/dh", found[0].toarray(), expected[0].toarray())
    rates = [(s - e[0]).toarray() for s, e in zip(shifted, (expected, found), strict=True)]
    note("dR/dh'", rates[1], rates[0])
    note("dR/dV", found[1].toarray(), expected[1].toarray())
    assert (found[2] is None) == (expected[2] is None)
    if found[2] is not None:
        note("dR/dU", found[2].toarray(), expected[2].toarray())


def difference_of_oil(case: dict, worst: dict[str, float]) -> None:
    """Conserved oil: the full film by forms, void fractions by algebra."""
    random = np.random.default_rng(5)
    for grid, given in meshes("bilinear").values():
        p = parameters(grid, given, case)
        film, own = Film(p), FormsEquation(p)
        oil = OilBalance(film)
        for _, gap in gaps(film, random):
            length = 0.03
            content = random.uniform(0, 1, oil.assembly.size) * oil.volume_scale
            step = oil.step(gap, content, length / OMEGA)
            values = random.uniform(0, 1, len(oil.unknown)) * min(1.0, 3e8 / p.pressure_scale)
            nodal, void = oil.nodal(values), random.uniform(0, 1, oil.assembly.size)
            nothing = np.zeros_like(void)
            own.put(gap)
            own.set(squeeze=0.0, storage=1 / length, rate_shift=0.0)

            def note(name: str, found: np.ndarray, expected: np.ndarray) -> None:
                worst[name] = max(worst.get(name, 0.0), far(found, expected))

            full = own.balance(nodal) - step.former
            note("R", full, oil.full_film(step, nodal))
            matrix = own.kernels["pressure"].entries()
            kept = np.isin(own.rows, oil.unknown) & np.isin(own.columns, oil.unknown)
            if not oil.dry.any():
                note("dR/dp", matrix[kept], oil.assembly.matrix(oil._derivative(step, nodal)))
            expected = oil.gap_derivatives(step, nodal, nothing)
            for name, key, hand in zip(
                ("dR/dh", "dR/dV", "dR/dU"),
                ("thickness", "mean_velocity", "sliding_velocity"),
                expected, strict=True,
            ):  # fmt: skip
                if hand is not None:
                    note(name, own.matrix(key).toarray(), hand.toarray())
            # What voids do to the storage: the same form at rest, without pressure, by node.
            still = replace(
                gap, mean_velocity=0 * gap.mean_velocity, sliding_velocity=0 * gap.mean_velocity
            )
            own.put(still)
            own.set(squeeze=0.0, storage=1 / length)
            stored = own.balance(np.zeros_like(void))
            note("void storage", stored, step.full)
            quiet = oil.step(still, content, length / OMEGA)
            hand = (
                oil.gap_derivatives(quiet, nodal, void)[0]
                - oil.gap_derivatives(quiet, nodal, nothing)[0]
            )
            own.arrays["pressure"][:] = 0.0
            note("its dR/dh", -void[:, None] * own.matrix("thickness").toarray(), hand.toarray())


def tables() -> bool:
    """Print all differences; whether none is too large."""
    began = process_time(), perf_counter()
    names = ("R", "dR/dp", "dR/dh", "dR/dh'", "dR/dV", "dR/dU")
    print(f"dolfinx {dolfinx_version}\n\n| element | law | {' | '.join(names)} |")
    print("|---" * (len(names) + 2) + "|")
    largest = 0.0
    for family in FAMILIES:
        for name, case in CASES.items():
            worst: dict[str, float] = {}
            difference(family, case, worst)
            row = [f"{worst[n]:.0e}" if n in worst else "" for n in names]
            print(f"| {family} | {name} | {' | '.join(row)} |", flush=True)
            largest = max(largest, *worst.values())
    for name, case in CASES.items():
        if "feeds" in case or "history" in case:
            continue
        worst = {}
        difference_of_oil(case, worst)
        row = [f"{worst[n]:.0e}" if n in worst else "" for n in names]
        more = ", ".join(f"{n} {worst[n]:.0e}" for n in worst if n not in names)
        print(f"| bilinear, conserved | {name} ({more}) | {' | '.join(row)} |", flush=True)
        largest = max(largest, *worst.values())
    print(
        f"\nlargest {largest:.1e}; {SECONDS['forms']} forms in {compiled.cache_info().currsize} "
        f"modules: UFL {SECONDS['ufl']:.1f} s, compiled or loaded {SECONDS['compiled']:.1f} s; "
        f"all {process_time() - began[0]:.0f} s of processor, {perf_counter() - began[1]:.0f} s"
    )
    return largest <= LIMIT


NAMES = "constant", "Barus", "Cross, m = 2.3, Barus", "Patir-Cheng, equal"

COSTS = {name: CASES[name] for name in NAMES} | {
    "Barus, Cross, Patir-Cheng": {
        "surfaces": rough(0.8), "viscosity_law": Barus(1.5e-8), "shear_law": Cross(1e6),
    }
}  # fmt: skip


def best(function: Any, repetitions: int = 20, within: int = 5) -> float:
    """Least time of one call [ms]."""
    times = []
    for _ in range(repetitions):
        began = process_time()
        for _ in range(within):
            function()
        times.append((process_time() - began) / within)
    return 1e3 * min(times)


def times(equation: ReynoldsEquation, gap: Gap, x: np.ndarray) -> list[float]:
    """Residual of a gap, its derivative along the pressure, those along the gap [ms]."""
    problem, nodal = equation.problem(gap), equation.nodal(x)
    return [
        best(lambda: equation.problem(gap).residual(x)),
        best(lambda: problem.entries(x)),
        best(lambda: equation.gap_derivatives(gap, nodal, SHIFT)),
    ]


def costs() -> None:
    """Print what forms cost."""
    print(f"dolfinx {dolfinx_version}; ms, least of 20\n")
    print("| law | cells | compiled s | second mesh | R | dR/dp | gap | all | by hand: all |")
    print("|---" * 9 + "|")
    random = np.random.default_rng(1)
    for name, case in COSTS.items():
        for cells in ((20, 5), (40, 10), (80, 20)):
            p = parameters(uniform_grid(R, 2 * R, cells), {}, case)
            hand = ReynoldsEquation(p)
            made = SECONDS["compiled"]
            own = FormsEquation(p)
            first = SECONDS["compiled"] - made
            began = process_time()
            FormsEquation(p)
            middle = process_time()
            ReynoldsEquation(p)
            second = 1e3 * (2 * middle - began - process_time())
            shape = hand.points.angle.shape
            gap = Gap(
                C * (1.2 + np.cos(hand.points.angle)),
                *np.full((2, *shape), 1.0),
                np.full(shape, 2.0),
            )
            x = 0.05 * random.uniform(size=len(hand.free))
            rows = [times(equation, gap, x) for equation in (own, hand)]
            ours = " | ".join(f"{t:.2f}" for t in rows[0])
            print(
                f"| {name} | {cells[0]} x {cells[1]} | {first:.1f} | {second:.0f} | {ours} "
                f"| {sum(rows[0]):.2f} | {sum(rows[1]):.2f} |", flush=True,
            )  # fmt: skip


COMPILE = """
import sys, time
import film_forms_compat as compat
from film_forms_laws import FilmForms, Laws
if sys.argv[1] == "naive":
    compat.orphans = lambda folder: []
began = time.perf_counter()
forms = FilmForms(Laws("lagrange", "barus", surfaces="factors", dragging=True, thinning=True))
print("starts", flush=True)
compat.compile_forms(list(forms.forms.values()))
print(f"compiled in {time.perf_counter() - began:.1f} s")
"""


def killed() -> bool:
    """Kill a compilation, look at a later process without and with the cure."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"XDG_CACHE_HOME": folder}
        kept = Path(folder) / "fenics" / "fenics_ehd"

        def start(way: str) -> subprocess.Popen:
            return subprocess.Popen(
                [sys.executable, "-c", COMPILE, way], env=environment, text=True,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=Path(__file__).parent,
                start_new_session=True,
            )  # fmt: skip

        process = start("cured")
        while not list(kept.glob("*.c")):
            time.sleep(0.05)
        time.sleep(0.5)
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        print(f"killed; left behind: {[p.name[:16] for p in film_forms_compat.orphans(kept)]}")
        for way in ("naive", "cured"):
            began = perf_counter()
            output, error = start(way).communicate()
            last = (error.strip().splitlines() or [""])[-1][:60]
            print(f"{way}: {perf_counter() - began:.1f} s, {output.splitlines()[-1]}; {last}")
        pair = [start("cured") for _ in range(2)]
        print("two at once:", [p.communicate()[0].splitlines()[-1] for p in pair])
        return output.splitlines()[-1].startswith("compiled")


if __name__ == "__main__":
    {"compare": tables, "cost": costs, "killed": killed}[sys.argv[1]]()
