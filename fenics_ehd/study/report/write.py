"""The report of a study: from its folder to pages and figures in the same folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure

from fenics_ehd.base.folder import claim
from fenics_ehd.base.output import require_writable, write_whole
from fenics_ehd.plotting.picture import SETTINGS, in_formats, plt, save
from fenics_ehd.study.report.accuracy import draw_estimates, draw_film_meshes, draw_tolerances
from fenics_ehd.study.report.cost import COORDINATES, ONLINE, draw_cost
from fenics_ehd.study.report.curves import alike, draw_errors, draw_methods
from fenics_ehd.study.report.losses import draw_friction
from fenics_ehd.study.report.mode_shapes import best_bodies, draw_mode_shapes
from fenics_ehd.study.report.pressure_map import draw_pressure
from fenics_ehd.study.report.reading import read_study
from fenics_ehd.study.report.render import render
from fenics_ehd.study.report.study_data import StudyData

#: Pages, the first one without need of another file, and the folder of the figures.
PAGES, FIGURES = ("report.html", "report.md"), "figures"


def write_report(directory: str | Path) -> Path:
    """Write ``report.html``, ``report.md`` and ``figures/`` of a study.

    A study that goes on, or was stopped, is reported as far as it got. The same study gives
    the same files.

    Parameters
    ----------
    directory
        Of the study.

    Returns
    -------
    Path
        The HTML page, which needs no other file.

    Raises
    ------
    InputError
        The folder holds no study, or cannot be written to.
    """
    folder = Path(directory)
    study = read_study(folder)
    require_writable(folder)
    claim(folder, (*PAGES, f"{FIGURES}/"))
    drawn = []
    with plt.rc_context(SETTINGS):
        for name, figure in _figures(study):
            if figure is not None:
                pictures = in_formats(folder / FIGURES, name)
                claim(folder / FIGURES, [path.name for path in pictures])
                save(figure, pictures)
                drawn.append(name)
    for page in PAGES:
        form = page.partition(".")[2]
        write_whole(folder / page, render(form, folder / FIGURES, study=study, drawn=drawn))
    return folder / PAGES[0]


def _figures(study: StudyData) -> Iterator[tuple[str, Figure | None]]:
    """Figures by the stem of their files, None in the place of one without anything to show."""
    yield "error_against_time", draw_cost(study.joints, ONLINE)
    yield "mean_error_against_time", draw_cost(study.joints, ONLINE, "l2")
    yield "error_against_modes", draw_cost(study.joints, COORDINATES)
    yield "curves", draw_methods(study, alike(study))
    yield "errors_over_time", draw_errors(study, alike(study))
    yield "friction_torque", draw_friction(study)
    yield "error_against_tolerance", draw_tolerances(study.joints)
    yield "error_against_film_mesh", draw_film_meshes(study.joints)
    yield "estimate_against_truth", draw_estimates(study.joints)
    for name, bodies in best_bodies(study).items():
        yield f"mode_shapes_{name}", draw_mode_shapes(bodies)
    for joint in study.joints:
        yield f"pressure_{joint.name}", draw_pressure(joint)
