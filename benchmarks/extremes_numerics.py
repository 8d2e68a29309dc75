"""Extreme starts, meshes, tolerances and lengths of a run, and a crank that turns back."""

from __future__ import annotations

from collections.abc import Iterator

from extremes_case import ENERGY, ERROR, USUAL, Case, scene
from extremes_claims import (
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

from fenics_ehd.errors import FilmTooThinError
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings


def numerics() -> Iterator[Case]:
    """All of them."""
    yield from _starts()
    yield from _meshes()
    yield from _tolerances()
    yield from _long_and_back()


def _starts() -> Iterator[Case]:
    text = "film of the usual start after a revolution to {}: starts are forgotten"
    usual = ends_as(text, 0.02, scene()), *USUAL
    for axis, share in (("x", 0.98), ("y", -0.98)):
        settings = scene(**{f"start__eccentricity_{axis}": share})
        yield Case(f"start at e_{axis} = {share:g} c", settings, usual)
    for speed in (1.0, 10.0):
        settings = scene(start__velocity_x=speed)
        yield Case(f"start with e_x' = {speed:g} m/s", settings, usual)
    short = scene("rigid", 0.002, start__velocity_x=0.1, time__tolerance=1e-5)
    yield Case("start with e_x' = 0.1 m/s, rigid", short, (squeezed(0.15), tighter(0.03)))


def _meshes() -> Iterator[Case]:
    def on(cells: tuple[int, int], revolutions: float) -> SliderCrankSettings:
        return scene("m3", revolutions, film__cells=cells)

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
        limit = 6 * tolerance ** (2 / 3)
        claim = tighter(limit)
        text = f"{claim.text}: 6 tolerance^(2/3), second order"
        claim = Claim(text, limit, claim.measure, claim.name)
        settings = scene("m3", revolutions, time__tolerance=tolerance)
        yield Case(f"tolerance {tolerance:g}", settings, (claim,))


def _long_and_back() -> Iterator[Case]:
    settings = scene("rigid", 50.0, time__tolerance=1e-3)
    short = scene("rigid", 2.0, time__tolerance=1e-3 / 30)
    lost = energy(0.05)
    text = f"{lost.text}: 50 times the 9e-4 of one revolution"
    claims = (
        periodic(0.05, 50),
        ends_as("film of tolerance / 30 after 2 revolutions to {}", 0.05, short),
        Claim(text, lost.limit, lost.measure, lost.name),
    )
    yield Case("50 revolutions, rigid", settings, claims)
    back = {
        "mechanism__drive": "torque",
        "mechanism__crank_speed": 100.0,
        "mechanism__crank_inertia": 1e-2,
        "mechanism__drive_torque": -60.0,
    }
    claims = textbook_crank(2e-3), reversed_crank(), *USUAL
    yield Case("crank reversed by a brake, rigid", scene("rigid", 0.5, **back), claims)
    yield Case("crank reversed by a brake", scene("m4", 0.5, **back), claims)
    usual, thin = scene(), scene(bearing__smallest_film=0.5)
    text = "time at which the usual run falls below half a clearance to {}"
    claims = falls_below(text, 0.03, usual, 0.5), same_end(0.03)
    yield Case("smallest_film 0.5", thin, claims, FilmTooThinError)
