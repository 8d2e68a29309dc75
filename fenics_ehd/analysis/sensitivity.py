"""Derivatives of what a run, or its periodic cycle, answers along numbers of its mechanism.

With a number p changed by a share of its scale s to either side the steps of the run are gone
through once more (`Replay`),

    dq/dp = (q(p + eps s) - q(p - eps s)) / (2 eps s).

Runs that choose their steps differ by the noise of their choice, 1e-4 of an extreme at a tolerance
of 1e-4, which is a hundredth of a derivative along 1 %. In the same steps, solved to round-off,
figures are as smooth as the equations. A cycle is gone through until it repeats.

Extremes lie between steps and between nodes of one height: those of cubics with the slopes of
parabolas through three of them, in a cycle across its ends. Curve and slope are continuous, so that
neither jumps where the extreme passes a step or a node, as that of single nodes does, a saw-tooth
along any number whose slopes are wrong by the distance of nodes. A mean is the integral of cubics
through four steps.
"""

from __future__ import annotations

import difflib
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import attrs
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from fenics_ehd.analysis.replay import (
    Course,
    Replay,
    course_of,
    recorded,
    solved_run,
    taken_over,
    with_finer_films,
)
from fenics_ehd.base.columns import split_unit
from fenics_ehd.base.errors import SensitivityError, VerificationError
from fenics_ehd.base.renamed import joint_of_bare_name
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.periodic import repeats
from fenics_ehd.multibody.quantities import joint_row
from fenics_ehd.multibody.trust import integral

#: Change of a number over its scale: differences are off by its square, and friction, whose oil in
#: cavities comes and goes point by point, has a derivative only over such a share.
SHARE = 0.01

#: Of Newton's last update, of a cycle that repeats, and of temperatures that are balanced [K]: what
#: they leave of a difference along `SHARE`. The squeeze velocity has the first over the step: in
#: steps of a degree 1e-6 puts a peak pressure's derivative 0.9 % off, 1e-8 less than 0.01 %.
NEWTON = 1e-8
PERIODICITY = 1e-6
BALANCE = 1e-4

#: Slack in the first two on finer films, which tell by how much a derivative changes.
ROUGHLY = 10.0

#: Cycles at most.
MOST = 40

#: Change of a number, over its scale, with which cycles are built that do not quite repeat.
TINY = 3e-6

#: Change of a count of periods in a cycle that is round-off.
SAME = 1e-9

#: Decimals to which heights of one row are equal, over the width, and turns of one place.
EQUAL = 9

#: Relative difference of values of which either may be the extreme.
LEVEL = 1e-9

#: What a figure is called by, and its sign in `smooth_extreme`; a mean has none.
KINDS = {"max": 1, "min": -1, "mean": 0}


def smooth_extreme(times: np.ndarray, values: np.ndarray, period: float | None, sign: int) -> float:
    """Largest value of ``sign * values`` between the steps, times sign.

    Parameters
    ----------
    times, values
        At the steps, from the start of the run or the cycle, shape (steps,).
    period
        Of a cycle whose last step is its start; None: it does not repeat.
    sign
        1 for a maximum, -1 for a minimum.
    """
    count, k = len(times), int(np.argmax(sign * values))
    near = np.arange(k - 2, k + 3)
    if period is None:
        near = near[(near >= 0) & (near < count)]
    if count < 5 or k in (near[0], near[-1]):
        return float(values[k])
    t = times[near % count] + near // count * (period or 0.0)
    own, here = values[near % count], k - int(near[0])
    # Of parabolas through three points.
    slopes = np.gradient(own, t, edge_order=2)
    ends = np.array([here, here + 1] if slopes[here] * sign > 0.0 else [here - 1, here])
    curve = CubicHermiteSpline(t[ends], own[ends], slopes[ends])
    level = curve.derivative().roots(extrapolate=False)
    # Of a curve that is level everywhere, as that of equal values, they are no numbers.
    level = level[np.isfinite(level)]
    return float(sign * np.max(sign * curve(level), initial=sign * values[k]))


def smooth_mean(times: np.ndarray, values: np.ndarray, period: float | None) -> float:
    """Mean over time; arguments as of `smooth_extreme`."""
    if period is not None:
        # The end of a cycle is its start, too.
        times, values = np.append(0.0, times), np.append(values[-1], values)
    length = times[-1] - times[0]
    return float(integral(times, values[:, None])[0] / length if length else values[-1])


def extreme_around(angle: np.ndarray, height: np.ndarray, values: np.ndarray, sign: int) -> float:
    """Largest value of ``sign * values`` between the places of one height of a film, times sign.

    Parameters
    ----------
    angle, height
        Of the places, shape (k,) [rad], [m].
    values
        There, shape (k,); of equal ones those in the row with most places count.
    sign
        See `smooth_extreme`.
    """
    turn = np.round(angle / (2 * np.pi), EQUAL) % 1.0
    share = np.round(height / np.ptp(height), EQUAL)
    _, row, size = np.unique(share, return_inverse=True, return_counts=True)
    largest = (sign * values).max()
    equal = sign * values >= largest - LEVEL * abs(largest)
    own = np.flatnonzero(row == row[np.argmax(equal * size[row])])
    own = own[np.argsort(turn[own])]
    return smooth_extreme(turn[own], values[own], 1.0, sign)


def look(step: MechanismStep) -> dict[str, float]:
    """Columns of every lubricated joint at a step, by path with unit.

    Extremes over a film are those between its nodes, of the gap too: with the Gauss points between
    them rows are uneven, and where the gap is the same over the width, the extreme would jump from
    one to another.
    """
    found: dict[str, float] = {}
    for joint in step.solution.joints:
        row, (angle, height) = joint_row(joint), joint.nodes.T
        gap = joint.gap[-len(joint.pressure) :]
        row["max_pressure_Pa"] = extreme_around(angle, height, joint.pressure, 1)
        row["min_film_thickness_m"] = extreme_around(angle, height, gap, -1)
        if joint.contact is not None:
            points, pressure = joint.film.points, joint.touch.pressure
            angle, height = points.angle.ravel(), points.height.ravel()
            row["max_contact_pressure_Pa"] = extreme_around(angle, height, pressure, 1)
        found |= {f"joints/{joint.binding.name}/{column}": value for column, value in row.items()}
    return found


@dataclass(frozen=True)
class Figure:
    """An extreme or a mean of a column of one joint.

    Attributes
    ----------
    joint, kind, column
        Kind: ``"max"``, ``"min"`` or ``"mean"``; column with its unit, as in a history.
    """

    joint: str
    kind: str
    column: str

    @property
    def name(self) -> str:
        """As in a summary: ``min_film_thickness_m``, ``mean_friction_power_W``."""
        extreme = self.column.startswith(("max_", "min_"))
        return self.column if extreme else f"{self.kind}_{self.column}"

    def value(self, course: Course) -> float:
        """The figure of a run, or of its last cycle, which has the columns of `look`.

        Raises
        ------
        VerificationError
            It is no finite number.
        """
        values = course.joints[self.joint].columns[self.column]
        times = course.times - course.began
        figure = np.nan
        if self.kind == "mean":
            figure = smooth_mean(times, values, course.period)
        elif np.isfinite(values).all():
            figure = smooth_extreme(times, values, course.period, KINDS[self.kind])
        if not np.isfinite(figure):
            raise VerificationError(
                f"{self.joint}.{self.name} is no finite number in this run: ask for another figure"
            )
        return figure


@dataclass(frozen=True, eq=False)
class Number:
    """A number that a mechanism is made with.

    Attributes
    ----------
    name
        For messages.
    scale
        What a small change of it is a share of, in its unit.
    make
        The mechanism with the number changed by a share of its scale, all else as it was, and the
        time to simulate, or the period, over that of the unchanged one.
    alike
        Whether reduced bodies stay as they are, so that coordinates mean what they did.
    """

    name: str
    scale: float
    make: Callable[[float], tuple[Mechanism, float]]
    alike: bool = True


def settled(course: Course) -> Course:
    """The same run, a periodic one in its own steps until nothing beside a derivative is left.

    Raises
    ------
    PeriodicityError, SolverError
        From the steps, and `PeriodicSolver`.
    """
    if course.search is None:
        return course
    return _again(course, _balanced(course.base.equations.system.mechanism))


def derivatives(
    course: Course,
    number: Number,
    figures: Sequence[Figure],
    *,
    share: float = SHARE,
    finer: bool = False,
) -> dict[Figure, float]:
    """Derivatives of figures along a number, in the steps of a run that is `settled`.

    On films as they are, or with half as many cells again either way, if there are such.

    Raises
    ------
    PeriodicityError, SolverError, SettingsError
        From its steps and `PeriodicSolver`; there is no finer film.
    """
    sides: list[Course] = []
    for sign in (1, -1):
        mechanism, span = number.make(sign * share)
        mechanism = _balanced(with_finer_films(mechanism) if finer else mechanism)
        slack = ROUGHLY if finer else 1.0
        sides.append(_again(course, mechanism, span, number.alike, slack))
    above, below = sides
    return {
        figure: (figure.value(above) - figure.value(below)) / (2 * share * number.scale)
        for figure in figures
    }


def _balanced(mechanism: Mechanism) -> Mechanism:
    """With temperatures that are balanced to `BALANCE`."""
    joints = dict(mechanism.joints)
    for name, joint in mechanism.joints.items():
        if isinstance(joint, LubricatedJoint) and joint.heat is not None:
            joints[name] = replace(joint, heat=attrs.evolve(joint.heat, tolerance=BALANCE))
    return replace(mechanism, joints=joints)


def _again(
    course: Course,
    mechanism: Mechanism,
    span: float = 1.0,
    alike: bool = True,
    slack: float = 1.0,
) -> Course:
    """The steps of a run by another mechanism, in so many times the time."""
    base, search = course.base, course.search
    run = base.with_mechanism(mechanism)
    sizes = {each.equations.system.n + each.equations.responses.size for each in (base, run)}
    alike &= len(sizes) == 1
    tolerance = slack * NEWTON
    if search is None:
        replay = Replay(run, course, tolerance, start=run.state, alike=alike)
        return recorded(replay, float(course.times[-1]) * span, look=look)
    period = search.period * span
    if not alike:
        deque(run.until(period), maxlen=0)
    start = taken_over(base.state, base, run, span) if alike else run.state
    replay = Replay(run, course, tolerance, start=start, alike=alike)
    restarted = search.restarted(replay, period, slack * PERIODICITY, MOST)
    return recorded(replay, period, restarted, look)


def sensitivity(
    history: History,
    make: Callable[..., Mechanism],
    parameters: Mapping[str, float],
    of: Sequence[str],
) -> dict[str, dict[str, float]]:
    """Derivatives of figures of a run from `simulate` along parameters of its mechanism.

    Parameters
    ----------
    history
        Of the run, or of its periodic solution, whose period the parameters leave as it is.
    make
        The mechanism with the same coordinates for parameters by name.
    parameters
        Values that the run was made with, none of them 0.
    of
        Figures: ``big_end.min_film_thickness``, ``mean_friction_power``.

    Returns
    -------
    dict
        By figure, then by parameter.

    Raises
    ------
    InputError
        The history was read from a folder.
    SensitivityError
        There is no such figure, or no derivative along a parameter.
    SolverError
        From the steps.
    """
    course = course_of(solved_run(history))

    def along(name: str, value: float) -> Number:
        if not value:
            raise SensitivityError(f"{name} = 0 says no size of a small change")

        def changed(share: float) -> tuple[Mechanism, float]:
            return make(**{**parameters, name: value * (1.0 + share)}), 1.0

        return Number(name, value, changed)

    numbers = [along(name, value) for name, value in parameters.items()]
    paths = [
        f"joints/{name}/{column}"
        for name, joint in course.joints.items()
        for column in joint.columns
    ]
    figures = {name: figure_of(name, paths) for name in of}
    check_periods(course.base.equations.system.mechanism, course.period, numbers)
    course = settled(course)
    slopes = {each.name: derivatives(course, each, [*figures.values()]) for each in numbers}
    return {
        name: {parameter: own[figure] for parameter, own in slopes.items()}
        for name, figure in figures.items()
    }


def check_periods(mechanism: Mechanism, period: float | None, numbers: Sequence[Number]) -> None:
    """Refuse numbers along which there is no periodic solution.

    Parameters
    ----------
    mechanism, period
        Of the run [s]; None: it is not periodic.
    numbers
        To differentiate along.

    Raises
    ------
    SensitivityError
        Naming what keeps its own period where the cycle's changes, or the other way round.
    """
    if period is None:
        return
    was = repeats(mechanism, period)
    for number in numbers:
        changed, span = number.make(TINY)
        would = repeats(changed, span * period)
        off = [key for key in was if abs(would[key] - was[key]) > SAME * max(1.0, was[key])]
        if off:
            raise SensitivityError(
                f"{number.name}: along it alone {', '.join(off)} would not repeat with the cycle "
                "any more, and no derivative exists: ask along a number that leaves all periods "
                "as they are, or run the scene with both changed together"
            )


def figure_of(name: str, paths: Collection[str]) -> Figure:
    """The figure of a name, ``big_end.min_film_thickness``.

    Its unit may follow the name. A bare name is accepted with a warning if exactly one joint has
    such a quantity.

    Parameters
    ----------
    name
        Of the figure.
    paths
        Of the columns that there are: ``joints/big_end/min_film_thickness_m``.

    Raises
    ------
    SensitivityError
        There is none of that name.
    """
    known: dict[str, dict[str, Figure]] = {}
    for path in paths:
        _, joint, column = path.split("/", 2)
        figures = {figure.name: figure for figure in _figures(joint, column)}
        without_unit = {split_unit(key)[0]: figure for key, figure in figures.items()}
        known.setdefault(joint, {}).update(without_unit | figures)
    if not known:
        raise SensitivityError(f"unknown quantity {name}: no joint is lubricated")
    joint, _, quantity = name.partition(".")
    if quantity in known.get(joint, {}):
        return known[joint][quantity]
    bare_joint = joint_of_bare_name(name, known)
    if bare_joint is not None:
        return known[bare_joint][name]
    bare_name = quantity if joint in known else name
    short = {
        owner: sorted({split_unit(key)[0] for key in figures})
        for owner, figures in known.items()
        if joint == owner or joint not in known
    }
    close = [
        f"{owner}.{match}"
        for owner, names in short.items()
        for match in difflib.get_close_matches(bare_name, names, n=1)
    ]
    every = [f"{owner}.{own}" for owner, names in short.items() for own in names]
    hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(every)}"
    raise SensitivityError(f"unknown quantity {name}: {hint}")


def _figures(joint: str, column: str) -> list[Figure]:
    if column.endswith(("_deg", "_height_m")):  # a place, which may go around or jump
        return []
    kind = column.partition("_")[0]
    kinds = [kind] if kind in KINDS else [*KINDS]
    return [Figure(joint, kind, column) for kind in kinds]
