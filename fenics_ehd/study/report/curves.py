"""Peak pressure and minimum film thickness over time, of the reference and of other runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fenics_ehd.study.report.study_data import (
    FILM,
    REFERENCE_RUN,
    History,
    Quantity,
    StudyData,
    StudyRow,
)
from fenics_ehd.study.report.style import (
    COLOURS,
    FLOOR,
    FLOOR_LABEL,
    REFERENCE,
    joint_panels,
    legend_below,
    selection,
    shade,
    sized,
)

#: Curves of one method from few modes to many.
LINES = (":", "--", "-.", "-")

#: Share of the time at whose start the film builds up, where it is not drawn in full.
BUILD_UP = 0.1


def best(study: StudyData, method: str) -> list[StudyRow]:
    """The most accurate run of a method, all joints considered; none without any."""
    rows = study.joints[0].measured("methods", method=method)
    return sorted(rows, key=lambda row: study.worst_error(row["run"]))[:1]


def alike(study: StudyData) -> list[StudyRow]:
    """A run of each method with about as many coordinates, the best of M4, which needs few."""
    rows = [row for row in study.joints[0].measured("methods") if row["method"] in COLOURS]
    size = float(np.median([row["coordinates"] for row in rows if row["method"] != "m4"] or [0.0]))
    nearest = sorted(
        (row for row in rows if row["method"] != "m4"),
        key=lambda row: (abs(row["coordinates"] - size), study.worst_error(row["run"])),
    )
    of_each = {row["method"]: row for row in reversed(nearest)}
    return [of_each[method] for method in sorted(of_each)] + best(study, "m4")


def draw_methods(study: StudyData, rows: Sequence[StudyRow]) -> Figure | None:
    """Curves of some runs on the reference's, None before there is one."""
    references = {joint: joint.history(REFERENCE_RUN) for joint in study.joints}
    runs = {joint: {row: joint.history(row["run"]) for row in rows} for joint in study.joints}
    if None in references.values():
        return None
    figure, panels = joint_panels(study.joints, 3.9)
    # Of one method the later, the darker: dashes lie on each other.
    shades = np.linspace(0, 1, len(rows)) if len({row["method"] for row in rows}) == 1 else None
    for axes, joint, quantity in panels:
        _draw_curve(axes, references[joint], quantity, color=REFERENCE, linewidth=4.5,
                    solid_capstyle="butt", label="reference")  # fmt: skip
        for i, (row, history) in enumerate(runs[joint].items()):
            colour = shade(row, None if shades is None else shades[i])
            dashes = LINES[(i - len(rows)) % len(LINES)]
            _draw_curve(axes, history, quantity, color=colour, linestyle=dashes, label=sized(row))
        axes.set(xlabel="time [ms]", ylabel=f"{quantity.title} [{quantity.unit}]")
        axes.set_ylim(0, _top(references[joint], study.start) if quantity is FILM else None)
        axes.margins(x=0)
    legend_below(figure)
    return figure


def _draw_curve(axes: Axes, history: History | None, quantity: Quantity, **style: Any) -> None:
    if history is not None:
        values = quantity.factor * history[quantity.column]
        axes.plot(1e3 * history["time_s"], values, **style)


def _top(reference: History | None, start: float) -> float:
    """Film that is drawn [µm]: the start of an initial value problem would hide the rest."""
    assert reference is not None
    time = reference["time_s"]
    later = time >= (BUILD_UP * time[-1] if start > 0 else 0.0)
    return 1.15 * FILM.factor * float(reference[FILM.column][later].max())


def draw_errors(study: StudyData, rows: Sequence[StudyRow]) -> Figure | None:
    """Relative errors of some runs over time, none inside the reference's own error, if any."""
    errors = {
        joint: {row: found for row in rows if (found := joint.errors_over_time(row["run"]))}
        for joint in study.joints
    }
    if not all(errors.values()):
        return None
    figure, panels = joint_panels(study.joints, 3.9)
    for axes, joint, quantity in panels:
        floor = max((row.floor(quantity) for row in joint.measured("methods")), default=0.0)
        _draw_errors(axes, errors[joint], quantity, floor)
        axes.set_xlim(left=1e3 * study.start)
    legend_below(figure)
    return figure


def _draw_errors(
    axes: Axes, errors: dict[StudyRow, History], quantity: Quantity, floor: float
) -> None:
    if floor > 0:
        # Linear up to the first power of ten outside of the band, where ticks begin.
        linear = 10.0 ** np.ceil(np.log10(100 * floor))
        axes.set_yscale("symlog", linthresh=linear, linscale=0.4)
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.axhspan(-100 * floor, 100 * floor, color=FLOOR, linewidth=0, label=FLOOR_LABEL)
    for row, found in errors.items():
        error = found[f"{quantity.key}_error"]
        axes.plot(
            1e3 * found["time_s"],
            100 * np.where(np.abs(error) < floor, np.nan, error),
            color=shade(row),
            linestyle=selection(row)[1],
            label=sized(row),
        )
    axes.axhline(0, color="0.3", linewidth=0.8)
    axes.margins(x=0)
    of = "of the film" if quantity is FILM else "of the reference's peak"
    axes.set(xlabel="time [ms]", ylabel=f"error of {quantity.title}\n[% {of}]")
