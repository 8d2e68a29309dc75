"""A study's folder by hand: curves and tables of known errors, small reduced bodies."""

import csv
import json
from dataclasses import fields, replace

import numpy as np
from foreign_parts import ring

from fenics_ehd.film import uniform_grid
from fenics_ehd.history_file import HistoryWriter
from fenics_ehd.reduction import craig_bampton, load_dependent, residual_flexibility, save_body
from fenics_ehd.report.reading import read_study
from fenics_ehd.report.study_data import Study, StudyRun

END = {"slider-crank": 0.0125, "rotor": 0.0105}
ERRORS = {"pressure_error_max": 0.01, "pressure_error_l2": 0.005, "film_error_max": 0.02,
          "film_error_l2": 0.01}  # fmt: skip
FLOOR = {"pressure_floor": 1e-3, "film_floor": 2e-3}

#: Names of the columns that are not written in lower case.
UNITS = {"highest_frequency_hz": "highest_frequency_Hz", "max_pressure_pa": "max_pressure_Pa"}


def run(name, **values):
    """A row of a table: complete, with errors of a per cent or two unless said otherwise."""
    usual = {"group": "methods", "method": "m3", "status": "complete", "tolerance": 1e-5,
             "order": 2, "film_cells": "20x5", "coordinates": 39, "offline_s": 4.0,
             "online_s": 8.0, "steps": 500, "newton_iterations": 700, "max_pressure_pa": 45e6,
             "min_film_thickness_m": 2.5e-6, "estimated_gap_error_m": 1e-7,
             "true_gap_error_m": 6e-8, "highest_frequency_hz": 2e5, **ERRORS, **FLOOR}  # fmt: skip
    return StudyRun(run=name, **(usual | values))


def m1(modes, pressure=0.2, film=0.2, **values):
    errors = {"pressure_error_max": pressure, "film_error_max": film}
    return run(f"m1-{modes}", **({"method": "m1", "vibration_modes": modes,
                                "coordinates": modes + 2} | errors | values))  # fmt: skip


def m2(modes, pressure=0.1, film=0.1, **values):
    return replace(m1(modes, pressure, film, **values), run=f"m2-{modes}", method="m2")


def m3(modes, pressure=0.01, film=0.02, **values):
    """The slider-crank's default of M3 unless said otherwise."""
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
    return replace(row, status=status, **dict.fromkeys(names, float("nan")))


def study(*runs, scene="slider-crank", directory=None, status="complete", **info):
    reference = {"status": status, "step": {"pressure_max": 1e-3, "film_max": 2e-3}}
    return Study(directory, {"scene": scene, **info}, reference, runs)


def write_study(directory, rows, scene="slider-crank", reference=None, **info):
    """Tables of a study on disk."""
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "study.json").write_text(json.dumps({"scene": scene, "version": "0", **info}))
    own = dict(zip(("pressure_max", "pressure_l2", "film_max", "film_l2"),
                   (1e-3, 5e-4, 2e-3, 1e-3), strict=True))  # fmt: skip
    found = {"method": "full", "status": "complete", "tolerance": 1e-8, "order": 3,
             "step": own | {"how": "other steps"},
             "basis": {"pressure_max": None, "why": "full-6: not run"}}  # fmt: skip
    (directory / "reference.json").write_text(json.dumps(reference or found))
    names = [field.name for field in fields(StudyRun)]
    with open(directory / "table.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([UNITS.get(name, name) for name in names])
        for row in rows:
            cells = [getattr(row, name) for name in names]
            writer.writerow(["" if cell != cell else cell for cell in cells])
    return read_study(directory)


def times(scene="slider-crank", steps=200):
    return np.linspace(END[scene] / steps, END[scene], steps)


def peak_pressure(time):
    """A plateau between 6 and 8 ms, half of it at either end of the revolution."""
    return 40e6 * np.exp(-(((time - 7e-3) / 4e-3) ** 4)) + 5e6


def film_thickness(time):
    return 1e-6 * (2.4 + 6.0 * np.exp(-time / 3e-3))


def profile(nodes, time, tilt=0.0):
    """Pressure shape on the bore, peak 1 at angle 0; behind it the flatter, the later."""
    angle, height = np.arctan2(nodes[:, 1], nodes[:, 0]), nodes[:, 2]
    width = np.where(angle < 0, 0.4, 0.4 + 100 * np.maximum(time - 6e-3, 0.0))
    axial = 1 - (2 * height / np.ptp(height)) ** 2
    return np.exp(-((angle / width) ** 2)) * axial * (1 + tilt * height / np.ptp(height))


def write_history(study, name, *, above=0.0, thicker=0.0, tilt=0.0, falling=True, steps=200,
                  end=np.inf):  # fmt: skip
    """History of a run whose pressure is this share of the peak above, its film this thicker."""
    nodes = uniform_grid(0.0225, 0.022, (20, 5)).nodes
    with HistoryWriter(study.folder(name), {"pressure_nodes_m": nodes}) as history:
        moments = times(study.scene, steps)
        for time in moments[moments <= end]:
            exact = peak_pressure(time)
            pressure = exact + above * peak_pressure(7e-3) * (exact > 0.75 * peak_pressure(7e-3))
            film = film_thickness(time if falling else 7e-3) * (1 + thicker)
            row = {"time_s": time, "max_pressure_Pa": pressure, "min_film_thickness_m": film,
                   "max_pressure_angle_deg": 0.0}  # fmt: skip
            history.add(row, {"pressure_Pa": pressure * profile(nodes, time, tilt)})


def write_bodies(directory):
    """Reduced rings by M1, M3 with two numbers of residual modes, and M4."""
    part = ring()
    told = {"pressure_set": "pc2", "selection": "lowest-frequency"}
    bodies = {
        "m1": craig_bampton(part, 8),
        **{f"m3-{n}": _named(load_dependent(part, 6, n), told | {"residual_modes": str(n)})
           for n in (6, 12)},
        "m4": residual_flexibility(part, 6),
    }  # fmt: skip
    for name, body in bodies.items():
        (directory / "bodies").mkdir(parents=True, exist_ok=True)
        save_body(body, directory / "bodies" / f"{name}.h5")


def _named(body, provenance):
    return replace(body, provenance=provenance)
