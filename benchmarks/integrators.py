r"""Integrators of the slider-crank: error against run time.

    OPENBLAS_NUM_THREADS=1 python benchmarks/integrators.py \
        [--body FILE ...] [--quick] [--only NAME ...] [--rounds 3]

One crank revolution of the default scene. Errors are those of peak pressure, over its peak, and of
minimum film thickness, relative, largest from 0.2 ms on, against the package's own run at a
tolerance of 1e-8 and order 3: at the integrator's own steps, and as curves between the steps. Run
time is that of the integration alone, medians of the rounds, all integrators in turn in each: in
processor time, which other programs disturb least, and on the wall.

"blend" is the package's formula with its coupled step solver; plain "bdf", "alpha" and the
Runge-Kutta formulas use that solver too. "nested" and "TS" (PETSc's) solve a film in every
evaluation, with exact derivatives, and take bodies without quasi-static patterns only. So do
SciPy's, with derivatives by differences: chosen with care, or ("own") those it takes by itself.

Without bodies, those of M4 and M3 with the default settings are made first.
"""

from __future__ import annotations

import argparse
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from time import perf_counter, process_time

import attrs
import numpy as np
from integrators_case import START, Case, Errors, Integrator, Reference, Trajectory, Window
from integrators_competitors import COUPLED, NESTED, OBVIOUS, steps
from tqdm import tqdm

from fenics_ehd.reduction import ReducedBody, load_body
from fenics_ehd.scenes.rod import reduce_rod
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

#: What takes longer is measured once [s].
LONG = 15.0

#: Processor time after which an integration is given up, and quickly [s].
LIMIT, QUICK_LIMIT = 120.0, 10.0

TARGETS = (1e-2, 1e-3)

#: Tolerance and order of the reference.
REFERENCE = (1e-8, 3)


@dataclass
class Row:
    """One integrator at one tolerance."""

    name: str
    integrator: Integrator
    tolerance: float
    seconds: list[float] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)
    found: Trajectory | None = None
    errors: Errors | None = None
    failure: str | None = None

    def measure(self, case: Case, window: Window, limit: float) -> None:
        """Once more, unless that is hopeless or long."""
        if self.failure is not None or (self.seconds and self.seconds[-1] > LONG):
            return
        signal.setitimer(signal.ITIMER_PROF, limit)
        began, wall = process_time(), perf_counter()
        try:
            self.found = self.integrator(case, window, self.tolerance)
        except Exception as error:
            # One that fails is a row that says why.
            self.failure = f"{type(error).__name__}: {error}".replace("\n", " ")[:90]
            return
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        self.seconds.append(process_time() - began)
        self.wall.append(perf_counter() - wall)

    def text(self) -> str:
        """Line of the table."""
        head = f"{self.name:15s} {self.tolerance:7.0e}"
        if self.failure is not None or self.found is None or self.errors is None:
            return f"{head}  {self.failure}"
        f, e = self.found, self.errors
        work = f"{f.iterations}/{f.evaluations}" if f.evaluations else str(f.iterations)
        numbers = "".join(
            f" {100 * x:8.3f}" for x in (e.pressure, e.film, e.pressure_curve, e.film_curve)
        )
        return (
            f"{head} {len(f.times):6d} {f.failed:6d} {work:>11s} "
            f"{median(self.seconds):8.2f} {median(self.wall):8.2f}{numbers}"
        )


HEAD = (
    "integrator    tolerance  steps failed  iterations  cpu [s] wall [s]    p [%]    h [%]  "
    "p curve  h curve"
)


def out_of_time(_signal: int, _frame: object) -> None:
    """Stop an integration."""
    raise TimeoutError("not done in the time given")


def run(
    case: Case,
    window: Window,
    reference: Reference,
    competitors: dict[str, tuple[Integrator, tuple[float, ...]]],
    rounds: int,
    limit: float,
) -> list[Row]:
    """Measure all, print their table."""
    rows = [
        Row(name, integrator, tolerance)
        for name, (integrator, tolerances) in competitors.items()
        for tolerance in tolerances
    ]
    for _ in range(rounds):
        for row in tqdm(rows, leave=False):
            row.measure(case, window, limit)
    print(HEAD)
    for row in rows:
        if row.failure is None and row.found is not None:
            row.errors = reference.errors(case.complete(row.found))
        print(row.text(), flush=True)
    return rows


def needed(rows: list[Row], target: float, cost: Callable[[Row], float]) -> tuple[str, float]:
    """Cost of an error at the steps, interpolated in logarithms: as text and as number."""
    points = sorted((row.errors.larger, cost(row)) for row in rows if row.errors is not None)
    for (low, dear), (high, cheap) in pairwise(points):
        if low <= target <= high:
            share = np.log(target / low) / np.log(high / low)
            value = float(np.exp((1 - share) * np.log(dear) + share * np.log(cheap)))
            return f"{value:.4g}", value
    if points and points[-1][0] < target:
        # Even its loosest tolerance is more accurate.
        return f"<{points[-1][1]:.4g}", points[-1][1]
    return "-", np.inf


def print_winner(rows: list[Row], unit: str = "bdf 2") -> None:
    """Costs at equal errors; of the times, their ratio to the package's default."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.name, []).append(row)
    costs: tuple[Callable[[Row], float], ...] = (
        lambda row: median(row.seconds),
        lambda row: len(row.found.times) + row.found.failed,
        lambda row: row.found.iterations,
    )
    for target in TARGETS:
        found = {name: [needed(g, target, cost) for cost in costs] for name, g in groups.items()}
        best = min(times[0][1] for times in found.values())
        print(
            f"\nfor an error of {100 * target:g} %: processor time, over that of {unit}, "
            "attempted steps, iterations"
        )
        for name, (time, *counts) in found.items():
            base = found[unit][0][1] if unit in found else np.inf
            ratio = f"{time[1] / base:.2f}" if max(time[1], base) < np.inf else "-"
            line = f"{name:15s} {time[0]:>8s} s {ratio:>8s}"
            line += "".join(f" {text:>8s}" for text, _ in counts)
            print(line + ("  fastest" if time[1] == best < np.inf else ""))


def chosen(
    competitors: dict[str, tuple[Integrator, tuple[float, ...]]],
    only: list[str] | None,
    quick: bool,
) -> dict[str, tuple[Integrator, tuple[float, ...]]]:
    """Those asked for; quickly, at two tolerances."""
    return {
        name: (integrator, tolerances[:2] if quick else tolerances)
        for name, (integrator, tolerances) in competitors.items()
        if not only or name in only
    }


def compare(
    body: ReducedBody, settings: SliderCrankSettings, arguments: argparse.Namespace
) -> None:
    """Tables of one body."""
    case = Case.of(body, settings)
    whole = case.from_rest(settings)
    print(f"\n{case.name}: {settings.mechanism.revolutions:g} revolutions")
    exact = list(steps(case, whole, *REFERENCE))
    reference = Reference(exact, START)
    coarser = Reference(exact[::2], START).errors(Trajectory().add_all(exact))
    print(
        f"reference: {len(exact)} steps; with every second of them it is off by "
        f"{100 * coarser.larger:.4f} % at those left out"
    )
    competitors = COUPLED | (NESTED | OBVIOUS if case.nestable else {})
    competitors = chosen(competitors, arguments.only, arguments.quick)
    limit = QUICK_LIMIT if arguments.quick else LIMIT
    print_winner(run(case, whole, reference, competitors, arguments.rounds, limit))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--body", action="append", help="reduced body, more than once for more")
    parser.add_argument(
        "--quick", action="store_true", help="a tenth of a revolution, once, two tolerances"
    )
    parser.add_argument("--only", nargs="+", help="names of integrators")
    parser.add_argument("--rounds", type=int, default=3, help="measurements of each")
    arguments = parser.parse_args()
    signal.signal(signal.SIGPROF, out_of_time)
    settings = SliderCrankSettings()
    if arguments.quick:
        mechanism = attrs.evolve(settings.mechanism, revolutions=0.1)
        settings, arguments.rounds = attrs.evolve(settings, mechanism=mechanism), 1
    if arguments.body:
        bodies = map(load_body, arguments.body)
    else:
        methods = (attrs.evolve(settings.reduction, method=name) for name in ("m4", "m3"))
        bodies = (reduce_rod(attrs.evolve(settings, reduction=r)).body for r in methods)
    for body in bodies:
        compare(body, settings, arguments)


if __name__ == "__main__":
    main()
