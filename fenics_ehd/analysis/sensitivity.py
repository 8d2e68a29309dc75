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
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import attrs
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from fenics_ehd.analysis.replay import (
    Course,
    CourseRecorder,
    Replay,
    course_of,
    grids_of,
    recorded,
    solved_run,
    taken_over,
    with_finer_films,
)
from fenics_ehd.base.columns import split_unit
from fenics_ehd.base.errors import SensitivityError
from fenics_ehd.multibody.energy import integral
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import FilmPlace, Mechanism, System
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.periodic import Cycles, repeats
from fenics_ehd.multibody.quantities import JointPlaces, JointStep, joint_row
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.tabulated import derivative_weights

#: Change of a number over its scale: differences are off by its square, and friction, whose oil in
#: cavities comes and goes point by point, has a derivative only over such a share.
SHARE = 0.01

#: Of Newton's last update, of a cycle that repeats, and of temperatures that are balanced [K]: what
#: they leave of a difference along `SHARE`. The squeeze velocity has the first over the step: in
#: steps of a degree 1e-6 puts a peak pressure's derivative 0.9 % off, 1e-8 less than 0.01 %.
NEWTON, PERIODICITY, BALANCE = 1e-8, 1e-6, 1e-4

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
    rising = _slope(t, own, here) * sign
    ends = np.array([here, here + 1] if rising > 0.0 else [here - 1, here])
    curve = CubicHermiteSpline(t[ends], own[ends], [_slope(t, own, i) for i in ends])
    level = curve.derivative().roots(extrapolate=False)
    return float(sign * np.max(sign * curve(level), initial=sign * values[k]))


def _slope(times: np.ndarray, values: np.ndarray, i: int) -> float:
    """At a point, of the parabola through it and its neighbours."""
    middle = min(max(i, 1), len(times) - 2)
    order = [i, *(j for j in (middle - 1, middle, middle + 1) if j != i)]
    return float(derivative_weights(times[order]) @ values[order])


def smooth_mean(times: np.ndarray, values: np.ndarray, period: float | None) -> float:
    """Mean over time; arguments as of `smooth_extreme`."""
    if period is not None:
        # The end of a cycle is its start, too.
        times, values = np.append(0.0, times), np.append(values[-1], values)
    length = times[-1] - times[0]
    return float(integral(times, values[:, None])[0] / length if length else values[-1])


class Rows:
    """Places around a film, in rows of one height.

    Parameters
    ----------
    angle, height
        Of the places, shape (k,) [rad], [m].
    width
        Of the film [m].
    """

    def __init__(self, angle: np.ndarray, height: np.ndarray, width: float):
        self._turn = np.round(angle / (2 * np.pi), EQUAL) % 1.0
        self._row, size = np.unique(
            np.round(height / width, EQUAL), return_inverse=True, return_counts=True
        )[1:]
        self._size = size[self._row]

    def extreme(self, values: np.ndarray, sign: int) -> float:
        """Largest of ``sign * values``, shape (k,), times sign; of equal ones in the finest row."""
        largest = (sign * values).max()
        equal = sign * values >= largest - LEVEL * abs(largest)
        row = np.flatnonzero(self._row == self._row[np.argmax(equal * self._size)])
        row = row[np.argsort(self._turn[row])]
        return smooth_extreme(self._turn[row], values[row], 1.0, sign)


class JointRows:
    """Columns of one lubricated joint at a step, extremes over the film between nodes.

    Parameters
    ----------
    system, place
        The joint.
    """

    def __init__(self, system: System, place: FilmPlace):
        film = place.film.film
        grid, points = film.parameters.grid, film.points
        angles, heights = grid.node_positions.T
        self._places, self._count = JointPlaces(system, place), points.angle.size
        self._nodes = Rows(angles, heights, grid.width)
        self._points = Rows(points.angle.ravel(), points.height.ravel(), grid.width)

    def columns(self, step: MechanismStep, i: int, gap: np.ndarray) -> dict[str, float]:
        """At an accepted step, of the film of this number, its gap where it is observed.

        Gaps are taken at the nodes: with the Gauss points between them rows are uneven, and where
        the gap is the same over the width, the extreme would jump from one to another.
        """
        own = step.solution.integrals[i]
        found = joint_row(JointStep(self._places, step, own, gap))
        found["max_pressure_Pa"] = self._nodes.extreme(own.state.pressure, 1)
        found["min_film_thickness_m"] = self._nodes.extreme(gap[self._count :], -1)
        if own.contact is not None:
            found["max_contact_pressure_Pa"] = self._points.extreme(own.touch.pressure, 1)
        return found


@dataclass(frozen=True, eq=False)
class Record:
    """A run that has ended.

    Attributes
    ----------
    run
        At its end.
    course
        Of it, or of its last cycle, with the columns of `look`.
    cycles
        None of a run that is not periodic.
    """

    run: Run
    course: Course
    cycles: Cycles | None

    @property
    def period(self) -> float | None:
        """Period of a cycle that repeats [s]."""
        return None if self.cycles is None else self.cycles.period

    @property
    def times(self) -> np.ndarray:
        """Times of the steps, from the start of the run or of the cycle [s]."""
        return self.course.times - self.course.began


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

    def value(self, record: Record) -> float:
        """The figure of a run."""
        values = record.course.joints[self.joint].columns[self.column]
        if self.kind == "mean":
            return smooth_mean(record.times, values, record.period)
        return smooth_extreme(record.times, values, record.period, KINDS[self.kind])


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


def look(run: Run) -> Callable[[MechanismStep], dict[str, float]]:
    """Reader of the columns of every lubricated joint of a run at a step, by path with unit."""
    system = run.equations.system
    rows = {place.name: JointRows(system, place) for place in system.films}

    def columns(step: MechanismStep) -> dict[str, float]:
        gaps = run.norm.film_gaps(step.observed)
        return {
            f"joints/{name}/{column}": value
            for i, (name, own) in enumerate(rows.items())
            for column, value in own.columns(step, i, gaps[i]).items()
        }

    return columns


def first_columns(run: Run, end: float) -> dict[str, dict[str, np.ndarray]]:
    """Columns of the joints of a run to an end [s], by joint and name, at its first step."""
    recorder, step = CourseRecorder(run), next(run.until(end))
    recorder.add(step, row=look(run)(step))
    return {name: joint.columns for name, joint in recorder.course().joints.items()}


def followed(run: Run, end: float, cycles: Cycles | None = None) -> Record:
    """A run to its end [s], or through a periodic search."""
    return Record(run, recorded(run, end, cycles, look(run)), cycles)


def settled(record: Record) -> Record:
    """The same run, a periodic one in its own steps until nothing beside a derivative is left.

    Raises
    ------
    PeriodicityError, SolverError
        From the steps, and `Cycles`.
    """
    if record.period is None:
        return record
    return _again(record, _balanced(record.run.equations.system.mechanism))


def derivatives(
    record: Record,
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
        From its steps and `Cycles`; there is no finer film.
    """
    sides: list[Record] = []
    for sign in (1, -1):
        mechanism, span = number.make(sign * share)
        mechanism = _balanced(with_finer_films(mechanism) if finer else mechanism)
        slack = ROUGHLY if finer else 1.0
        sides.append(_again(record, mechanism, span, number.alike, slack))
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
    record: Record,
    mechanism: Mechanism,
    span: float = 1.0,
    alike: bool = True,
    slack: float = 1.0,
) -> Record:
    """The steps of a record by another mechanism."""
    base, course = record.run, record.course
    run = base.with_mechanism(mechanism)
    sizes = [each.equations.system.n + each.equations.responses.size for each in (base, run)]
    alike &= sizes[0] == sizes[1]
    longer = span * record.times[-1] / (course.times[-1] - course.began)
    replay = Replay(run, course, slack * NEWTON, span=longer, grids=grids_of(base), alike=alike)
    if record.cycles is None:
        return followed(replay, float(record.times[-1]) * span)
    period = record.cycles.period * span
    if alike:
        replay.state = taken_over(base.state, base, run, span)
    else:
        for _ in run.until(period):
            pass
        replay.state = run.state
    # Of the search for its own cycle nothing is left but where it is.
    before = round(replay.state.time / period)
    cycles = Cycles(replay, period, slack * PERIODICITY, before + MOST)
    cycles.number = before + 1
    if cycles.heat and record.cycles.heat:
        known = record.cycles.heat.state.searches
        cycles.heat.state = replace(cycles.heat.state, searches=known)
    return followed(replay, period, cycles)


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
    solved = solved_run(history)

    def along(name: str, value: float) -> Number:
        if not value:
            raise SensitivityError(f"{name} = 0 says no size of a small change")

        def changed(share: float) -> tuple[Mechanism, float]:
            return make(**{**parameters, name: value * (1.0 + share)}), 1.0

        return Number(name, value, changed)

    numbers = [along(name, value) for name, value in parameters.items()]
    record = Record(solved.run, course_of(solved), solved.cycles)
    columns = {name: joint.columns for name, joint in record.course.joints.items()}
    figures = {name: figure_of(name, columns) for name in of}
    check_periods(solved.run.equations.system.mechanism, record.period, numbers)
    record = settled(record)
    slopes = {each.name: derivatives(record, each, [*figures.values()]) for each in numbers}
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


def figure_of(name: str, curves: Mapping[str, Iterable[str]]) -> Figure:
    """The figure of a name, ``big_end.min_film_thickness``.

    Its unit may stand behind, and the joint be left out where there is one.

    Raises
    ------
    SensitivityError
        There is none of that name.
    """
    known = {
        f"{figure.joint}.{figure.name}": figure
        for joint, columns in curves.items()
        for column in columns
        for figure in _figures(joint, column)
    }
    alone = len(curves) == 1 and name.partition(".")[0] not in curves
    full = f"{next(iter(curves))}.{name}" if alone else name
    found = [key for key in known if full in (key, split_unit(key)[0])]
    if len(found) == 1:
        return known[found[0]]
    if not known:
        raise SensitivityError(f"unknown quantity {name}: no joint is lubricated")
    short = sorted(split_unit(key)[0] for key in known)
    if alone:
        short = [key.partition(".")[2] for key in short]
    close = difflib.get_close_matches(name, short, n=1)
    hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(short)}"
    raise SensitivityError(f"unknown quantity {name}: {hint}")


def _figures(joint: str, column: str) -> list[Figure]:
    if column.endswith(("_deg", "_height_m")):  # a place, which may go around or jump
        return []
    kind = column.partition("_")[0]
    if kind in KINDS:
        return [Figure(joint, kind, column)]
    return [Figure(joint, kind, column) for kind in KINDS]
