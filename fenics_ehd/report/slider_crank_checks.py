"""Measures of the slider-crank by which the paper's statements are judged."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import stats

from fenics_ehd.reduction import ReducedBody
from fenics_ehd.report.comparisons import m3_best, needs_more, scene_m3, too_stiff
from fenics_ehd.report.needed import MissingRunsError, ended, every, near, need, of_size, runs_of
from fenics_ehd.report.statement import (
    FAILS,
    HOLDS,
    PARTLY,
    WELL,
    Finding,
    clearly,
    listed,
    told,
    verdict,
)
from fenics_ehd.report.study_data import Study, StudyRun
from fenics_ehd.report.style import family

#: Coordinates of the paper's M2 with 127 modes.
M2_SIZE = 129

#: n_r of the paper's M3, and what the rule (31)-(32) is tried with.
FEW: dict[str, Any] = {"method": "m3", "pressure_set": "pc2", "residual_modes": 31}

#: Residual modes of the paper's reference, and those that M1 and M2 with 127 modes stand beside.
RICH = (60, 61)

#: (31)-(32) as printed.
LITERAL = "smallest-eigenvalue"

#: Two single measurements of a time that differ by less than this factor are equal.
EQUAL_TIMES = 1.3


def rich_reference(study: Study) -> Finding:
    """M3 with about 60 residual modes of unit pressures against the full interface."""
    unit = {"method": "m3", "pressure_set": "pc1"}
    runs = [run for number in RICH for run in ended(study, **unit, residual_modes=number)]
    need(runs, "M3 pc1 with 60 residual modes")
    best = min(run.worst_error for run in runs)
    return Finding("; ".join(map(told, runs)), HOLDS if best <= WELL else FAILS)


def m1_stiff(study: Study) -> Finding:
    """M1 at high loads, any number of coordinates."""
    return too_stiff(study, need(ended(study, method="m1"), "M1"))


def m2_stiff(study: Study) -> Finding:
    """M2 with 127 modes at high loads."""
    runs = of_size(study, M2_SIZE, method="m2")
    return too_stiff(study, need(runs, f"M2 with about {M2_SIZE} coordinates"))


def enough_with_31(study: Study) -> Finding:
    """M3 with pressure shapes and 31 residual modes, the best of its selections."""
    runs = need(ended(study, **FEW), "M3 pc2 with 31 residual modes")
    best = min(run.worst_error for run in runs)
    return Finding("; ".join(map(told, runs)), HOLDS if best <= WELL else FAILS)


def literal_selection(study: Study) -> Finding:
    """Rule (31)-(32) to the letter against the other selections of the same number of modes."""
    runs = ended(study, **FEW)
    others = [run for run in runs if run.selection != LITERAL]
    best = min(
        need(others, "M3 pc2 with 31 residual modes, other selections"),
        key=lambda run: run.worst_error,
    )
    rest = "; ".join(map(told, others))
    planned = study.planned(**FEW, selection=LITERAL)
    literal = need(planned, "M3 pc2 with 31 residual modes, smallest eigenvalues")[0]
    if literal.broke_down:
        return Finding(f"{family(literal)}: {literal.status}; {rest}", FAILS)
    good = literal.worst_error <= max(WELL, best.worst_error)
    return Finding(f"{told(literal)}; {rest}", HOLDS if good else FAILS)


def quarter_of_m2(study: Study) -> Finding:
    """Coordinates that M2 needs for the error of M3 with 31 residual modes."""
    wanted = scene_m3(study) | {"residual_modes": FEW["residual_modes"]}
    m3 = runs_of(study, "M3 pc2 with 31 residual modes", **wanted)[0]
    runs = need(ended(study, method="m2"), "M2")
    good = [run for run in runs if run.worst_error <= m3.worst_error]
    below = [run for run in runs if not good or run.coordinates < good[0].coordinates]
    words = [f"M3 {listed([m3])}"]
    words += [f"M2 not as good with {_times(below[-1], m3)}"] if below else []
    words += [f"as good with {_times(good[0], m3)}"] if good else []
    return Finding("; ".join(words), needs_more(runs, m3.worst_error, 4 * m3.coordinates))


def _times(run: StudyRun, other: StudyRun) -> str:
    ratio = run.coordinates / other.coordinates
    return f"{listed([run])}, {ratio:.1f} times as many"


def one_shape_is_not_enough(study: Study) -> Finding:
    """Long or short bearing shapes alone against both with as many modes."""
    alone = [
        runs_of(study, f"M3 {name}", pressure_set=name)[-1] for name in ("pc2-long", "pc2-short")
    ]
    size = max(run.coordinates for run in alone)
    within = [run for run in ended(study, pressure_set="pc2") if run.coordinates <= size]
    both = min(need(within, "M3 pc2 with as many modes"), key=lambda run: run.worst_error)
    words = "; ".join([*map(told, alone), f"both: {told(both)}"])
    return Finding(
        words, verdict(run.worst_error > max(WELL, 2 * both.worst_error) for run in alone)
    )


def time_grows(study: Study) -> Finding:
    """Rank correlation of integration time and number of coordinates."""
    runs = [run for method in ("m1", "m2", "m3") for run in ended(study, method=method)]
    sizes = {run.coordinates for run in runs}
    if len(sizes) < 3:
        raise MissingRunsError("M1, M2 and M3 with three numbers of coordinates")
    order, _ = stats.spearmanr([r.coordinates for r in runs], [r.online_s for r in runs])
    small, large = min(sizes), max(sizes)
    times = [np.mean([r.online_s for r in runs if r.coordinates == n]) for n in (small, large)]
    words = (
        f"rank correlation {order:.2f} over {len(runs)} runs; {times[0]:.1f} s with {small:.0f} "
        f"coordinates, {times[1]:.1f} s with {large:.0f}"
    )
    grows = times[1] > 1.5 * times[0]
    return Finding(words, HOLDS if order > 0.7 and grows else PARTLY if order > 0.3 else FAILS)


def m3_fastest(study: Study) -> Finding:
    """Whether for each run of M1 and M2 some run of M3 is as accurate in less time."""
    rivals = [run for method in ("m1", "m2") for run in ended(study, method=method)]
    own = need(ended(study, method="m3"), "M3")
    beaten, words = [], []
    for rival in need(rivals, "M1 or M2"):
        better = [run for run in own if run.worst_error <= rival.worst_error]
        quickest = min(better, key=lambda run: run.online_s, default=None)
        beaten.append(quickest is not None and _faster(quickest, rival))
        time = "none" if quickest is None else f"{quickest.online_s:.1f} s"
        equal = " (about equal)" if beaten[-1] is None else ""
        name = f"{rival.method.upper()} with {rival.coordinates:.0f}"
        words.append(f"{name} {rival.online_s:.1f} s, M3 {time}{equal}")
    return Finding("; ".join(words), verdict(beaten))


def _faster(one: StudyRun, two: StudyRun) -> bool | None:
    """Whether the first one takes less time; None: one measurement of each cannot tell."""
    difference = math.log(two.online_s / one.online_s)
    return clearly(difference > 0, difference, math.log(EQUAL_TIMES))


def independent_numbers(study: Study) -> Finding:
    """Vibration frequencies of M3's bodies with different numbers of residual modes."""
    ended(study, method="m3")
    bodies = [body for body in study.bodies if body.method == "m3"]
    groups: dict[int, list[ReducedBody]] = {}
    for body in bodies:
        groups.setdefault(body.kinds.count("vibration"), []).append(body)
    kept = {n: group for n, group in groups.items() if n and len(set(map(_static, group))) > 1}
    need(list(kept), "bodies of M3 with different numbers of residual modes")
    gap = max(
        np.abs(body.frequencies[:n] / group[0].frequencies[:n] - 1).max()
        for n, group in kept.items()
        for body in group[1:]
    )
    words = "; ".join(
        f"{n} vibration modes beside {', '.join(map(str, sorted(set(map(_static, group)))))} "
        "static ones"
        for n, group in kept.items()
    )
    return Finding(
        f"{words}: frequencies equal to {max(gap, 1e-16):.0e}", HOLDS if gap < 1e-6 else FAILS
    )


def _static(body: ReducedBody) -> int:
    return body.kinds.count("static")


def best_at_every_size(study: Study) -> Finding:
    """M3 against M1 and M2 wherever all three have equally many coordinates."""
    rivals = [every(study, method=method) for method in ("m1", "m2")]
    sizes = [
        run.coordinates
        for run in every(study, **scene_m3(study))
        if all(near(runs, run.coordinates) for runs in rivals)
    ]
    need(sizes, "M1, M2 and M3 with equally many coordinates")
    return m3_best(study, tuple(sizes))
