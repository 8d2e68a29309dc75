"""What accuracy costs: error against run time, reduction time and number of coordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes

from fenics_ehd.report.hull import lower_left
from fenics_ehd.report.study_data import NORMS, QUANTITIES, Quantity, Study, StudyRun
from fenics_ehd.report.style import (
    BOUND,
    BOUND_LABEL,
    draw_floor,
    family,
    legend_below,
    line_style,
    percent_axis,
    plain_log_axis,
    save,
    two_panels,
)


@dataclass(frozen=True)
class Cost:
    """What is paid: attribute of a run, its name, whether its lower left hull is marked."""

    attribute: str
    label: str
    hull: bool = True

    def of(self, run: StudyRun) -> float:
        """What a run costs."""
        return float(getattr(run, self.attribute))


ONLINE = Cost("online_s", "time integration [s of processor time]")
OFFLINE = Cost("offline_s", "reduction of the part [s of processor time]")
COORDINATES = Cost("coordinates", "elastic coordinates", hull=False)

#: Runs at other step tolerances than the study's.
SMALL = {"linestyle": "", "alpha": 0.55, "markersize": 4}


#: Closest points of the hull with a label each, in decades.
LABEL_DISTANCE = 0.2

Point = tuple[float, float, StudyRun]


def families(runs: Sequence[StudyRun]) -> dict[str, list[StudyRun]]:
    """Runs that differ only in numbers, by what they have in common."""
    grouped: dict[str, list[StudyRun]] = {}
    for run in sorted(runs, key=lambda run: (run.method, family(run), run.coordinates)):
        grouped.setdefault(family(run), []).append(run)
    return grouped


def draw_cost(study: Study, cost: Cost, folder: Path, name: str, norm: str = "max") -> bool:
    """Error of both curves against a cost, log-log; whether there was anything to draw."""
    groups = ("methods", "tolerance") if cost is ONLINE else ("methods",)
    runs = [run for run in study.group(*groups) if _positive(cost.of(run))]
    if not runs:
        return False
    figure, panels = two_panels(4.4)
    for axes, quantity in zip(panels, QUANTITIES, strict=True):
        percent_axis(axes, f"{NORMS[norm]} error of {quantity.title}")
        plain_log_axis(axes, cost.label)
        if cost.hull:
            _draw_hull(axes, runs, cost, quantity, norm)
        _draw_families(axes, [r for r in runs if r.group == "methods"], cost, quantity, norm)
        _draw_tolerances(axes, [r for r in runs if r.group == "tolerance"], cost, quantity, norm)
        if cost.hull:  # room for its labels on the left
            axes.set_xlim(min(map(cost.of, runs)) / 2.5, 1.3 * max(map(cost.of, runs)))
        draw_floor(axes, max(run.floor(quantity, norm) for run in runs))
    legend_below(figure)
    save(figure, folder, name)
    return True


def _positive(value: float) -> bool:
    return math.isfinite(value) and value > 0


def _draw_families(
    axes: Axes, runs: Sequence[StudyRun], cost: Cost, quantity: Quantity, norm: str
) -> None:
    """Runs at the study's step tolerance, those of a method joined from few modes to many."""
    for label, members in families(runs).items():
        style = line_style(members[0]) | {"linewidth": 1.2}
        points = [(cost.of(run), run.visible_error(quantity, norm)) for run in members]
        seen = [i for i, run in enumerate(members) if not run.bounded(quantity, norm)]
        axes.plot(*zip(*points, strict=True), label=label, markevery=seen, **style)
        _draw_bounds(axes, members, cost, quantity, norm)


def _draw_bounds(
    axes: Axes, runs: Sequence[StudyRun], cost: Cost, quantity: Quantity, norm: str
) -> None:
    """Signs of runs of which only a bound is known: they stand on the edge of the grey band."""
    for run in runs:
        if run.bounded(quantity, norm):
            colour = line_style(run)["color"]
            axes.plot(cost.of(run), run.visible_error(quantity, norm), BOUND, color=colour,
                      label=BOUND_LABEL)  # fmt: skip


def _draw_tolerances(
    axes: Axes, runs: Sequence[StudyRun], cost: Cost, quantity: Quantity, norm: str
) -> None:
    """The same methods at other step tolerances, as small signs."""
    _draw_bounds(axes, runs, cost, quantity, norm)
    for run in runs:
        if run.bounded(quantity, norm):
            continue
        style = line_style(run) | SMALL
        axes.plot(cost.of(run), run.visible_error(quantity, norm), zorder=1.5, **style)
    if runs:
        axes.plot([], [], "o", color="0.5", label="small signs: other step tolerances",
                  markersize=4, alpha=0.55)  # fmt: skip


def _draw_hull(
    axes: Axes, runs: Sequence[StudyRun], cost: Cost, quantity: Quantity, norm: str
) -> None:
    """Runs that no other one beats in both error and cost, with coordinates and tolerance."""
    hull = lower_left([(cost.of(run), run.visible_error(quantity, norm), run) for run in runs])
    axes.plot(
        [x for x, _, _ in hull],
        [y for _, y, _ in hull],
        drawstyle="steps-post",
        color="#33AA55",
        linewidth=5,
        alpha=0.35,
        zorder=1,
        solid_capstyle="round",
        label="lower left hull: nothing is both faster and more accurate",
    )
    usual = {run.order for run in runs if run.group == "methods"}
    for x, y, run in _apart(hull):
        method = family(run).split()[0].rstrip(",")
        words = f"{method}, {run.coordinates:.0f}"
        if cost is ONLINE:
            words += f", {run.tolerance:.0e}".replace("e-0", "e-")
            words += "" if run.order in usual else f", order {run.order:.0f}"
        # Below and to the left of the hull there is nothing by definition.
        label = axes.annotate(words, (x, y), xytext=(-4, -4), textcoords="offset points",
                              fontsize=7.5, ha="right", va="top")  # fmt: skip
        label.set_in_layout(False)


def _apart(hull: Sequence[Point]) -> list[Point]:
    """Points far enough from each other for a label, the more accurate ones first."""
    kept: list[Point] = []
    for point in reversed(hull):
        near = (
            kept
            and math.log10(kept[-1][0] / point[0]) < LABEL_DISTANCE
            and math.log10(point[1] / kept[-1][1]) < LABEL_DISTANCE
        )
        if not near:
            kept.append(point)
    return kept
