"""Figures 5 to 8, 10 and 11 of Krinner and Rixen, drawn from studies of the paper's machines."""

from __future__ import annotations

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
from matplotlib.figure import Figure

from fenics_ehd.study.paper import VALUES, PaperFigure
from fenics_ehd.study.report.figures import draw_errors, draw_methods
from fenics_ehd.study.report.study_data import StudyData

#: Typical safe film thickness of engine bearings, h_safe in section 4.2 of the paper [um], and the
#: number of the figure in which the paper has it.
SAFE_FILM_THICKNESS = 2.5
SAFE_FILM_FIGURE = 5


def draw_figure(figure: PaperFigure, study: StudyData) -> Figure | None:
    """Draw a figure of the paper; None without a run of the reference.

    Runs that are not complete are left out.
    """
    names = [variant.name for variant in figure.variants]
    measured = {row["run"]: row for row in study.joints[0].measured("methods")}
    rows = [measured[name] for name in names if name in measured]
    if figure.shown != VALUES:
        return draw_errors(study, rows)
    drawn = draw_methods(study, rows)
    if drawn is not None and figure.number == SAFE_FILM_FIGURE:
        _draw_safe_film(drawn)
    return drawn


def _draw_safe_film(figure: Figure) -> None:
    """Draw the line of a safe film thickness into the panel of the film."""
    axes = figure.axes[1]
    axes.axhline(SAFE_FILM_THICKNESS, color="0.3", linestyle=(0, (1, 2)), linewidth=1.2)
    text = (
        f"h_safe ≈ {SAFE_FILM_THICKNESS} µm, typical of engine bearings\n"
        "(section 4.2 and Fig. 5b of the paper)"
    )
    axes.annotate(text, (0.02, SAFE_FILM_THICKNESS), xytext=(0, -2), textcoords="offset points",
                  xycoords=("axes fraction", "data"), va="top", fontsize=7.5)  # fmt: skip
