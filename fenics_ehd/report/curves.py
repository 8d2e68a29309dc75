"""Peak pressure and minimum film over time: the paper's figures 5 to 8, and 10 and 11."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from fenics_ehd.report.study_data import FILM, QUANTITIES, Quantity, Study, StudyRun
from fenics_ehd.report.style import (
    COLOURS,
    FLOOR,
    FLOOR_LABEL,
    REFERENCE,
    SELECTIONS,
    family,
    legend_below,
    save,
    shade,
    two_panels,
)
from fenics_ehd.study.errors_file import FILM as FILM_ERROR
from fenics_ehd.study.errors_file import PRESSURE as PRESSURE_ERROR
from fenics_ehd.study.errors_file import TIME, errors_path, read_errors

#: Run that every other one is compared with.
REFERENCE_RUN = "reference"

#: Typical safe film thickness of engine bearings, section 4.2 [um].
SAFE_FILM_THICKNESS = 2.5

#: Curves of one method from few modes to many.
LINES = (":", "--", "-.", "-")

History = Mapping[str, np.ndarray]


def spread(runs: Sequence[StudyRun], most: int) -> list[StudyRun]:
    """At most so many of the runs, from few coordinates to many, evenly by rank."""
    ordered = sorted(runs, key=lambda run: run.coordinates)
    if len(ordered) <= most:
        return ordered
    return [ordered[round(i * (len(ordered) - 1) / (most - 1))] for i in range(most)]


def error_curve(history: History, reference: History, quantity: Quantity) -> np.ndarray:
    """Signed relative error at the run's own steps.

    Of the pressure relative to the reference's peak, of the film to the film at that time; the
    reference is interpolated linearly between its steps, which lie closer.
    """
    column = quantity.column
    truth = np.interp(history["time_s"], reference["time_s"], reference[column])
    scale = truth if quantity is FILM else reference[column].max()
    return (history[column] - truth) / scale


def draw_methods(
    study: Study, runs: Sequence[StudyRun], folder: Path, name: str, *, alone: bool = False
) -> bool:
    """Curves of some runs on the reference's, or of it `alone`; whether there were any."""
    reference = study.history(REFERENCE_RUN)
    drawn = _with_histories(study, runs)
    if reference is None or not (drawn or alone):
        return False
    figure, panels = two_panels(3.9)
    for axes, quantity in zip(panels, QUANTITIES, strict=True):
        _draw_reference(axes, reference, quantity)
        for number, (run, history) in enumerate(drawn):
            axes.plot(
                1e3 * history["time_s"],
                quantity.factor * history[quantity.column],
                color=_shade(run, [run for run, _ in drawn]),
                linestyle=_dashes([run for run, _ in drawn], number),
                label=f"{family(run)}, {run.coordinates:.0f} coordinates",
            )
        _finish(axes, quantity, reference, study)
    legend_below(figure)
    save(figure, folder, name)
    return True


def _with_histories(study: Study, runs: Sequence[StudyRun]) -> list[tuple[StudyRun, History]]:
    found = [(run, study.history(run.run)) for run in runs]
    return [(run, history) for run, history in found if history is not None]


def _dashes(runs: Sequence[StudyRun], number: int) -> Any:
    """Of variants their own, else the more coordinates, the more solid."""
    if len({run.coordinates for run in runs}) < len(runs):
        return SELECTIONS.get(runs[number].selection, ("", "-"))[1]
    return LINES[max(len(LINES) - len(runs), 0) + number] if number < len(LINES) else "-"


def _shade(run: StudyRun, runs: Sequence[StudyRun]) -> Any:
    """Colour of the method, of several runs the later, the darker: dashes lie on each other."""
    colour = COLOURS.get(run.method, "0.4")
    same = [other for other in runs if other.method == run.method]
    return shade(colour, same.index(run) / (len(same) - 1)) if len(same) > 1 else colour


def _draw_reference(axes: Axes, reference: History, quantity: Quantity) -> None:
    axes.plot(
        1e3 * reference["time_s"],
        quantity.factor * reference[quantity.column],
        color=REFERENCE,
        linewidth=4.5,
        solid_capstyle="butt",
        label="reference",
    )


def _finish(axes: Axes, quantity: Quantity, reference: History, study: Study) -> None:
    top = None
    if quantity is FILM:
        # The start, from a whole clearance, would press the rest into a corner.
        time, film = reference["time_s"], quantity.factor * reference[quantity.column]
        top = 1.15 * film[time >= time[-1] / 10].max()
    if quantity is FILM and study.scene == "slider-crank":
        axes.axhline(
            SAFE_FILM_THICKNESS,
            color="0.3",
            linestyle=(0, (1, 2)),
            linewidth=1.2,
            label=f"safe film of engine bearings, {SAFE_FILM_THICKNESS} µm",
        )
    axes.set(xlabel="time [ms]", ylabel=quantity.label, ylim=(0, top))
    axes.margins(x=0)


def draw_errors(study: Study, runs: Sequence[StudyRun], folder: Path, name: str) -> bool:
    """Relative errors of some runs over time, none inside the reference's own error."""
    reference = study.history(REFERENCE_RUN) if study.judged else None
    drawn = _with_histories(study, runs)
    if reference is None or not drawn:
        return False
    figure, panels = two_panels(3.9)
    for axes, quantity in zip(panels, QUANTITIES, strict=True):
        floor = max(run.floor(quantity) for run, _ in drawn)
        if floor > 0:
            axes.axhspan(-100 * floor, 100 * floor, color=FLOOR, linewidth=0, label=FLOOR_LABEL)
        for run, history in drawn:
            time, error = _errors_over_time(study, run, history, reference, quantity)
            axes.plot(
                1e3 * time,
                100 * np.where(np.abs(error) < floor, np.nan, error),
                color=COLOURS.get(run.method, "0.4"),
                linestyle=SELECTIONS.get(run.selection, ("", "-"))[1],
                label=f"{family(run)}, {run.coordinates:.0f} coordinates",
            )
        axes.axhline(0, color="0.3", linewidth=0.8)
        of = "of the film" if quantity is FILM else "of the reference's peak"
        _spread_small_errors(axes, 100 * floor)
        axes.set(xlabel="time [ms]", ylabel=f"error of {quantity.title}\n[% {of}]")
        axes.set_xlim(1e3 * study.start, 1e3 * reference["time_s"][-1])
    legend_below(figure)
    save(figure, folder, name)
    return True


def _errors_over_time(
    study: Study, run: StudyRun, history: History, reference: History, quantity: Quantity
) -> tuple[np.ndarray, np.ndarray]:
    """Times and errors while they count: the exact ones, where the study left them."""
    path = errors_path(study.folder(run.run), REFERENCE_RUN)
    if path.exists():
        found = read_errors(path)
        return found[TIME], found[FILM_ERROR if quantity is FILM else PRESSURE_ERROR]
    time = history["time_s"]
    counted = (time >= study.start) & (time <= reference["time_s"][-1])
    return time[counted], error_curve(history, reference, quantity)[counted]


def _spread_small_errors(axes: Axes, floor: float) -> None:
    """Logarithmic on both sides of the band of errors [%] that mean nothing."""
    if floor > 0:
        largest = max(map(abs, axes.get_ylim()))
        axes.set_yscale("symlog", linthresh=floor, linscale=0.4)
        decades = [10.0**n for n in range(-9, 4) if floor <= 10.0**n <= largest]
        ticks = [*(-value for value in reversed(decades)), 0.0, *decades]
        low, high = axes.get_ylim()
        axes.set_yticks([tick for tick in ticks if low <= tick <= high])
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_minor_locator(NullLocator())
