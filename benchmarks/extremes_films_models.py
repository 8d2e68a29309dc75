"""Extreme oils, temperatures, supplies and shapes, alone and all together."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from extremes_films_case import (
    JOINT,
    OIL,
    Case,
    Machine,
    Outcome,
    Steady,
    at_its_temperature,
    at_most,
    energy,
    figure,
    heat_balance,
    named,
    powers,
    same,
    steady_balance,
    tighter,
    untrusted,
    without,
)
from scene_runs import TOLERANCE
from scipy.integrate import quad
from scipy.optimize import brentq

from fenics_ehd.base.errors import (
    FilmTooThinError,
    HeatError,
    SettingsError,
    StepSizeError,
    ViscosityError,
)
from fenics_ehd.film.shape import Lobes, Profile

#: Peak pressure of the bearing of Table 1 at eccentricity 0.6 in oil of constant viscosity, on
#: 128 x 24 cells [Pa], where 64 x 12 have 4e-5 more; it is proportional to the speed.
PEAK, USUAL_SPEED = 11.52258e6, 500.0

#: Barus' coefficient of all rows [1/Pa], and Roelands' index and viscosity.
BARUS, ROELANDS, THICK = 40e-9, 0.6, 0.05

FINE = {"cells_around": 128, "cells_along": 24}

#: Of runs at tolerance 1e-4 in a scene of cycles, and of their energy.
ERROR, ENERGY = 0.02, 4e-3

#: What films with friction may lose at that tolerance.
LOST = 1e-4

HOLE = {"kind": "hole", "on": "bore", "angle": 180.0, "diameter": 6e-3}
#: Half a cycle from the centre.
ONCE = {"time.periodic": False, "time.revolutions": 1.0}

#: Of the journal's bearing [m].
RADIUS, CLEARANCE = 0.025, 25e-6

GROOVE = {"kind": "circumferential-groove", "width": 4e-3}


def model_films(folder: Path) -> Iterator[Case]:
    """All of them; tables are written into a folder."""
    yield from _pressures()
    yield from _temperatures()
    yield from _supplies(folder)
    yield from _shapes()
    yield from _laws_in_a_cycle()
    yield from _together(folder)


def journal(values: dict | None = None, *, cells: tuple[int, int] = (40, 8)) -> Machine:
    """The engine's main bearing over cycles at tolerance 1e-4."""
    usual = {TOLERANCE: 1e-4, f"{JOINT}.cells": list(cells)}
    return Machine("loaded-journal", usual | (values or {}))


def pushed(force: float, end: float, speed: float, values: dict | None = None) -> Machine:
    """The same journal once, up to a time, under a constant force along -y at a speed."""
    load = {"kind": "constant", "point": "journal", "force": [0.0, -force]}
    once = {"time.periodic": False, "time.revolutions": 0.0, "time.end": end}
    here = {"forces.load": load, "drives.journal.speed": speed, "time.largest_step": 0.02}
    return journal(once | here | (values or {}))


def rod(values: dict, revolutions: float) -> Machine:
    """The slider-crank with an elastic rod by M4."""
    usual = {
        TOLERANCE: 1e-4,
        "time.revolutions": revolutions,
        "bodies.rod.reduction.method": "m4",
        "bodies.rod.reduction.estimate_error": False,
        "joints.big_end.friction": True,
    }
    return Machine("slider-crank-paper", usual | values)


# ---- oils --------------------------------------------------------------------------------------


def _barus(reduced: float, **law: float) -> Steady:
    """The bearing at eccentricity 0.6 whose oil of constant viscosity has a peak pressure [Pa]."""
    oil = law or {"barus": BARUS}
    viscosity = oil.get("viscosity", 0.01)
    speed = USUAL_SPEED * reduced / PEAK * 0.01 / viscosity
    return Steady({**FINE, **oil, "speed": speed}, {"eccentricity": 0.6})


def roelands_ratio(pressure: float) -> float:
    """Viscosity over that at ambient pressure."""
    return float(np.exp((np.log(THICK) + 9.67) * ((1 + pressure / 0.196e9) ** ROELANDS - 1)))


def _pressures() -> Iterator[Case]:
    """Of the law q = int_0^p dp / ratio(p) the film is that of constant viscosity, exactly."""
    for pressure in (50e6, 100e6):
        reduced = (1 - np.exp(-BARUS * pressure)) / BARUS
        text = f"peak {pressure / 1e6:g} MPa, p = -ln(1 - a q) / a of constant viscosity, to {{}}"
        claim = figure("max_pressure_Pa", text, pressure, 0.02)
        yield Case(f"Barus 40e-9 at {pressure / 1e6:g} MPa", _barus(reduced), (claim,))
    # 500 MPa need a q 2e-9 short of 1 / a, which no mesh resolves.
    beyond = (1 - np.exp(-BARUS * 500e6)) / BARUS
    claims = (named("viscosity"),)
    yield Case("Barus 40e-9 at 500 MPa", _barus(beyond), claims, ViscosityError)
    yield Case("Barus 40e-9, q above 1 / a", _barus(1.05 / BARUS), claims, ViscosityError)
    ratio = brentq(lambda p: roelands_ratio(p) - 1e3, 1e6, 1e9)
    reduced = quad(lambda p: 1 / roelands_ratio(p), 0, ratio)[0]
    machine = _barus(reduced, roelands=ROELANDS, viscosity=THICK)
    text = f"peak {ratio / 1e6:.4g} MPa, 1e3 times as thick, by quadrature of q, to {{}}"
    claim = figure("max_pressure_Pa", text, ratio, 0.02)
    yield Case("Roelands 0.6, viscosity ratio 1e3", machine, (claim,))
    law = {"cross_rate": 1e-3, "cross_second_viscosity": 0.1, "viscosity": 0.1}
    text = "load of a tenth of the viscosity to {}: sheared 7e8 times the rate"
    thin = {"viscosity": 0.01, "cross_rate": 0.0, "cross_second_viscosity": 0.5}
    claims = (same(text, 1e-6, thin, ("load_N", "max_pressure_Pa")),)
    yield Case("Cross at 1e-3 1/s", Steady(law, {"eccentricity": 0.6}), claims)


def _temperatures() -> Iterator[Case]:
    hot = {"grade": "ISO VG 680", "supply_temperature": -10.0, "speed": 1000.0}

    def thinned(run: Outcome) -> float:
        assert run.steady is not None
        assert run.steady.heat is not None
        oil = run.steady.bearing.film.parameters.lubricant.oil
        cold, warm = (oil.viscosity(t) for t in (-10.0, run.steady.heat.effective_temperature))
        return 1e3 * warm / cold

    claims = (
        steady_balance(0.05),
        at_most("1e3 times as thin as at the supply: 1e3 / ratio below {}", 1.0, thinned, "1e3 /"),
    )
    yield Case("VG 680 supplied at -10 C", Steady(hot, {"eccentricity": 0.6}), claims)
    still = {"grade": "ISO VG 46", "supply_temperature": 60.0}
    no_way = named("bearing", "flow")
    yield Case("heat, centred: nothing leaves", Steady(still, {"eccentricity": 0.0}), (no_way,),
               HeatError)  # fmt: skip
    fast = still | {"speed": 20_000.0}
    yield Case("heat at 20 000 rad/s", Steady(fast, {"eccentricity": 0.1}), (no_way,), HeatError)
    oil = {f"{OIL}.viscosity": 0.0, f"{OIL}.grade": "ISO VG 680"}
    cold = journal(oil | {f"{JOINT}.heat": {"supply_temperature": -10.0}})
    claims = (
        heat_balance("bearing", "oil", 0.1),
        at_its_temperature("bearing", "oil", 2e-3),
        tighter(ERROR),
    )
    yield Case("cycle, VG 680 supplied at -10 C", cold, claims)
    oil[f"{OIL}.grade"] = "ISO VG 46"
    narrow = {f"{JOINT}.clearance": 3e-6, f"{JOINT}.heat": {"supply_temperature": 100.0}}
    yield Case("cycle, temperature run-away: clearance 3 um", journal(oil | narrow),
               (named("bearing"),), HeatError)  # fmt: skip
    led = {"supply_temperature": 76.7, "conducted": 0.99999, "mixing": 1.0}
    text = "extremes of oil at the supply's temperature to {}: the walls take all heat"
    key = {f"{OIL}.temperature": 76.7, f"{JOINT}.heat.mixing": 1e-9}
    claims = (same(text, 2e-3, key),)
    yield Case("cycle, all heat conducted", journal(oil | {f"{JOINT}.heat": led}), claims)
    warm = {f"{JOINT}.heat": {"supply_temperature": 60.0}}
    once = {"time.periodic": False}
    refused = SettingsError
    yield Case("heat without a cycle", journal(oil | warm | once), (named("time.periodic"),),
               refused)  # fmt: skip
    yield Case("heat of one viscosity", journal(warm), (named("grade", "heat"),), refused)
    boiling = {f"{JOINT}.heat": {"supply_temperature": 250.0}}
    yield Case("VG 46 supplied at 250 C", journal(oil | boiling), (named("250", "mm2/s"),), refused)


# ---- supply ------------------------------------------------------------------------------------


def _supply(values: dict) -> dict:
    return {f"{JOINT}.supply": {"inlet": values}, f"{JOINT}.friction": True}


def _supplies(folder: Path) -> Iterator[Case]:
    usual = tighter(ERROR), energy(ENERGY), powers(LOST)
    for bar in (0, 1, 10):
        claims = usual
        if not bar:
            text = "oil leaves only: largest inflow over the mean flow below {}"
            claims += (at_most(text, 1e-3, _largest_inflow, "inflow"),)
        # At 10 bar the orbit does not repeat to 1e-4 within 20 cycles, but to 1.8e-4.
        values = {"time.periodicity": 1e-3 if bar == 10 else 1e-4}
        machine = journal(_supply(HOLE | {"pressure": 1e5 * bar}) | values)
        yield Case(f"hole at {bar} bar", machine, claims)
    blocked = HOLE | {"pressure": 1e6, "resistance": 1e22}
    claims = (
        without("no supply to the periodicity, {}: infinite resistance", 1e-4, f"{JOINT}.supply"),
    )
    yield Case("hole at 10 bar behind 1e22 Pa s/m3", journal(_supply(blocked)), claims)
    # Both lands of the groove, 8 mm, around a centred journal. Behind a resistance the flow spreads
    # over the groove, whose mean pressure is that of a third of its half width more.
    flow = np.pi * RADIUS * CLEARANCE**3 * 1e6 / (3 * 0.01 * 8e-3)
    text = "pi R c^3 p / (3 eta L) of both lands to {}"
    behind = "of resistances in series, the groove 2/3 mm more of land, to {}"
    spread = 1 + (2 / 3) / 8
    fine = {f"{JOINT}.cells": [40, 20], f"{JOINT}.friction": True}
    for name, resistance, share, why in (
        ("", 0.0, 1.0, text),
        (", its own resistance", 1e6 / flow, 1 / (1 + spread), behind),
    ):
        ring = {f"{JOINT}.supply": {"inlet": GROOVE | {"pressure": 1e6, "resistance": resistance}}}
        claims = (figure("mean_inlet.flow_m3_per_s", why, share * flow, 0.02), powers(LOST))
        machine = pushed(1e-3, 1e-3, 0.0, fine | ring)
        yield Case(f"groove all around at 10 bar{name}", machine, claims)
    below = HOLE | {"angle": 270.0, "pressure": 2e7, "resistance": 2e12}
    jack = pushed(300.0, 2.0, 0.0, _supply(below))
    text = "film power over that of the supply, to {}: it comes to rest"
    claims = (at_most(text, 1e-3, _moves, "film power"), tighter(ERROR))
    yield Case("jacked up at rest by 200 bar behind 2e12 Pa s/m3", jack, claims)
    refused = SettingsError
    for name, diameter, word in (
        ("as wide as the bearing", 0.02, "land"),
        ("0.95 of the bearing's width", 0.019, "cells"),
        ("smaller than a film cell", 1e-3, "cells"),
    ):
        hole = _supply(HOLE | {"diameter": diameter, "pressure": 3e5})
        yield Case(f"hole {name}", journal(hole), (named(word, "inlet"),), refused)
    path = folder / "pulse.csv"
    period = 2 * 2 * np.pi / 300.0
    shares = (0, 0.49, 0.5, 0.51, 1)
    rows = (f"{share * period:.12g},{1e6 * (share == 0.5):g}\n" for share in shares)
    path.write_text("time_s,pressure_Pa\n" + "".join(rows))
    pulse = HOLE | {"table": str(path)}
    yield Case("hole, a pulse of 10 bar", journal(_supply(pulse)), usual)
    text = "thinnest film at twice the pressure to {}: full films are linear"
    # A massless journal in a film that cavitates nowhere whirls for ever: no cycle repeats.
    bath = ONCE | {f"{JOINT}.ambient_pressure": 1e9, f"{JOINT}.friction": True}
    claims = (
        same(text, 1e-5, {f"{JOINT}.ambient_pressure": 2e9}, ("min_film_thickness_m",)),
        powers(LOST),
    )
    yield Case("ambient pressure 1 GPa", journal(bath), claims)


def _largest_inflow(run: Outcome) -> float:
    flow = run.columns["inlet.flow_m3_per_s"]
    return float(flow.max() / np.abs(flow).mean())


def _moves(run: Outcome) -> float:
    last = {name: values[-1] for name, values in run.columns.items()}
    return abs(last["film_power_W"] / last["supply_power_W"])


# ---- shape -------------------------------------------------------------------------------------


def _shapes() -> Iterator[Case]:
    oval = f"{JOINT}.bore_shape.ovality", f"{JOINT}.journal_shape.ovality"
    clearance = CLEARANCE
    refused = named("ovality", "clearance")
    for share in (1.01, 3.0):
        machine = journal({oval[0]: share * clearance})
        yield Case(f"ovality {share:g} c", machine, (refused,), SettingsError)
    bore = rod({"joints.big_end.bore_shape.ovality": 20e-6}, 0.1)
    yield Case("ovality 20 um, c = 17 um, elastic", bore, (refused,), SettingsError)
    shape = {"bore_shape": Lobes(20e-6)}
    yield Case("ovality 20 um, c = 17 um, steady", Steady(shape, {"load": 1000.0}), (),
               SettingsError)  # fmt: skip
    usual = tighter(ERROR), energy(ENERGY), powers(LOST)
    friction = {f"{JOINT}.friction": True}
    yield Case("ovality 0.95 c", journal({oval[0]: 0.95 * clearance} | friction, cells=(80, 8)),
               usual)  # fmt: skip
    both = dict.fromkeys(oval, 0.6 * clearance)
    closing = pushed(1e-3, 2 * np.pi / 300, 300.0, both | {f"{JOINT}.cells": [80, 8]})
    touch = float(np.arcsin(1 / 1.2)) / 300.0
    text = "when 2 a sin(alpha) = c, alpha = 56.4 degrees, to {}"

    def moment(run: Outcome) -> float:
        return abs(run.figures["simulated_time_s"] / touch - 1)

    claims = (at_most(text, 0.01, moment, "end time"),)
    yield Case("both oval by 0.6 c, unloaded", closing, claims, FilmTooThinError)
    hair = journal({oval[0]: 1e-15, oval[1]: 1e-15})
    values = dict.fromkeys(oval, 0.0)
    yield Case("ovality 1e-15 m", hair, (same("round to {}", 1e-6, values),))
    waves = {oval[0]: 0.05 * clearance, f"{JOINT}.bore_shape.lobes": 40}
    yield Case("40 lobes on 40 cells", journal(waves), (untrusted("cells"),), trusted=False)
    slope = {"bore_shape": Profile(0.011, 0.0, 0.999 * 17e-6)}
    other = {"bore_shape": Profile(0.011, 0.0, -0.999 * 17e-6)}
    claims = (same("load of the opposite taper to {}: a mirror", 1e-6, other,
                   ("load_N", "max_pressure_Pa")),)  # fmt: skip
    yield Case("taper 0.999 c", Steady(slope, {"eccentricity": 5e-4}), claims)


# ---- laws in a cycle ---------------------------------------------------------------------------


def _laws_in_a_cycle() -> Iterator[Case]:
    law = {
        f"{OIL}.viscosity": 0.1,
        f"{OIL}.cross_rate": 1e-3,
        f"{OIL}.cross_second_viscosity": 0.1,
    }
    plain = {
        f"{OIL}.viscosity": 0.01,
        f"{OIL}.cross_rate": 0.0,
        f"{OIL}.cross_second_viscosity": 0.5,
    }
    text = "a tenth of the viscosity to {}: sheared 3e8 times the rate"
    yield Case("cycle, Cross at 1e-3 1/s", journal(law), (same(text, 1e-5, plain),))
    thin = {
        f"{OIL}.viscosity": 1.0,
        f"{OIL}.cross_rate": 3e5,
        f"{OIL}.cross_second_viscosity": 1e-3,
        f"{JOINT}.friction": True,
    }
    usual = tighter(ERROR), energy(ENERGY), powers(LOST)
    yield Case("cycle, Cross, second viscosity 1e-3", journal(thin), usual)
    heavy = {"forces.load.scale": 20.0, f"{OIL}.barus": BARUS}
    # More than the 1 / a of reduced pressure bears from the centre: there is no first step.
    yield Case("cycle, Barus 40e-9, 20 times the load", journal(heavy, cells=(80, 16)),
               (named("viscosity", "barus", "load"),), StepSizeError)  # fmt: skip
    thick = {
        "forces.load.scale": 4.0,
        f"{OIL}.roelands": ROELANDS,
        f"{OIL}.viscosity": THICK,
        f"{JOINT}.friction": True,
    }
    # Roelands' law bounds the reduced pressure, too, and rigid surfaces do not give way.
    yield Case("cycle, Roelands 0.6, 4 times the load", journal(thick, cells=(80, 16)),
               (named("viscosity", "roelands", "load"),), StepSizeError)  # fmt: skip
    fast = {
        "drives.crank.speed": 1500.0,
        "lubricants.oil.viscosity": 0.1,
        "lubricants.oil.barus": BARUS,
        "joints.big_end.cells": [40, 10],
    }
    yield Case("elastic, 1500 rad/s, Barus 40e-9 above 500 MPa", rod(fast, 0.5),
               (named("viscosity", "barus", "load"),), StepSizeError)  # fmt: skip


# ---- all at once -------------------------------------------------------------------------------


def everything(joint: str, oil: str, clearance: float) -> dict:
    """Oil of pressure, temperature and shear rate, supplies, shapes and friction of a joint."""
    oil, joint = f"lubricants.{oil}", f"joints.{joint}"
    return {
        f"{oil}.viscosity": 0.0,
        f"{oil}.grade": "ISO VG 46",
        f"{oil}.temperature": 80.0,
        f"{oil}.roelands": ROELANDS,
        f"{oil}.cross_rate": 1e6,
        f"{joint}.friction": True,
        f"{joint}.supply": {
            "turning": HOLE | {"on": "journal", "pressure": 3e5, "resistance": 1e11},
            "fixed": HOLE | {"angle": 90.0, "pressure": 1e6},
        },
        f"{joint}.bore_shape": {"ovality": 0.3 * clearance, "barrel": 0.1 * clearance},
        f"{joint}.journal_shape": {"ovality": 0.1 * clearance, "lobes": 3, "barrel": -1e-6},
    }


def _together(folder: Path) -> Iterator[Case]:
    usual = tighter(ERROR), powers(LOST)
    here = everything("bearing", "oil", 25e-6)
    heat = {f"{JOINT}.heat": {"supply_temperature": 60.0}}
    balance = (
        heat_balance("bearing", "oil", 0.1),
        at_its_temperature("bearing", "oil", 2e-3),
    )
    yield Case("all models, cycle", journal(here | heat), (*usual, energy(ENERGY), *balance))
    more = {
        f"{JOINT}.grooves": [[0.0, 10.0, 2e5]],
        f"{JOINT}.ambient_pressure": 1e5,
        f"{JOINT}.shear_rule": "full",
    }
    yield Case("all models, cycle, grooves and ambient pressure", journal(here | heat | more),
               (*usual, *balance))  # fmt: skip
    few = {f"{JOINT}.element": "serendipity", "time.order": 3}
    yield Case("all models, cycle, 8 nodes, order 3", journal(here | heat | few),
               (tighter(ERROR), *balance))  # fmt: skip
    mine = everything("big_end", "oil", 17e-6) | {"joints.big_end.cells": [40, 10]}
    yield Case("all models, elastic rod, 0.3 revolutions", rod(mine, 0.3),
               (tighter(0.015), powers(1e-3), energy(ENERGY)))  # fmt: skip
    cycle = {"time.periodic": True, "joints.big_end.heat": {"supply_temperature": 60.0}}
    yield Case("all models, elastic rod, cycle", rod(mine | cycle, 1.0),
               (powers(1e-3), energy(ENERGY), heat_balance("big_end", "oil", 0.1)))  # fmt: skip
