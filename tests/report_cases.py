"""A study's folder by hand: curves and tables of known errors, small reduced bodies."""

import csv
import json
from dataclasses import replace

import numpy as np
from foreign_parts import ring

import fenics_ehd as ehd
from fenics_ehd.base.columns import Quantity, split_unit
from fenics_ehd.multibody.history import FIELD_UNITS
from fenics_ehd.study.compare import COLUMNS, errors_path
from fenics_ehd.study.report.study_data import TEXTS, StudyData, StudyRow, read_study

PAPER = {"slider-crank-paper": ("big_end", 0.0125), "rotor-paper": ("bearing", 0.0105)}
ERRORS = {"pressure_error_max": 0.01, "pressure_error_l2": 0.005, "film_error_max": 0.02,
          "film_error_l2": 0.01}  # fmt: skip
COMMON = ("time_s", "cycle", "cycle_time_s")
OWN = {"pressure_max": 1e-3, "pressure_l2": 5e-4, "film_max": 2e-3, "film_l2": 1e-3}

NAN = float("nan")


def run(name, **values):
    """A row of a table: complete, with errors of a per cent or two by default."""
    usual = {"group": "methods", "method": "m3", "status": "complete", "tolerance": 1e-5,
             "order": 2, "film_cells": "20x5", "coordinates": 39, "offline_s": 4.0,
             "online_s": 8.0, "steps": 500, "newton_iterations": 700, "max_pressure_Pa": 45e6,
             "min_film_thickness_m": 2.5e-6, "estimated_gap_error_m": 1e-7,
             "true_gap_error_m": 6e-8, "highest_frequency_Hz": 2e5, **ERRORS,
             "pressure_floor": 1e-3, "film_floor": 2e-3}  # fmt: skip
    empty = dict.fromkeys(COLUMNS, NAN) | dict.fromkeys(TEXTS, "")
    return StudyRow(empty | {"run": name} | usual | values)


def changed(row, **values):
    return StudyRow(row | values)


def m1(modes, pressure=0.2, film=0.2, **values):
    errors = {"pressure_error_max": pressure, "film_error_max": film}
    return run(f"m1-{modes}", **({"method": "m1", "vibration_modes": modes,
                                "coordinates": modes + 2} | errors | values))  # fmt: skip


def m2(modes, pressure=0.1, film=0.1, **values):
    return changed(m1(modes, pressure, film, **values), run=f"m2-{modes}", method="m2")


def m3(modes, pressure=0.01, film=0.02, **values):
    """The slider-crank's default of M3, with changes."""
    usual = {"pressure_set": "pc2", "selection": "lowest-frequency", "residual_modes": modes,
             "vibration_modes": 6, "coordinates": modes + 8, "pressure_error_max": pressure,
             "film_error_max": film}  # fmt: skip
    merged = usual | values
    return run(f"m3-{merged['pressure_set']}-{merged['selection']}-{modes}", **merged)


def m4(pressure=1e-3, film=2e-3, **values):
    errors = {"pressure_error_max": pressure, "film_error_max": film}
    return run("m4", **({"method": "m4", "coordinates": 9} | errors | values))


def without_end(row, status="not run"):
    """A planned run of which there are no figures."""
    names = ("coordinates", "pressure_error_max", "film_error_max", "online_s")
    return changed(row, status=status, **dict.fromkeys(names, NAN))


def bearing(*rows, scene="slider-crank-paper", directory=None, status="complete", **info):
    """The lubricated joint of a study of one of the paper's machines."""
    reference = {"status": status, "step": {"pressure_max": 1e-3, "film_max": 2e-3}}
    about = {"scene": scene, "joints": [PAPER[scene][0]], "runs": len({row["run"] for row in rows})}
    return StudyData(directory, about | info, reference, rows).joints[0]


def write_study(directory, rows, joints=("big_end",), reference=None, **info):
    """Tables of a study on disk, the same rows for every joint that they do not name."""
    directory.mkdir(parents=True, exist_ok=True)
    about = {"scene": "slider-crank-paper", "joints": joints, "version": "0", "start": 1e-4,
             "runs": len({row["run"] for row in rows}), **info}  # fmt: skip
    (directory / "study.json").write_text(json.dumps(about))
    own = OWN if len(joints) == 1 else {"joints": dict.fromkeys(joints, OWN)}
    found = {"method": "full", "status": "complete", "tolerance": 1e-8, "order": 3,
             "step": {"run": "reference-step", "how": "other steps", **own},
             "basis": {"pressure_max": None, "why": "full-6: not run"}}  # fmt: skip
    (directory / "reference.json").write_text(json.dumps(reference or found))
    with open(directory / "table.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for row in rows:
            for joint in joints if not row["joint"] else (row["joint"],):
                cells = {k: "" if v != v else v for k, v in row.items()}
                writer.writerow(cells | {"joint": joint})
    return read_study(directory)


def peak_pressure(time):
    """A plateau between 6 and 8 ms, half of it at either end of the revolution."""
    return 40e6 * np.exp(-(((time - 7e-3) / 4e-3) ** 4)) + 5e6


def film_thickness(time):
    return 1e-6 * (2.4 + 6.0 * np.exp(-time / 3e-3))


def profile(nodes, time, tilt=0.0):
    """Pressure shape on the bore, peak 1 at angle 0; behind it the flatter, the later."""
    angle, height = np.mod(nodes[:, 0] + np.pi, 2 * np.pi) - np.pi, nodes[:, 1]
    width = np.where(angle < 0, 0.4, 0.4 + 100 * np.maximum(time - 6e-3, 0.0))
    axial = 1 - (2 * height / np.ptp(height)) ** 2
    return np.exp(-((angle / width) ** 2)) * axial * (1 + tilt * height / np.ptp(height))


def write_history(
    study, name, *, above=0.0, thicker=0.0, tilt=0.0, falling=True, steps=200, periodic=False
):
    """History of a run whose pressure is this share of the peak above, its film this thicker.

    Of several joints the second has twice the pressure of the first. With the errors that such a
    run has.
    """
    grid, grids = ehd.uniform_grid(0.0225, 0.022, (20, 5)), {}
    nodes = grid.node_positions
    joints, top = study.info["joints"], peak_pressure(7e-3)
    prefixes = [f"{joint}." for joint in joints]
    whole = PAPER.get(study.info["scene"], ("", 0.0125))[1]
    time = np.linspace(whole / steps, whole, steps)
    high = peak_pressure(time) > 0.75 * top
    rows, errors = {"time_s": time + (3 * whole if periodic else 0.0)}, {"time_s": time}
    if periodic:
        rows |= {"cycle": np.full(len(time), 4.0), "cycle_time_s": time}
    for factor, prefix in enumerate(prefixes, start=1):
        film = film_thickness(time) if falling else film_thickness(0 * time + 7e-3)
        rows[f"{prefix}max_pressure_Pa"] = factor * (peak_pressure(time) + above * top * high)
        rows[f"{prefix}min_film_thickness_m"] = film * (1 + thicker)
        rows[f"{prefix}max_pressure_angle_deg"] = 0.0 * time
        errors[f"{prefix}pressure_error"] = above * high
        errors[f"{prefix}film_error"] = thicker + 0.0 * time
    values = {"time_s" if n == "time_s" else f"run/{n}": rows[n] for n in COMMON if n in rows}
    for prefix, joint in zip(prefixes, joints, strict=True):
        film = f"joints/{joint}/film"
        for column in rows:
            if column.startswith(prefix) and column not in COMMON:
                values[f"joints/{joint}/{column.removeprefix(prefix)}"] = rows[column]
        peaks = rows[f"{prefix}max_pressure_Pa"]
        thicknesses = rows[f"{prefix}min_film_thickness_m"]
        grids |= dict(zip((f"{film}/angle", f"{film}/height"), nodes.T, strict=True))
        grids |= {f"{film}/cells": grid.cell_nodes, f"{film}/radius": grid.radius}
        grids[f"{film}/clearance"] = 17e-6
        shapes = [profile(nodes, moment, tilt) for moment in time]
        grids[f"{film}/pressure"] = peaks[:, None] * np.array(shapes)
        grids[f"{film}/gap"] = np.multiply.outer(thicknesses, np.ones(len(nodes)))
    quantities = {}
    for column, v in values.items():
        path, unit = split_unit(column)
        quantities[path] = Quantity(v, unit)
    for path, v in grids.items():
        quantities[path] = Quantity(v, FIELD_UNITS[path.rpartition("/")[2]])
    for kind in ("coordinates", "rates"):
        quantities[f"state/{kind}"] = Quantity(np.zeros((len(time), 0)), "1")
    ehd.History(quantities).save(study.folder(name))
    np.savez(errors_path(study.folder(name), "reference"), **errors)


def write_bodies(study, *names):
    """Reduced rings of M1, M3 with two numbers of residual modes, and M4, in the runs' folder."""
    part = ring()
    message = {"pressure_set": "pc2", "selection": "lowest-frequency"}
    bodies = [
        ehd.craig_bampton(part, 8),
        *(replace(ehd.load_dependent(part, 6, n), provenance=message | {"residual_modes": str(n)})
          for n in (6, 12)),
        ehd.residual_flexibility(part, 6),
    ]  # fmt: skip
    for name, body in zip(names, bodies, strict=True):
        study.folder(name).mkdir(parents=True, exist_ok=True)
        ehd.save_body(body, study.folder(name) / "body-rod.h5")
