"""Extreme machines: speed, clearance, oil, material, damping, basis and load."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from extremes_case import ENERGY, ERROR, SIMILAR, USUAL, Case, scene, too_thin
from extremes_claims import (
    CLEARANCE,
    DAMPING,
    MODULUS,
    OIL,
    SPEED,
    Claim,
    energy,
    nested,
    rigid_balance,
    same_as,
    similar,
    tighter,
)
from scene_runs import TOLERANCE, changed

from fenics_ehd.base.errors import StepSizeError
from fenics_ehd.reduction import ReducedBody, Reductor, load_dependent
from fenics_ehd.reduction.pressure_sets import pressure_patterns

#: Of the usual machine [rad/s].
USUAL_SPEED = 500.0

#: Keys of the rod's reduction and of the piston.
REDUCTION, PISTON = "bodies.rod.reduction", "bodies.piston.mass"


def machines(folder: Path) -> Iterator[Case]:
    """All of them; tables of gas force are written into a folder."""
    yield from _speeds()
    yield from _bearings()
    yield from _stiffnesses()
    yield from _dampings()
    yield from _bases()
    yield from _loads(folder)


def _speeds() -> Iterator[Case]:
    like = similar(SIMILAR), *USUAL
    yield Case("speed 20 rad/s", scene(values={SPEED: 20.0}), like)
    yield Case("speed 100 rad/s", scene(values={SPEED: 100.0}), like)
    for speed, oil in ((1500.0, 0.1), (3000.0, 0.5)):
        machine = {SPEED: speed, OIL: oil}
        yield Case(
            f"speed {speed:g} rad/s, {oil:g} Pa s, rigid",
            scene("rigid", 1.0, machine),
            (rigid_balance(0.01), *like),
        )
        times = speed / USUAL_SPEED
        why = f"load grows with speed^2, the oil bears as its speed: {times:g} times less"
        yield too_thin(f"speed {speed:g} rad/s, 0.01 Pa s", why, scene(values={SPEED: speed}))
        # At 3000 rad/s a rod of steel is too soft: strains grow with speed^2 / E.
        stiffer = 1 if speed < 2000 else times**2
        yield Case(
            f"speed {speed:g} rad/s, {oil:g} Pa s, E = {210 * stiffer:g} GPa",
            scene("m4", 0.5, machine | {MODULUS: 210e9 * stiffer}),
            like,
        )


def _bearings() -> Iterator[Case]:
    for clearance in (5e-6, 50e-6):
        name, here = f"clearance {clearance * 1e6:g} um", {CLEARANCE: clearance}
        yield Case(f"{name}, rigid", scene("rigid", 1.0, here), (rigid_balance(0.01), *USUAL))
        yield Case(name, scene("m3", 0.5, here), (nested(ERROR), *USUAL))
    why = "with the square of c / 17 um the oil bears 35 times less"
    yield too_thin("clearance 100 um", why, scene(values={CLEARANCE: 100e-6}))
    yield Case(
        "clearance 100 um, 0.1 Pa s, rigid",
        scene("rigid", 1.0, {CLEARANCE: 100e-6, OIL: 0.1}),
        (rigid_balance(0.01), *USUAL),
    )
    for viscosity in (0.001, 0.1, 0.5):
        machine = scene("m3", 0.5, {OIL: viscosity})
        yield Case(f"viscosity {viscosity:g} Pa s", machine, (nested(ERROR), *USUAL))


def _stiffnesses() -> Iterator[Case]:
    for gpa in (1.0, 21.0):
        speed = round(USUAL_SPEED * np.sqrt(gpa / 210), 1)
        machine = scene("m4", 0.5, {MODULUS: gpa * 1e9, SPEED: float(speed)})
        yield Case(f"E = {gpa:g} GPa, {speed:g} rad/s", machine, (similar(SIMILAR), *USUAL))
    why = "the bore yields by ten clearances to what it has to bear"
    yield too_thin("E = 1 GPa, 500 rad/s", why, scene(values={MODULUS: 1e9}))
    yield Case("rigid", scene("rigid"), (rigid_balance(0.01), *USUAL))
    text = "rigid rod to {}: 1000 times as stiff, it yields by a micrometre / 1000"
    claims = same_as(text, 0.01, scene("rigid")), *USUAL
    yield Case("E = 210 TPa", scene(values={MODULUS: 210e12}), claims)


def _dampings() -> Iterator[Case]:
    text = "full interface to {}: no inertia of small patterns"
    for zeta, limit in ((0.0, 0.05), (1e-6, 0.05)):
        here = {DAMPING: zeta, TOLERANCE: 1e-5}
        yield Case(
            f"zeta {zeta:g}, M3",
            scene("m3", 0.02, here),
            (nested(0.03), tighter(0.03), energy(ENERGY)),
        )
        claims = same_as(text, limit, scene("full", 0.02, here)), tighter(0.03), energy(ENERGY)
        yield Case(f"zeta {zeta:g}, M4", scene("m4", 0.02, here), claims)
    whole = scene("m4", 0.02, {DAMPING: 0.0, TOLERANCE: 1e-5})
    truncated = f"{REDUCTION}.residual_truncation"
    for truncation, limit in ((1e-2, 0.02), (0.1, 0.15)):
        few = "all patterns to {}: those left out move the bore less than " + f"{truncation:g}"
        claims = same_as(few, limit, whole), tighter(0.03), energy(ENERGY)
        machine = changed(whole, {truncated: truncation})
        yield Case(f"zeta 0, M4 truncated at {truncation:g}", machine, claims)
    few = (
        "six patterns resist a step of 1e-8 s 1e5 times as much as oil: no active set is found; {}"
    )
    none = Claim(few, 0.0, lambda _s, _t, run: run.figures["simulated_time_s"], "reached")
    machine = changed(whole, {truncated: 0.3})
    yield Case("zeta 0, M4 truncated at 0.3", machine, (none,), StepSizeError)
    claims = same_as(text, 0.01, scene("full", 0.2)), tighter(ERROR), energy(ENERGY)
    yield Case("zeta 1e-3, M4", scene("m4", 0.2), claims)
    text = "rigid rod to {}: relaxes in a second, a revolution takes 1.3 % of it"
    claims = same_as(text, 0.03, scene("rigid", 0.5)), tighter(ERROR), energy(ENERGY)
    yield Case("zeta 1, M4", scene("m4", 0.5, {DAMPING: 1.0}), claims)


def _bases() -> Iterator[Case]:
    full = scene("full", 0.1)
    for count, limit in ((0, None), (8, None), (100, 0.05), (340, 0.03)):
        reduction = {
            f"{REDUCTION}.residual_modes": count,
            f"{REDUCTION}.pressure_set": "pc1",
            f"{REDUCTION}.selection": "largest-eigenvalue",
        }
        claims = [tighter(ERROR), energy(ENERGY)]
        if limit is None:
            claims.append(nested(ERROR))
        else:
            text = "full interface to {}: truncation (docs/measurements.md)"
            claims.append(same_as(text, limit, full))
        yield Case(f"n_r = {count}, P_c1", scene("m3", 0.1, reduction), tuple(claims))
    machine = scene("m3", 0.1)
    text = "the same columns once to {}: a copy adds no direction"
    claims = same_as(text, 1e-6, machine, once), tighter(ERROR, twice), energy(ENERGY)
    yield Case("every pressure column twice", machine, claims, reduce=twice)


def _repeated(part: Reductor, times: int) -> ReducedBody:
    """M3 with every other one of a ring of pressures as they are, each so many times."""
    columns = np.hstack([pressure_patterns(part.structure, "pc2")[:, ::2]] * times)
    return load_dependent(part, 6, columns.shape[1], columns, "every-column", estimate_error=False)


def once(part: Reductor) -> ReducedBody:
    """Every pressure column once."""
    return _repeated(part, 1)


def twice(part: Reductor) -> ReducedBody:
    """Every pressure column twice: half of them depend on the others."""
    return _repeated(part, 2)


def _loads(folder: Path) -> Iterator[Case]:
    textbook = rigid_balance(0.01)
    yield Case("piston 0 kg, rigid", scene("rigid", 1.0, {PISTON: 0.0}), (textbook, *USUAL))
    yield Case("piston 0 kg", scene("m3", 1.0, {PISTON: 0.0}), (nested(ERROR), *USUAL))
    heavy = {PISTON: 10.0}
    slow = heavy | {SPEED: 100.0}
    why = "the load is eight times the usual one"
    yield too_thin("piston 10 kg, 500 rad/s", why, scene(values=heavy))
    yield Case("piston 10 kg, 100 rad/s, rigid", scene("rigid", 1.0, slow), (textbook, *USUAL))
    yield Case("piston 10 kg, 100 rad/s", scene("m4", 0.5, slow), (similar(SIMILAR), *USUAL))
    for peak in (20, 80):
        table = str(_gas_table(folder, 1e3 * peak))
        force = {"kind": "angle-table", "point": "piston", "file": table, "angle_of": "crank"}
        gas = {"forces.gas": force}
        yield Case(f"gas {peak} kN, rigid", scene("rigid", 1.0, gas), (textbook, *USUAL))
        yield Case(f"gas {peak} kN", scene("m3", 0.5, gas), (nested(ERROR), *USUAL))


def _gas_table(folder: Path, peak: float) -> Path:
    """A bell of gas force, 10 degrees after top dead centre."""
    angles = np.arange(0, 361, 5)
    from_peak = (angles + 180 - 10) % 360 - 180
    forces = peak * np.exp(-0.5 * (from_peak / 25.0) ** 2)
    path = folder / f"gas_{peak:g}.csv"
    rows = (f"{angle},{force:.6f}\n" for angle, force in zip(angles, forces, strict=True))
    path.write_text("angle_deg,force_N\n" + "".join(rows))
    return path
