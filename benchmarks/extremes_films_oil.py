"""Extreme films between rough surfaces that touch, and films that keep account of their oil."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from extremes_films_case import (
    EXTREMES,
    JOINT,
    OIL,
    Case,
    Claim,
    Machine,
    Outcome,
    Shop,
    Steady,
    at_its_temperature,
    at_most,
    energy,
    heat_balance,
    named,
    powers,
    same,
    tighter,
)
from extremes_films_models import (
    CLEARANCE,
    ENERGY,
    ERROR,
    HOLE,
    LOST,
    ONCE,
    RADIUS,
    everything,
    journal,
    pushed,
    rod,
)
from scipy.integrate import quad, trapezoid
from scipy.optimize import brentq

from fenics_ehd.base.errors import FilmTooThinError, SettingsError, StepSizeError

CONTACT = f"{JOINT}.contact"

#: Of the journal's bearing [m].
WIDTH = 0.02


def oil_films() -> Iterator[Case]:
    """All of them."""
    yield from _rough()
    yield from _conserved()


def rough(sigma: float, values: dict | None = None) -> dict:
    """Two equal surfaces of a combined roughness [m]."""
    single = sigma / np.sqrt(2)
    return {CONTACT: {"journal_roughness": single, "bore_roughness": single, **(values or {})}}


def asperity_force(eccentricity: float, sigma: float, *, points: int = 721) -> float:
    """Of asperities alone on a journal off the centre [N], by quadrature of Greenwood and Tripp."""

    def pressure(gap: float) -> float:
        height = gap / sigma

        def integrand(s: float) -> float:
            return (s - height) ** 2.5 * np.exp(-0.5 * s**2)

        integral = quad(integrand, height, max(height, 0) + 12)[0] / np.sqrt(2 * np.pi)
        modulus = 210e9 / (2 * (1 - 0.3**2))
        return 16 * np.sqrt(2) * np.pi / 15 * 0.04**2 * np.sqrt(1e-3) * modulus * integral

    angle = np.linspace(-np.pi, np.pi, points)
    values = [pressure(CLEARANCE - eccentricity * np.cos(a)) * np.cos(a) for a in angle]
    return float(trapezoid(values, angle) * RADIUS * WIDTH)


def _rests(limit: float, load: float, sigma: float) -> Claim:
    """Where the journal rests on asperities, its distance from the bore's centre."""

    def measure(_shop: Shop, _machine: Machine | Steady, run: Outcome) -> float:
        def excess(place: float) -> float:
            return asperity_force(place, sigma) - load

        place = brentq(excess, CLEARANCE - 5 * sigma, CLEARANCE + 2 * sigma, xtol=1e-12)
        found = np.hypot(*(run.columns[f"eccentricity_{axis}_m"][-1] for axis in "xy"))
        return abs(found - place) / sigma

    text = "rests where asperities bear the load, by quadrature, to {} of sigma"
    return Claim(text, limit, measure, "place / sigma")


def _rough() -> Iterator[Case]:
    usual = tighter(ERROR), energy(ENERGY), powers(LOST)
    friction = {f"{JOINT}.friction": True}
    fine = {f"{JOINT}.cells": [60, 8]}
    # The thinnest film of the smooth bearing is about 2 um.
    smooth = {f"{CONTACT}.journal_roughness": 0.0, f"{CONTACT}.bore_roughness": 0.0}
    machine = journal(rough(0.02e-6))
    text = "smooth surfaces to {}: 0.01 of the film, nothing touches, factors 1 - 1e-24"
    yield Case("sigma 0.01 h", machine, (same(text, 1e-6, smooth),))
    for name, sigma in (("0.3 h", 0.6e-6), ("h", 2e-6), ("4 h, 0.29 c", 7.2e-6)):
        yield Case(f"sigma {name}", journal(fine | friction | rough(sigma)), usual)
    yield Case("sigma 0.31 c", journal(rough(7.8e-6)), (named("roughness", "clearance"),),
               SettingsError)  # fmt: skip
    sigma = 1e-6
    for load in (1000.0,):
        values = friction | rough(sigma) | {f"{JOINT}.cells": [120, 4]}
        machine = pushed(load, 3.0, 0.0, values)
        yield Case(f"at rest on asperities, {load:g} N", machine, (_rests(0.02, load, sigma),))
    dry = {f"{OIL}.viscosity": 1e-5} | friction | fine
    yield Case("oil as thin as air", journal(dry | rough(1e-6)), usual)
    here = everything("bearing", "oil", CLEARANCE) | rough(0.5e-6)
    heat = {f"{JOINT}.heat": {"supply_temperature": 60.0}}
    balance = heat_balance("bearing", "oil", 0.1), at_its_temperature("bearing", "oil", 2e-3)
    yield Case("all models and contact, cycle", journal(here | heat | fine),
               (tighter(ERROR), powers(LOST), *balance))  # fmt: skip
    mine = everything("big_end", "oil", 17e-6) | {"joints.big_end.cells": [40, 10]}
    mine |= {"joints.big_end.contact": {"journal_roughness": 0.5e-6}}
    yield Case("all models and contact, elastic rod, 0.3 revolutions", rod(mine, 0.3),
               (tighter(0.015), powers(1e-3), energy(ENERGY)))  # fmt: skip


# ---- conserved oil -----------------------------------------------------------------------------


def starved(values: dict | None = None) -> Machine:
    """The main bearing whose journal has a mass, in air, with a groove; tolerance 1e-3."""
    usual = {"time.tolerance": 1e-3, f"{JOINT}.cells": [48, 8]}
    return Machine("loaded-journal-starved", {**usual, **(values or {})})


def falling(filling: float, end: float, values: dict | None = None) -> Machine:
    """Its journal of 2 kg, from the centre under 2 kN along -y, nothing supplied nor turning."""
    load = {"kind": "constant", "point": "journal", "force": [0.0, -2000.0]}
    once = {
        "time.periodic": False,
        "time.revolutions": 0.0,
        "time.end": end,
        "time.largest_step": 0.02,
        "forces.load": load,
        "drives.journal.speed": 0.0,
        f"{JOINT}.grooves": [],
        f"{JOINT}.initial_filling": filling,
    }
    return starved(once | (values or {}))


def _conserved() -> Iterator[Case]:
    conserving = {f"{JOINT}.cavitation": "mass-conserving", f"{JOINT}.element": "bilinear"}
    empty = journal(conserving | {f"{JOINT}.initial_filling": 0.0})
    yield Case("dry start without mass", empty, (named("initial_filling", "mass"),),
               SettingsError)  # fmt: skip
    nine = {f"{JOINT}.cavitation": "mass-conserving"}
    yield Case("conserved oil on 9 nodes", journal(nine), (named("element", "bilinear"),),
               SettingsError)  # fmt: skip
    text = "after the free fall of a clearance, sqrt(2 c m / F), to {}"
    fall = float(np.sqrt(2 * CLEARANCE * 2.0 / 2000.0))

    def moment(run: Outcome) -> float:
        return abs(run.figures["simulated_time_s"] / fall - 1)

    claims = (at_most(text, 0.01, moment, "end time"),)
    yield Case("dry: falls without oil", falling(0.0, 2 * fall), claims, FilmTooThinError)
    dry = starved({f"{JOINT}.initial_filling": 0.0})
    # Under the engine's load, before the groove has filled a film.
    yield Case("dry start, a groove of 2 bar", dry, (named("smallest_film"),), FilmTooThinError)
    flooded = journal(ONCE | conserving | {f"{JOINT}.ambient_pressure": 1e9})
    reynolds = {f"{JOINT}.cavitation": "reynolds"}
    text = "Reynolds' condition to {}: nothing cavitates at 1 GPa around"
    claims = (same(text, 1e-4, reynolds, EXTREMES[1:]),)
    yield Case("conserved oil under 1 GPa", flooded, claims)
    here = everything("bearing", "oil", CLEARANCE) | {f"{JOINT}.friction": True}
    heat = {f"{JOINT}.heat": {"supply_temperature": 60.0}}
    usual = powers(2e-3), tighter(0.05)
    # Films as thin as all models leave, on 48 cells, are distrusted by the run itself.
    full = {f"{JOINT}.initial_filling": 1.0, f"{JOINT}.cells": [96, 8]}
    # Half full everywhere, the gap fills up everywhere at once: an impact of rigid surfaces.
    run_away = (named("viscosity", "roelands", "load"),)
    yield Case("all models, half full", starved(here), run_away, StepSizeError)
    yield Case("all models, conserved oil, cycle", starved(here | full), usual)
    yield Case("conserved oil between rough surfaces", starved(rough(0.5e-6)), (tighter(0.05),))
    yield Case("all models, conserved oil, heat, cycle", starved(here | full | heat),
               (*usual, heat_balance("bearing", "oil", 0.1)))  # fmt: skip
    mine = everything("big_end", "oil", 17e-6) | {
        "joints.big_end.cells": [40, 10],
        "joints.big_end.element": "bilinear",
        "joints.big_end.cavitation": "mass-conserving",
    }
    yield Case("all models, conserved oil, elastic rod, 0.1 revolutions", rod(mine, 0.1),
               (tighter(0.03), powers(1e-3), energy(ENERGY)))  # fmt: skip
    lone = {f"{JOINT}.supply": {"inlet": HOLE | {"pressure": 1e6, "resistance": 1e13}}}
    drip = starved(lone | {f"{JOINT}.grooves": []})

    def content(run: Outcome) -> float:
        flow = run.figures["mean_inlet.flow_m3_per_s"]
        return abs(run.figures["mean_side_flow_m3_per_s"] / flow - 1)

    text = "over the cycle what comes in leaves, to {}"
    claims = (at_most(text, 0.02, content, "flows"),)
    # The scene's 48 bilinear cells are too coarse for the thin film that is left.
    yield Case("conserved oil, a hole that drips", drip, claims, trusted=False)
