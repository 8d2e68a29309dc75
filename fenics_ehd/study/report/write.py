"""Pages of the report of a study, with tables and figures.

The report is one self-contained HTML page and a Markdown page, in the folder of the study.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
from matplotlib.figure import Figure

from fenics_ehd.base.files import claim, require_writable, write_whole
from fenics_ehd.plotting.picture import SETTINGS, factor_of, plt, save_in_formats
from fenics_ehd.study.compare import LIMITING
from fenics_ehd.study.report.figures import (
    COLOURS,
    COORDINATES,
    ONLINE,
    alike,
    best_bodies,
    draw_cost,
    draw_errors,
    draw_estimates,
    draw_film_meshes,
    draw_methods,
    draw_mode_shapes,
    draw_pressure,
    draw_tolerances,
    family,
)
from fenics_ehd.study.report.page import Table, percent, render
from fenics_ehd.study.report.study_data import (
    CURVES,
    NORMS,
    Curve,
    JointData,
    StudyData,
    StudyRow,
    read_study,
)

#: Error limits of the rows in the table of costs; an error is relative.
LIMITS = (0.1, 0.05, 0.02, 0.01, 0.005)

#: Names in the report of the reference's own errors, by kind.
REFERENCE_ERRORS = {"step": "step size", "film": "film mesh", "basis": "basis"}

#: Columns with results in the table of all runs: key, heading, format.
RUN_FIGURES = (
    ("offline_s", "reduction [s]", ".1f"),
    ("online_s", "integration [s]", ".2f"),
    ("steps", "steps", "g"),
    ("newton_iterations", "Newton iterations", "g"),
    ("highest_frequency_Hz", "highest frequency [kHz]", ".3g"),
    ("estimated_gap_error_m", "estimate [µm]", ".3g"),
    ("true_gap_error_m", "true gap error [µm]", ".3g"),
)


def bounded(row: StudyRow, curve: Curve) -> str:
    """Text of a run's largest error of a curve; an upper limit has the form ``≤ 2 %``.

    The error is an upper limit if the reference's own error is larger.
    """
    return "≤ " * row.bounded(curve) + percent(row.visible_error(curve))


def cost_table(joint: JointData) -> Table:
    """Table of the fastest run of each method with errors below a limit, for several limits."""
    runs = {method: joint.measured("methods", "tolerance", method=method) for method in COLOURS}
    runs = {method: rows for method, rows in runs.items() if rows}
    table = [
        (percent(limit), *(_fastest(rows, limit) for rows in runs.values())) for limit in LIMITS
    ]
    return Table(
        ("errors of both curves within", *map(str.upper, runs)), tuple(table), 1 + len(runs)
    )


def _fastest(rows: list[StudyRow], limit: float) -> str:
    good = [row for row in rows if row.worst_error <= limit]
    if not good:
        return f"none, best {percent(min(row.worst_error for row in rows))}"
    row = min(good, key=lambda row: row["online_s"])
    words = [family(row)[3:].strip(), f"{row['coordinates']:.0f} coordinates"]
    settings = ", ".join([*filter(None, words), f"tolerance {row['tolerance']:g}"])
    return f"{row['online_s']:.1f} s: {settings}"


def run_table(study: StudyData) -> Table:
    """Table of all runs with their results; for a failed run, the reason is given."""
    errors = (f"{curve.key} error" for curve in CURVES)
    heads = ("run", "joint", "method", "tolerance", "coordinates", *errors,
             *(head for _, head, _ in RUN_FIGURES))  # fmt: skip
    return Table(heads, tuple(_run_cells(row, len(heads)) for row in study.rows), words=3)


def _run_cells(row: StudyRow, length: int) -> tuple[str, ...]:
    about = (row["run"], row["joint"], family(row), _figure(row["tolerance"]))
    if not row.complete:
        return (*about, row["status"], *[""] * (length - 5))
    errors = (bounded(row, curve) if row.measured else "" for curve in CURVES)
    figures = (_figure(factor_of(head) * row[column], form) for column, head, form in RUN_FIGURES)
    return (*about, _figure(row["coordinates"]), *errors, *figures)


def _figure(value: float, form: str = "g") -> str:
    return format(value, form) if math.isfinite(value) else ""


def unknown_floors(study: StudyData) -> list[str]:
    """Names of the reference's own errors that limit comparisons, but were not computed."""
    return [
        REFERENCE_ERRORS[kind]
        for kind in LIMITING
        if any(math.isnan(joint.own_error(kind, q)) for joint in study.joints for q in CURVES)
    ]


def film_mesh_errors(joint: JointData) -> list[str]:
    """Texts of the film mesh error of both curves, as a list; empty if it was not computed."""
    shared = [joint.own_error("film", curve) for curve in CURVES]
    return [] if any(map(math.isnan, shared)) else [*map(percent, shared)]


def reference_table(study: StudyData) -> Table:
    """Table of the reference's own errors, by kind and joint."""
    norms = [(curve, norm) for curve in CURVES for norm in NORMS]
    rows = []
    for kind, words in REFERENCE_ERRORS.items():
        entry = study.reference.get(kind) or {}
        for joint in study.joints if entry else ():
            figures = [joint.own_error(kind, *each) for each in norms]
            known = any(map(math.isfinite, figures))
            how = entry.get("how", "") if known else f"not computed: {entry.get('why')}"
            cells = map(percent, figures) if known else [""] * len(norms)
            rows.append((words, joint.name, str(how), *cells))
    heads = (f"{curve.title}, {NORMS[norm]}" for curve, norm in norms)
    return Table(("error of the reference", "joint", "measured by", *heads), tuple(rows), words=3)


#: Functions that the template calls, by name.
TABLES: dict[str, Any] = {
    "cost_table": cost_table,
    "run_table": run_table,
    "reference_table": reference_table,
    "unknown_floors": unknown_floors,
    "film_mesh_errors": film_mesh_errors,
    "REFERENCE_ERRORS": REFERENCE_ERRORS,
}


#: Names of the pages, of which the first is self-contained, and of the folder of figures.
PAGES = ("report.html", "report.md")
FIGURES = "figures"


def write_report(directory: str | Path) -> Path:
    """Write ``report.html``, ``report.md`` and ``figures/`` of a study.

    For a study that is in progress or was stopped, the report has the runs that are complete. The
    same study gives the same files.

    Parameters
    ----------
    directory
        Folder of the study.

    Returns
    -------
    Path
        Path of the HTML page, which is self-contained.

    Raises
    ------
    InputError
        The folder has no study, or it cannot be written to.
    """
    folder = Path(directory)
    study = read_study(folder)
    require_writable(folder)
    claim(folder, (*PAGES, f"{FIGURES}/"))
    drawn = {}
    with plt.rc_context(SETTINGS):
        for name, figure in _figures(study):
            if figure is not None:
                save_in_formats(figure, folder / FIGURES, name)
                drawn[name] = (folder / FIGURES / f"{name}.svg").read_bytes()
    for page in PAGES:
        form = page.partition(".")[2]
        text = render("report.jinja", form, drawn, FIGURES, study=study, **TABLES)
        write_whole(folder / page, text)
    return folder / PAGES[0]


def _figures(study: StudyData) -> Iterator[tuple[str, Figure | None]]:
    """Draw the figures, each with the stem of its file name; None for a figure without data."""
    yield "error_against_time", draw_cost(study.joints, ONLINE)
    yield "error_against_modes", draw_cost(study.joints, COORDINATES)
    yield "curves", draw_methods(study, alike(study))
    yield "errors_over_time", draw_errors(study, alike(study))
    yield "error_against_tolerance", draw_tolerances(study.joints)
    yield "error_against_film_mesh", draw_film_meshes(study.joints)
    yield "estimate_against_truth", draw_estimates(study.joints)
    for name, bodies in best_bodies(study).items():
        yield f"mode_shapes_{name}", draw_mode_shapes(bodies)
    for joint in study.joints:
        yield f"pressure_{joint.name}", draw_pressure(joint)
