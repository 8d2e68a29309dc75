"""Extreme machines: speed, clearance, oil, material, damping, basis and load."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from extremes_case import ENERGY, ERROR, USUAL, Case, scene, too_thin
from extremes_claims import Claim, energy, nested, rigid_balance, same_as, similar, tighter
from extremes_runs import changed

from fenics_ehd.errors import StepSizeError
from fenics_ehd.reduction import ReducedBody, Structure, load_dependent
from fenics_ehd.reduction.pressure_sets import pressure_patterns

#: Of the default machine [rad/s].
SPEED = 500.0


def machines(folder: Path) -> Iterator[Case]:
    """All of them; tables of gas force are written into a folder."""
    yield from _speeds()
    yield from _bearings()
    yield from _stiffnesses()
    yield from _dampings()
    yield from _bases()
    yield from _loads(folder)


def _speeds() -> Iterator[Case]:
    like = similar(1e-4), *USUAL
    yield Case("speed 20 rad/s", scene(mechanism__crank_speed=20.0), like)
    yield Case("speed 100 rad/s", scene(mechanism__crank_speed=100.0), like)
    for speed, oil in ((1500.0, 0.1), (3000.0, 0.5)):
        machine = {"mechanism__crank_speed": speed, "bearing__viscosity": oil}
        yield Case(
            f"speed {speed:g} rad/s, {oil:g} Pa s, rigid",
            scene("rigid", **machine),
            (rigid_balance(0.01), *like),
        )
        why = f"load grows with speed^2, the oil bears as its speed: {(speed / SPEED):g} times less"
        yield too_thin(
            f"speed {speed:g} rad/s, 0.01 Pa s", why, scene(mechanism__crank_speed=speed)
        )
        # At 3000 rad/s a rod of steel is too soft: strains grow with speed^2 / E.
        stiffer = 1 if speed < 2000 else (speed / SPEED) ** 2
        yield Case(
            f"speed {speed:g} rad/s, {oil:g} Pa s, E = {210 * stiffer:g} GPa",
            scene("m4", 0.5, **machine, rod__youngs_modulus=210e9 * stiffer),
            like,
        )


def _bearings() -> Iterator[Case]:
    for clearance in (5e-6, 50e-6):
        name = f"clearance {clearance * 1e6:g} um"
        here = {"bearing__clearance": clearance}
        yield Case(f"{name}, rigid", scene("rigid", **here), (rigid_balance(0.01), *USUAL))
        yield Case(name, scene("m3", 0.5, **here), (nested(ERROR), *USUAL))
    why = "with the square of c / 17 um the oil bears 35 times less"
    yield too_thin("clearance 100 um", why, scene(bearing__clearance=100e-6))
    yield Case(
        "clearance 100 um, 0.1 Pa s, rigid",
        scene("rigid", bearing__clearance=100e-6, bearing__viscosity=0.1),
        (rigid_balance(0.01), *USUAL),
    )
    for viscosity in (0.001, 0.1, 0.5):
        here = {"bearing__viscosity": viscosity}
        yield Case(
            f"viscosity {viscosity:g} Pa s", scene("m3", 0.5, **here), (nested(ERROR), *USUAL)
        )


def _stiffnesses() -> Iterator[Case]:
    for gpa in (1.0, 21.0):
        speed = round(SPEED * np.sqrt(gpa / 210), 1)
        settings = scene("m4", 0.5, rod__youngs_modulus=gpa * 1e9, mechanism__crank_speed=speed)
        yield Case(f"E = {gpa:g} GPa, {speed:g} rad/s", settings, (similar(1e-4), *USUAL))
    why = "the bore yields by ten clearances to what it has to bear"
    yield too_thin("E = 1 GPa, 500 rad/s", why, scene(rod__youngs_modulus=1e9))
    yield Case("rigid", scene("rigid"), (rigid_balance(0.01), *USUAL))
    text = "rigid rod to {}: 1000 times as stiff, it yields by a micrometre / 1000"
    yield Case(
        "E = 210 TPa",
        scene(rod__youngs_modulus=210e12),
        (same_as(text, 0.01, scene("rigid")), *USUAL),
    )


def _dampings() -> Iterator[Case]:
    text = "full interface to {}: no inertia of small patterns"
    for zeta, limit in ((0.0, 0.05), (1e-6, 0.05)):
        here = {"rod__damping_time": zeta, "time__tolerance": 1e-5}
        yield Case(
            f"zeta {zeta:g}, M3",
            scene("m3", 0.02, **here),
            (nested(0.03), tighter(0.03), energy(ENERGY)),
        )
        full = scene("full", 0.02, **here)
        claims = same_as(text, limit, full), tighter(0.03), energy(ENERGY)
        yield Case(f"zeta {zeta:g}, M4", scene("m4", 0.02, **here), claims)
    whole = scene("m4", 0.02, rod__damping_time=0.0, time__tolerance=1e-5)
    for truncation, limit in ((1e-2, 0.02), (0.1, 0.15)):
        few = "all patterns to {}: those left out move the bore less than " + f"{truncation:g}"
        settings = changed(whole, reduction__residual_truncation=truncation)
        claims = same_as(few, limit, whole), tighter(0.03), energy(ENERGY)
        yield Case(f"zeta 0, M4 truncated at {truncation:g}", settings, claims)
    few = "six patterns resist a step of 1e-8 s 1e5 times as much as oil: no partition is found; {}"
    none = Claim(few, 0.0, lambda _s, _t, run: run.totals.time, "reached")
    settings = changed(whole, reduction__residual_truncation=0.3)
    yield Case("zeta 0, M4 truncated at 0.3", settings, (none,), StepSizeError)
    full = scene("full", 0.2)
    claims = same_as(text, 0.01, full), tighter(ERROR), energy(ENERGY)
    yield Case("zeta 1e-3, M4", scene("m4", 0.2), claims)
    text = "rigid rod to {}: relaxes in a second, a revolution takes 1.3 % of it"
    claims = same_as(text, 0.03, scene("rigid", 0.5)), tighter(ERROR), energy(ENERGY)
    yield Case("zeta 1, M4", scene("m4", 0.5, rod__damping_time=1.0), claims)


def _bases() -> Iterator[Case]:
    full = scene("full", 0.1)
    for count, limit in ((0, None), (8, None), (100, 0.05), (340, 0.03)):
        settings = scene(
            "m3",
            0.1,
            reduction__residual_modes=count,
            reduction__pressure_set="pc1",
            reduction__selection="largest-eigenvalue",
        )
        claims = [tighter(ERROR), energy(ENERGY)]
        if limit is None:
            claims.append(nested(ERROR))
        else:
            text = "full interface to {}: truncation (docs/measurements.md)"
            claims.append(same_as(text, limit, full))
        yield Case(f"n_r = {count}, P_c1", settings, tuple(claims))
    settings = scene("m3", 0.1)
    text = "the same columns once to {}: a copy adds no direction"
    claims = same_as(text, 1e-6, settings, once), tighter(ERROR, twice), energy(ENERGY)
    yield Case("every pressure column twice", settings, claims, reducer=twice)


def _repeated(structure: Structure, times: int) -> ReducedBody:
    """M3 with every other one of a ring of pressures as they are, each so many times."""
    columns = np.hstack([pressure_patterns(structure, "pc2")[:, ::2]] * times)
    return load_dependent(
        structure, 6, columns.shape[1], columns, "every-column", estimate_error=False
    )


def once(structure: Structure) -> ReducedBody:
    """Every pressure column once."""
    return _repeated(structure, 1)


def twice(structure: Structure) -> ReducedBody:
    """Every pressure column twice: half of them depend on the others."""
    return _repeated(structure, 2)


def _loads(folder: Path) -> Iterator[Case]:
    textbook = rigid_balance(0.01)
    yield Case("piston 0 kg, rigid", scene("rigid", mechanism__piston_mass=0.0), (textbook, *USUAL))
    yield Case("piston 0 kg", scene("m3", mechanism__piston_mass=0.0), (nested(ERROR), *USUAL))
    heavy = {"mechanism__piston_mass": 10.0}
    slow = heavy | {"mechanism__crank_speed": 100.0}
    yield too_thin(
        "piston 10 kg, 500 rad/s", "the load is eight times the usual one", scene(**heavy)
    )
    yield Case("piston 10 kg, 100 rad/s, rigid", scene("rigid", **slow), (textbook, *USUAL))
    yield Case("piston 10 kg, 100 rad/s", scene("m4", 0.5, **slow), (similar(1e-4), *USUAL))
    for peak in (20, 80):
        gas = {"mechanism__gas_force": str(_gas_table(folder, 1e3 * peak))}
        yield Case(f"gas {peak} kN, rigid", scene("rigid", **gas), (textbook, *USUAL))
        yield Case(f"gas {peak} kN", scene("m3", 0.5, **gas), (nested(ERROR), *USUAL))


def _gas_table(folder: Path, peak: float) -> Path:
    """A bell of gas force, 10 degrees after top dead centre."""
    angles = np.arange(0, 361, 5)
    from_peak = (angles + 180 - 10) % 360 - 180
    forces = peak * np.exp(-0.5 * (from_peak / 25.0) ** 2)
    path = folder / f"gas_{peak:g}.csv"
    rows = (f"{angle},{force:.6f}\n" for angle, force in zip(angles, forces, strict=True))
    path.write_text("angle_deg,force_N\n" + "".join(rows))
    return path
