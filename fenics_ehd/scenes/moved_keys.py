"""Keys of scene files of version 0.1 and what to write for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

#: Of each machine of version 0.1: some keys, or all of a section, and what is written for them
#: now, in the words of docs/scene-keys.md, whose tables these are.
MOVED: dict[str, tuple[tuple[str, str], ...]] = {
    "slider-crank": (
        ("scene", "none: the tables say what there is"),
        ("mechanism.crank_length", "`bodies.crank.points.pin`, its x"),
        (
            "mechanism.crank_speed",
            "`drives.crank.speed`; under a torque also `bodies.crank.speed`, that at the start",
        ),
        ("mechanism.drive", "`drives.crank.kind`"),
        ("mechanism.drive_torque", "`drives.crank.torque`"),
        ("mechanism.drive_torque_table", '`drives.crank.table`, with `over = "angle"`'),
        ("mechanism.drive_damping", "`drives.crank.damping`"),
        ("mechanism.crank_inertia", "`bodies.crank.inertia`"),
        ("mechanism.crank_mass", "`bodies.crank.mass`"),
        ("mechanism.crank_centre", "`bodies.crank.centre`, its x"),
        (
            "mechanism.gas_force",
            '`forces.gas.file` of kind `angle-table`, `point = "piston"`, `angle_of = "crank"`',
        ),
        ("mechanism.piston_mass", "`bodies.piston.mass`"),
        ("mechanism.revolutions", '`time.revolutions`, with `of = "crank"`'),
        (
            "bearing.radius bearing.width",
            "the part's, `bore_radius` and `bore_width` of `bodies.rod.geometry`",
        ),
        ("bearing.clearance", "`joints.big_end.clearance`"),
        ("bearing.viscosity", "`lubricants.oil.viscosity`, or `joints.big_end.viscosity`"),
        ("bearing.smallest_film", "`joints.big_end.smallest_film`"),
        ("rod.model rod.cells rod.element rod.damping_time", "the same of `bodies.rod`"),
        (
            "rod.youngs_modulus rod.poissons_ratio rod.density",
            "the same of `bodies.rod.material`",
        ),
        ("rod.geometry", "`bodies.rod.geometry`"),
        ("reduction.*", "the same of `bodies.rod.reduction`"),
        ("film.element film.cells film.transfer film.friction", "the same of `joints.big_end`"),
        (
            "start.eccentricity_x start.eccentricity_y",
            "`joints.big_end.eccentricity = [x, y]`",
        ),
        ("start.velocity_x start.velocity_y", "`joints.big_end.eccentricity_rate = [x, y]`"),
        ("time.tolerance time.order time.first_step time.smallest_step", "the same"),
        (
            "time.largest_step",
            "the same as a share of a revolution, it was in degrees: 7.2 degrees are 0.02",
        ),
    ),
    "rotor": (
        (
            "shaft.length shaft.diameter shaft.youngs_modulus shaft.density "
            "shaft.support_stiffness shaft.elements shaft.modes shaft.damping_ratio",
            "the same of `bodies.shaft`",
        ),
        ("shaft.speed", "`drives.shaft.speed` and `forces.unbalance.speed`"),
        ("shaft.revolutions", '`time.revolutions`, with `of = "shaft"`'),
        (
            "disk.position disk.mass disk.polar_inertia disk.diametral_inertia",
            "a row of `bodies.shaft.disks`",
        ),
        ("force.amplitude", "`forces.unbalance.amplitude` of kind `rotating`"),
        (
            "force.position",
            '`bodies.shaft.points.force`, with `forces.unbalance.point = "shaft.force"`',
        ),
        ("force.ramp", "`forces.unbalance.ramp` in seconds, it was in revolutions"),
        ("bearing.position", "`bodies.shaft.points.bearing`"),
        (
            "bearing.radius bearing.width",
            "the part's, `bore_radius` and `bore_width` of `bodies.housing.geometry`",
        ),
        (
            "bearing.clearance bearing.viscosity bearing.smallest_film film.*",
            "the same of `joints.bearing`",
        ),
        ("time.*", "as of the slider-crank"),
        ("housing.*", '`bodies.housing.*` as for the rod above, with `held_by = "foot"`'),
        ("reduction.*", "the same of `bodies.housing.reduction`"),
    ),
    "loaded-journal": (
        (
            "bearing.radius bearing.width bearing.clearance bearing.ambient_pressure "
            "bearing.grooves",
            "the same of `joints.bearing`",
        ),
        ("bearing.viscosity", "`lubricants.oil.viscosity`"),
        ("bearing.shaft_speed", "`drives.journal.speed`"),
        (
            "bearing.bore_speed",
            "a body with the bore: kind `massless`, a `revolute` joint to the ground and a drive",
        ),
        ("film.cells film.element", "the same of `joints.bearing`"),
        ("film.cavitation", "`joints.bearing.cavitation`"),
        (
            "load.file load.scale load.interpolation load.period",
            "the same of `forces.load` of kind `time-table`; the built-in load is `main-bearing`",
        ),
        (
            "time.tolerance time.order time.first_step time.smallest_step time.periodicity "
            "time.cycles",
            "the same, with `periodic = true`",
        ),
        (
            "time.largest_step",
            "the same as a share of a revolution where `revolutions` are given, else of the period",
        ),
        (
            "start.eccentricity_x start.eccentricity_y",
            "`joints.bearing.eccentricity = [x, y]`",
        ),
    ),
}

#: Most keys of a file that a line names.
MOST = 3


def moved_keys(tables: Mapping[str, Any]) -> Iterator[str]:
    """What each key of an old file's tables is now: ``bearing.clearance is now ...``."""
    named = str(tables.get("scene", ""))
    machine = named if named in MOVED else "slider-crank"
    if machine != named:
        own = {"shaft": "rotor", "disk": "rotor", "housing": "rotor", "load": "loaded-journal"}
        machine = next((own[table] for table in tables if table in own), machine)
    for table, values in tables.items():
        names = [f"{table}.{name}" for name in values] if isinstance(values, Mapping) else [table]
        for name in names:
            for keys, now in MOVED[machine]:
                known = keys.split()
                if name != "scene" and (name in known or f"{table}.*" in known):
                    yield f"{name} is now {now.replace('`', '')}"


def hint(tables: Mapping[str, Any]) -> str:
    """Some of them in a line, or nothing."""
    found = [line for line in moved_keys(tables) if not line.endswith("is now the same")]
    more = f" and {len(found) - MOST} more" if len(found) > MOST else ""
    return "; ".join(found[:MOST]) + more
