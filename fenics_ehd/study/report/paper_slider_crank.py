"""Statements of the paper about the slider-crank: section 4.2, and some of section 6."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from scipy import stats

from fenics_ehd.multibody.recorded_quantities import JointResult
from fenics_ehd.reduction.body import ReducedBody, load_body
from fenics_ehd.study.report.figures import family
from fenics_ehd.study.report.paper_statement import (
    FAILS,
    HOLDS,
    PARTLY,
    WELL,
    Finding,
    MissingRunsError,
    Statement,
    broke_down,
    clearly,
    description,
    ended,
    every,
    listed,
    m2_ahead_of_m1,
    m3_best,
    many_modes,
    near,
    need,
    needs_more,
    of_size,
    paper_m3,
    reference_history,
    runs_of,
    too_stiff,
    verdict,
)
from fenics_ehd.study.report.study_data import JointData, StudyRow

#: Beginning and end of the plateau of the peak pressure [s].
PLATEAU = (6e-3, 8e-3)

#: Number of coordinates of the paper's M2 with 127 modes.
M2_SIZE = 129

#: Columns of M3 with 31 residual modes, as in figure 8; the rule (31)-(32) is judged by these runs.
FEW: dict[str, Any] = {"method": "m3", "pressure_set": "pc2", "residual_modes": 31}

#: Numbers of residual modes that are close to those of the paper's reference.
RICH = (60, 61)

#: Selection of residual modes by (31)-(32) as printed.
LITERAL = "smallest-eigenvalue"

#: Ratio up to which two run times count as equal, because each is measured only once.
EQUAL_TIMES = 1.3


def rich_reference(joint: JointData) -> Finding:
    """Judge M3 with about 60 residual modes of unit pressures by the full interface."""
    unit = {"method": "m3", "pressure_set": "pc1"}
    runs = [row for number in RICH for row in ended(joint, **unit, residual_modes=number)]
    need(runs, "M3 pc1 with 60 residual modes")
    best = min(row.worst_error for row in runs)
    return Finding("; ".join(map(description, runs)), HOLDS if best <= WELL else FAILS)


def m1_stiff(joint: JointData) -> Finding:
    """Judge the pressures of M1 at high loads, with any number of coordinates."""
    return too_stiff(joint, need(ended(joint, method="m1"), "M1"))


def m2_stiff(joint: JointData) -> Finding:
    """Judge the pressures of M2 with 127 modes at high loads."""
    runs = of_size(joint, M2_SIZE, method="m2")
    return too_stiff(joint, need(runs, f"M2 with about {M2_SIZE} coordinates"))


def enough_with_31(joint: JointData) -> Finding:
    """Judge M3 with pressure shapes and 31 residual modes by the best of its selections."""
    runs = need(ended(joint, **FEW), "M3 pc2 with 31 residual modes")
    best = min(row.worst_error for row in runs)
    return Finding("; ".join(map(description, runs)), HOLDS if best <= WELL else FAILS)


def literal_selection(joint: JointData) -> Finding:
    """Compare the printed rule (31)-(32) with other selections of the same number of modes."""
    runs = ended(joint, **FEW)
    others = [row for row in runs if row["selection"] != LITERAL]
    best = min(
        need(others, "M3 pc2 with 31 residual modes, other selections"),
        key=lambda row: row.worst_error,
    )
    rest = "; ".join(map(description, others))
    planned = joint.planned("methods", **FEW, selection=LITERAL)
    literal = need(planned, "M3 pc2 with 31 residual modes, smallest eigenvalues")[0]
    if broke_down(literal):
        return Finding(f"{family(literal)}: {literal['status']}; {rest}", FAILS)
    good = literal.worst_error <= max(WELL, best.worst_error)
    return Finding(f"{description(literal)}; {rest}", HOLDS if good else FAILS)


def quarter_of_m2(joint: JointData) -> Finding:
    """Judge how many coordinates M2 needs for the error of M3 with 31 residual modes."""
    wanted = paper_m3(joint) | {"residual_modes": FEW["residual_modes"]}
    m3 = runs_of(joint, "M3 pc2 with 31 residual modes", **wanted)[0]
    runs = need(ended(joint, method="m2"), "M2")
    good = [row for row in runs if row.worst_error <= m3.worst_error]
    below = [row for row in runs if not good or row["coordinates"] < good[0]["coordinates"]]
    parts = [f"M3 {listed([m3])}"]
    parts += [f"M2 not as good with {_times(below[-1], m3)}"] if below else []
    parts += [f"as good with {_times(good[0], m3)}"] if good else []
    return Finding("; ".join(parts), needs_more(runs, m3.worst_error, 4 * m3["coordinates"]))


def _times(row: StudyRow, other: StudyRow) -> str:
    ratio = row["coordinates"] / other["coordinates"]
    return f"{listed([row])}, {ratio:.1f} times as many"


def one_shape_is_not_enough(joint: JointData) -> Finding:
    """Compare long or short bearing shapes alone with both kinds and as many modes."""
    alone = [
        runs_of(joint, f"M3 {name}", pressure_set=name)[-1] for name in ("pc2-long", "pc2-short")
    ]
    size = max(row["coordinates"] for row in alone)
    within = [row for row in ended(joint, pressure_set="pc2") if row["coordinates"] <= size]
    both = min(need(within, "M3 pc2 with as many modes"), key=lambda row: row.worst_error)
    measured = "; ".join([*map(description, alone), f"both: {description(both)}"])
    return Finding(
        measured, verdict(row.worst_error > max(WELL, 2 * both.worst_error) for row in alone)
    )


def time_grows(joint: JointData) -> Finding:
    """Judge the rank correlation of integration time and number of coordinates."""
    runs = [row for method in ("m1", "m2", "m3") for row in ended(joint, method=method)]
    sizes = {row["coordinates"] for row in runs}
    if len(sizes) < 3:
        raise MissingRunsError("M1, M2 and M3 with three numbers of coordinates")
    order, _ = stats.spearmanr([r["coordinates"] for r in runs], [r["online_s"] for r in runs])
    small = min(sizes)
    large = max(sizes)
    times = [
        np.mean([r["online_s"] for r in runs if r["coordinates"] == n]) for n in (small, large)
    ]
    measured = (
        f"rank correlation {order:.2f} over {len(runs)} runs; {times[0]:.1f} s with {small:.0f} "
        f"coordinates, {times[1]:.1f} s with {large:.0f}"
    )
    grows = times[1] > 1.5 * times[0]
    return Finding(measured, HOLDS if order > 0.7 and grows else PARTLY if order > 0.3 else FAILS)


def m3_fastest(joint: JointData) -> Finding:
    """Judge whether for each run of M1 and M2 some run of M3 is as accurate in less time."""
    rivals = [row for method in ("m1", "m2") for row in ended(joint, method=method)]
    candidates = need(ended(joint, method="m3"), "M3")
    beaten: list[bool | None] = []
    parts = []
    for rival in need(rivals, "M1 or M2"):
        better = [row for row in candidates if row.worst_error <= rival.worst_error]
        quickest = min(better, key=lambda row: row["online_s"], default=None)
        beaten.append(quickest is not None and _faster(quickest, rival))
        time = "none" if quickest is None else f"{quickest['online_s']:.1f} s"
        equal = " (about equal)" if beaten[-1] is None else ""
        name = f"{rival['method'].upper()} with {rival['coordinates']:.0f}"
        parts.append(f"{name} {rival['online_s']:.1f} s, M3 {time}{equal}")
    return Finding("; ".join(parts), verdict(beaten))


def _faster(one: StudyRow, two: StudyRow) -> bool | None:
    """True if run `one` takes less time than run `two`; None if their times count as equal."""
    difference = math.log(two["online_s"] / one["online_s"])
    return clearly(difference > 0, difference, math.log(EQUAL_TIMES))


def independent_numbers(joint: JointData) -> Finding:
    """Compare vibration frequencies of M3's bodies with different numbers of residual modes."""
    folders = {joint.study.folder(row["run"]) for row in ended(joint, method="m3")}
    bodies = [load_body(path) for folder in sorted(folders) for path in folder.glob("body-*.h5")]
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
    numbers = "; ".join(
        f"{n} vibration modes with {', '.join(map(str, sorted(set(map(_static, group)))))} "
        "static ones"
        for n, group in kept.items()
    )
    return Finding(
        f"{numbers}: frequencies equal to {max(gap, 1e-16):.0e}", HOLDS if gap < 1e-6 else FAILS
    )


def _static(body: ReducedBody) -> int:
    """Number of static modes of a body."""
    return body.kinds.count("static")


def best_at_every_size(joint: JointData) -> Finding:
    """Compare M3 with M1 and M2 wherever all three have equally many coordinates."""
    rivals = [every(joint, method=method) for method in ("m1", "m2")]
    sizes = [
        row["coordinates"]
        for row in every(joint, **paper_m3(joint))
        if all(near(runs, row["coordinates"]) for runs in rivals)
    ]
    need(sizes, "M1, M2 and M3 with equally many coordinates")
    return m3_best(joint, tuple(sizes))


def _plateau_of(joint: JointData) -> JointResult:
    """Results of the joint in the reference, at its steps on the plateau."""
    history = reference_history(joint, until=PLATEAU[1])
    inside = (history.time >= PLATEAU[0]) & (history.time <= PLATEAU[1])
    need(list(history.time[inside]), "steps of the reference between 6 and 8 ms")
    return history.each(lambda values: values[inside]).joints[joint.name]


def plateau(joint: JointData) -> Finding:
    """Judge peak pressure and film of the reference between 6 and 8 ms."""
    result = _plateau_of(joint)
    pressure = np.asarray(result.max_pressure)
    film = np.asarray(result.min_film_thickness)
    change = np.ptp(pressure) / pressure.max()
    loss = 1 - film[-1] / film[0]
    falls = bool(np.mean(np.diff(film) < 0) > 0.95)
    measured = (
        f"pressure {1e-6 * pressure.min():.1f} to {1e-6 * pressure.max():.1f} MPa "
        f"({100 * change:.0f} %), film {1e6 * film[0]:.2f} to {1e6 * film[-1]:.2f} µm "
        f"(-{100 * loss:.0f} %)"
    )
    return Finding(measured, verdict([change <= 0.1, falls and loss >= 0.1]))


def peak_at_the_axis(joint: JointData) -> Finding:
    """Judge at which angle of the bore the pressure is highest during the plateau."""
    angles = np.asarray(_plateau_of(joint).max_pressure_angle)
    measured = f"{angles.min():.0f} to {angles.max():.0f} degrees between 6 and 8 ms"
    return Finding(measured, HOLDS if np.abs(angles).max() <= 15 else FAILS)


def smoother_flank(joint: JointData) -> Finding:
    """Judge how far behind the peak, in the widening gap, the pressure has decreased to half."""
    history = reference_history(joint, until=PLATEAU[1])
    film = history.joints[joint.name].film
    angle, height, pressures = map(np.asarray, (film.angle, film.height, film.pressure))
    middle = np.abs(height - height[np.abs(height - height.mean()).argmin()]) < 1e-9
    ring = np.flatnonzero(middle)[np.argsort(angle[middle])]
    flanks = []
    for time in PLATEAU:
        pressure = pressures[np.abs(history.time - time).argmin()][ring]
        ahead = np.roll(pressure, -int(pressure.argmax()))
        step = int(np.argmax(ahead < 0.5 * ahead[0]))
        part = (ahead[step - 1] - 0.5 * ahead[0]) / (ahead[step - 1] - ahead[step])
        flanks.append((step - 1 + part) * 360 / len(ring))
    measured = f"half the peak {flanks[0]:.1f} degrees behind it at 6 ms, {flanks[1]:.1f} at 8 ms"
    return Finding(measured, HOLDS if flanks[1] > 1.1 * flanks[0] else FAILS)


_WELL = f"largest error of both curves at most {100 * WELL:.0f} %"
_TWICE = "at least twice as many coordinates as M3 for 5 % in both curves"
_STIFF = "mean error positive where the reference is above 75 % of its peak"
_SMALLER = "smaller errors of both curves with equally many coordinates"


STATEMENTS = (
    Statement(
        "4.2, fig. 5",
        "M3 with unit pressures, 60 residual and 6 vibration modes can serve as the reference",
        _WELL,
        rich_reference,
    ),
    Statement(
        "4.2, fig. 5",
        "between 6 and 8 ms the peak pressure hardly changes while the film gets thinner",
        "pressure within 10 %, film falling, by 10 % at least",
        plateau,
    ),
    Statement(
        "4.2, fig. 5",
        "the pressure then peaks at about phi = 0",
        "within 15 degrees",
        peak_at_the_axis,
    ),
    Statement(
        "4.2, fig. 5",
        "meanwhile the pressure falls less sharply in the widening gap",
        "at mid-width, half the peak lies 10 % farther behind it at the end",
        smoother_flank,
    ),
    Statement("4.2, fig. 6", "M1 needs many modes", _TWICE, partial(many_modes, method="m1")),
    Statement("4.2, fig. 6", "M1 puts the pressure too high at high loads", _STIFF, m1_stiff),
    Statement("4.2, fig. 7", "M2 needs fewer modes than M1", _SMALLER, m2_ahead_of_m1),
    Statement("4.2, fig. 7", "M2 still needs many modes", _TWICE, partial(many_modes, method="m2")),
    Statement(
        "4.2, fig. 7", "even with 127 modes M2 is too stiff at high pressures", _STIFF, m2_stiff
    ),
    Statement(
        "4.2, fig. 8",
        "with long and short bearing shapes 31 residual modes are enough",
        f"{_WELL}, by one of the selections",
        enough_with_31,
    ),
    Statement(
        "(31)-(32)",
        "the residual modes to keep are those of the smallest eigenvalues",
        "no worse than 5 %, or than the other selections",
        literal_selection,
    ),
    Statement(
        "4.2",
        "M3 needs less than a quarter of M2's modes",
        "coordinates of M2 that give the error of M3 with 31 residual modes, over M3's",
        quarter_of_m2,
    ),
    Statement(
        "4.2",
        "long or short bearing shapes alone do not lead to the reference",
        "either kind: above 5 %, and twice the error of both kinds with no more modes",
        one_shape_is_not_enough,
    ),
    Statement(
        "4.2",
        "the computing time depends strongly on the number of modes",
        "rank correlation above 0.7, half as much time again with the most coordinates",
        time_grows,
    ),
    Statement(
        "4.2",
        "M3 takes less time than M1 and M2 for the same accuracy",
        "for each of their runs a run of M3 that is no worse and faster, by 30 % at least",
        m3_fastest,
    ),
    Statement("6", "M2 follows the interface better than M1", _SMALLER, m2_ahead_of_m1),
    Statement(
        "6",
        "the load-dependent reduction M3 gives the best results of the three",
        f"{_SMALLER}, wherever all three were run",
        best_at_every_size,
    ),
    Statement(
        "6",
        "analytic pressure shapes serve well where the shaft turns about one axis only",
        _WELL,
        enough_with_31,
    ),
    Statement(
        "6",
        "interface modes can be chosen without touching the vibration modes",
        "bodies with different numbers of residual modes have the same vibration frequencies",
        independent_numbers,
    ),
)
