"""Which figures a study gives, by section; one that has no data is left out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fenics_ehd.report import accuracy, cost
from fenics_ehd.report.comparisons import scene_m3
from fenics_ehd.report.curves import draw_errors, draw_methods, spread
from fenics_ehd.report.document import Picture
from fenics_ehd.report.mode_shapes import draw_mode_shapes
from fenics_ehd.report.needed import near
from fenics_ehd.report.pressure_map import draw_pressure
from fenics_ehd.report.slider_crank_checks import RICH
from fenics_ehd.report.study_data import Study, StudyRun

#: Most curves in one panel beside the reference.
MOST = 4

#: Overall modes of the figures of errors over time: the paper's, and for the slider-crank those
#: of M3 with 31 residual modes.
SIZES = {
    "rotor": ((30, "figure_10"), (50, "figure_11")),
    "slider-crank": ((39, "errors_over_time"),),
}


class Pictures:
    """Draws figures of a study into a folder.

    Parameters
    ----------
    study, folder
        What is drawn, and where.
    """

    def __init__(self, study: Study, folder: Path):
        self._study, self._folder = study, folder

    def _picture(self, drawn: bool, name: str, caption: str) -> list[Picture]:
        return [Picture(name, caption)] if drawn else []

    def cost(self) -> list[Picture]:
        """Error against time and against the number of coordinates."""
        bound = (
            "A triangle pointing down on the edge of the grey band: the error is no larger than "
            "this, the reference cannot tell how small."
        )
        figures = (
            ("error_against_time", cost.ONLINE, "max",
             "Error against processor time of the time integration. Curves join runs of one "
             "method from few coordinates to many, at the study's step tolerance; the hull tells "
             f"method, coordinates and tolerance. {bound}"),
            ("mean_error_against_time", cost.ONLINE, "l2",
             f"The same with the L2 norm of the errors over the revolution. {bound}"),
            ("error_against_reduction_time", cost.OFFLINE, "max",
             "Error against processor time of the reduction, which is paid once for a part. "
             f"{bound}"),
            ("error_against_modes", cost.COORDINATES, "max",
             "Error against the number of elastic coordinates. What M4 keeps without "
             f"coordinates is not counted. {bound}"),
        )  # fmt: skip
        return [
            picture
            for name, kind, norm, caption in figures
            for picture in self._picture(
                cost.draw_cost(self._study, kind, self._folder, name, norm), name, caption
            )
        ]

    def curves(self) -> list[Picture]:
        """The paper's curves over time from these runs."""
        slider_crank = self._study.scene == "slider-crank"
        figures = self._slider_crank_figures() if slider_crank else self._rotor_figures()
        pictures = []
        for name, runs, caption in figures:
            alone = name == "figure_5"
            drawn = draw_methods(self._study, runs, self._folder, name, alone=alone)
            pictures += self._picture(drawn, name, caption)
        for size, name in SIZES[self._study.scene]:
            caption = (
                f"{_paper(name)}Errors over time of the methods with about {size} coordinates; "
                "positive: above the reference. Logarithmic on both sides of the grey band, the "
                "reference's own error, inside of which no value is drawn."
            )
            drawn = draw_errors(self._study, self._of_size(size), self._folder, name)
            pictures += self._picture(drawn, name, caption)
        return pictures

    def _rotor_figures(self) -> list[tuple[str, Sequence[StudyRun], str]]:
        """Name, runs and caption of what the errors of figure 10 are those of."""
        size = SIZES["rotor"][0][0]
        caption = (
            f"Both curves with about {size} coordinates; figures 10 and 11 of the paper show their "
            "errors."
        )
        return [("curves", self._of_size(size), caption)]

    def _slider_crank_figures(self) -> list[tuple[str, Sequence[StudyRun], str]]:
        """Name, runs and caption of the paper's figures 5 to 8."""
        study = self._study
        rich = [
            run for run in study.pick(method="m3", pressure_set="pc1") if run.residual_modes in RICH
        ]
        best = sorted(rich, key=lambda run: run.worst_error)[:1]
        selections = study.pick(method="m3", pressure_set="pc2", residual_modes=31)
        default_m3 = study.pick(**scene_m3(study))
        return [
            ("figure_5", best, "Figure 5 of the paper: the reference, here the full interface, "
             "and the paper's, M3 with unit pressures and 60 residual modes (61 here, where run "
             "so)."),
            ("figure_6", spread(study.pick(method="m1"), MOST), "Figure 6 of the paper: M1."),
            ("figure_7", spread(study.pick(method="m2"), MOST), "Figure 7 of the paper: M2."),
            ("figure_8", spread(default_m3, MOST), "Figure 8 of the paper: M3 with long and "
             "short bearing shapes."),
            ("selections", selections, "M3 with 31 residual modes by each selection; the "
             "smallest eigenvalues are the paper's (31)-(32) to the letter."),
        ]  # fmt: skip

    def _of_size(self, size: int) -> list[StudyRun]:
        """One run of each method with about so many coordinates, and M4 with its own."""
        study = self._study
        m4 = sorted(study.pick(method="m4"), key=lambda run: run.worst_error)[:1]
        kinds = (study.pick(method="m1"), study.pick(method="m2"), study.pick(**scene_m3(study)))
        return [run for kind in kinds for run in near(kind, size)[:1]] + m4

    def accuracy(self) -> list[Picture]:
        """Errors against the settings of a run."""
        tolerances = accuracy.draw_tolerances(self._study, self._folder, "error_against_tolerance")
        meshes = accuracy.draw_film_meshes(self._study, self._folder, "error_against_film_mesh")
        finest = accuracy.finest_mesh(self._study)
        return [
            *self._picture(tolerances, "error_against_tolerance",
                           "Error of the steps against the tolerance asked for."),
            *self._picture(meshes, "error_against_film_mesh",
                           f"Error of the film mesh, against the finest one, {finest} cells "
                           "(around x along)."),
        ]  # fmt: skip

    def estimates(self) -> list[Picture]:
        """What runs say of themselves."""
        drawn = accuracy.draw_estimates(self._study, self._folder, "estimate_against_truth")
        caption = (
            "Each run's own estimate against the true gap error. The estimate is of the basis "
            "alone; the truth holds the error of the steps as well."
        )
        return self._picture(drawn, "estimate_against_truth", caption)

    def bore(self) -> list[Picture]:
        """Shapes of the bore and pressure on it."""
        shapes = draw_mode_shapes(self._study, self._folder, "mode_shapes")
        pressure = draw_pressure(self._study, self._folder, "pressure")
        return [
            *self._picture(shapes, "mode_shapes",
                           "First modes of each method on the bore, rigid motion of the bore taken "
                           "out, deflection exaggerated to a third of the radius: mid-width thick, "
                           "upper edge (largest z) dashed, lower edge dotted."),
            *self._picture(pressure, "pressure",
                           "Film pressure of the reference on the unwrapped bore. The cross is the "
                           "node with the highest pressure; the colours are a smooth surface "
                           "through the nodes, whose own top may lie between them."),
        ]  # fmt: skip


def _paper(name: str) -> str:
    return f"Figure {name.split('_')[1]} of the paper. " if name.startswith("figure_") else ""
