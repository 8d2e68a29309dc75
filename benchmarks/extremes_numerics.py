"""Extreme starts, meshes, tolerances and lengths of a run, and a crank that turns back."""

from __future__ import annotations

from collections.abc import Iterator

from extremes_case import ENERGY, ERROR, USUAL, Case, scene
from extremes_claims import (
    VELOCITY,
    Claim,
    ends_as,
    energy,
    falls_below,
    periodic,
    reversed_crank,
    same_as,
    same_end,
    squeezed,
    textbook_crank,
    tighter,
)
from scene_runs import CELLS, TOLERANCE

from fenics_ehd.base.errors import FilmTooThinError
from fenics_ehd.scenes.scene import Scene


def numerics() -> Iterator[Case]:
    """All of them."""
    yield from _starts()
    yield from _meshes()
    yield from _tolerances()
    yield from _long_and_back()


def _starts() -> Iterator[Case]:
    text = "film of the usual start after a revolution to {}: starts are forgotten"
    usual = ends_as(text, 0.02, scene()), *USUAL
    for name, place in (("e_x = 0.98 c", [0.98, 0.0]), ("e_y = -0.98 c", [0.0, -0.98])):
        yield Case(f"start at {name}", scene(values={"joints.big_end.eccentricity": place}), usual)
    for speed in (1.0, 10.0):
        machine = scene(values={VELOCITY: [speed, 0.0]})
        yield Case(f"start with e_x' = {speed:g} m/s", machine, usual)
    short = scene("rigid", 0.002, {VELOCITY: [0.1, 0.0], TOLERANCE: 1e-5})
    yield Case("start with e_x' = 0.1 m/s, rigid", short, (squeezed(0.15), tighter(0.03)))


def _meshes() -> Iterator[Case]:
    def on(cells: tuple[int, int], revolutions: float) -> Scene:
        return scene("m3", revolutions, {CELLS: list(cells)})

    for cells, finer, revolutions, limit in (
        ((10, 2), (40, 10), 0.1, 0.06),
        ((40, 10), (80, 20), 0.05, 0.01),
        ((80, 20), (40, 10), 0.05, 0.01),
        ((160, 40), (80, 20), 0.005, 0.005),
    ):
        text = f"film of {finer[0]} x {finer[1]} cells to {{}}: quadratic pressures"
        claims = same_as(text, limit, on(finer, revolutions)), energy(ENERGY)
        if cells[0] < 160:
            claims += (tighter(ERROR),)
        yield Case(f"film of {cells[0]} x {cells[1]} cells", on(cells, revolutions), claims)


def _tolerances() -> Iterator[Case]:
    for tolerance, revolutions in (
        (1e-2, 1.0),
        (1e-3, 1.0),
        (1e-4, 0.5),
        (1e-6, 0.1),
        (1e-8, 0.02),
        (1e-10, 0.005),
    ):
        limit = 7 * tolerance ** (2 / 3)
        claim = tighter(limit)
        text = f"{claim.text}: 7 tolerance^(2/3), second order"
        claim = Claim(text, limit, claim.measure, claim.name)
        machine = scene("m3", revolutions, {TOLERANCE: tolerance})
        yield Case(f"tolerance {tolerance:g}", machine, (claim,))


def _long_and_back() -> Iterator[Case]:
    machine = scene("rigid", 50.0, {TOLERANCE: 1e-3})
    short = scene("rigid", 2.0, {TOLERANCE: 1e-3 / 30})
    lost = energy(0.12)
    text = f"{lost.text}: 50 times the 1.8e-3 of one revolution"
    claims = (
        periodic(0.05, 50),
        ends_as("film of tolerance / 30 after 2 revolutions to {}", 0.05, short),
        Claim(text, lost.limit, lost.measure, lost.name),
    )
    yield Case("50 revolutions, rigid", machine, claims)
    back = {
        "drives.crank": {"kind": "torque", "torque": -60.0},
        "bodies.crank.speed": 100.0,
        "bodies.crank.inertia": 1e-2,
    }
    claims = textbook_crank(2e-3), reversed_crank(), *USUAL
    yield Case("crank reversed by a brake, rigid", scene("rigid", 0.5, back), claims)
    yield Case("crank reversed by a brake", scene("m4", 0.5, back), claims)
    usual, thin = scene(), scene(values={"joints.big_end.smallest_film": 0.5})
    text = "time at which the usual run falls below half a clearance to {}"
    claims = falls_below(text, 0.03, usual, 0.5), same_end(0.03)
    yield Case("smallest_film 0.5", thin, claims, FilmTooThinError)
