"""Derivatives of extremes and means with respect to parameters, for a run or its periodic cycle.

The steps of the run are repeated (`Replay`) with a parameter p that is larger, and then smaller, by
a fraction eps of its scale s. The derivative of a result q is

    dq/dp = (q(p + eps s) - q(p - eps s)) / (2 eps s).

Runs that choose their own steps would differ by noise of the step control. At a tolerance of 1e-4,
this noise is 1e-4 of an extreme, and a hundredth of the extreme's change if a parameter changes by
1 %. In equal steps that are solved to round-off, the results are as smooth as the equations. A
cycle is repeated until it is periodic.

Extremes are interpolated between nodes and between steps (`fenics_ehd.base.extremes`). The largest
nodal value would jump whenever the peak passes a node: as a function of any parameter it is a
saw-tooth, whose slopes have errors of the order of the node distance. A mean is the integral of
cubic polynomials over the duration; each polynomial passes through the values at four steps.
"""

from __future__ import annotations

import difflib
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import attrs
import numpy as np

from fenics_ehd.analysis.replay import (
    Replay,
    Trajectory,
    recorded,
    solved_run,
    trajectory_of,
    transferred_state,
    with_finer_films,
)
from fenics_ehd.base.columns import split_unit
from fenics_ehd.base.described import Named
from fenics_ehd.base.errors import SensitivityError, VerificationError
from fenics_ehd.base.extremes import over_time
from fenics_ehd.base.progress import Progress, chosen_progress
from fenics_ehd.base.renamed import joint_of_bare_name
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.periodic import repeats
from fenics_ehd.multibody.quantities import joints_row
from fenics_ehd.multibody.trust import integral

#: Change of a parameter over its scale. The error of a difference is of the order of its square.
#: Friction needs a change of this size: the oil in cavities appears and disappears point by point.
SHARE = 0.01

#: Tolerance of Newton's last update. Its error over the step enters the squeeze velocity: with
#: steps of a degree, 1e-6 changes a peak pressure's derivative by 0.9 %, 1e-8 by less than 0.01 %.
NEWTON = 1e-8

#: Tolerance of a periodic cycle, relative to the gaps.
PERIODICITY = 1e-6

#: Tolerance of temperatures from a heat balance [K].
BALANCE = 1e-4

#: Factor on the tolerances `NEWTON` and `PERIODICITY` for finer films, which only show how much a
#: derivative changes.
ROUGHLY = 10.0

#: Largest number of cycles until a cycle is periodic.
MOST = 40

#: Change of a parameter over its scale, with which periods of a mechanism are compared.
TINY = 3e-6

#: Largest relative change of the number of periods in a cycle that is only round-off.
SAME = 1e-9

#: Prefixes of the names of objectives, with the sign of an extreme and 0 for a mean.
KINDS = {"max": 1, "min": -1, "mean": 0}


def smooth_mean(times: np.ndarray, values: np.ndarray, period: float | None) -> float:
    """Mean over time of a curve through the values at steps.

    Parameters
    ----------
    times, values
        Times of the steps since the start of the run or cycle [s], and values at the steps, shape
        (steps,).
    period
        Period of the cycle [s], at whose start the curve has its last value; None if the curve is
        not periodic.
    """
    if period is not None:
        # The start of a cycle has the values of its end.
        times = np.append(0.0, times)
        values = np.append(values[-1], values)
    length = times[-1] - times[0]
    return float(integral(times, values[:, None])[0] / length if length else values[-1])


def columns_of(step: MechanismStep) -> dict[str, float]:
    """Results of every lubricated joint at a step, by the paths of their columns, with units."""
    return joints_row(step.solution.joints, reported=True)


@dataclass(frozen=True)
class Objective:
    """A result that is differentiated: extreme or mean of a column of a joint.

    Attributes
    ----------
    joint
        Name of the joint.
    kind
        ``"max"``, ``"min"`` or ``"mean"``.
    column
        Name of the column of a history, with unit.
    """

    joint: str
    kind: str
    column: str

    @property
    def name(self) -> str:
        """Name of the result in a summary: ``min_film_thickness_m``, ``mean_friction_power_W``."""
        extreme = self.column.startswith(("max_", "min_"))
        return self.column if extreme else f"{self.kind}_{self.column}"

    def value(self, trajectory: Trajectory) -> float:
        """Value of the result over a trajectory, which must have the columns of `columns_of`.

        Raises
        ------
        VerificationError
            The value is not a finite number.
        """
        values = trajectory.joints[self.joint].columns[self.column]
        times = trajectory.times - trajectory.began
        result = np.nan
        if self.kind == "mean":
            result = smooth_mean(times, values, trajectory.period)
        elif np.isfinite(values).all():
            result = over_time(times, values, trajectory.period, KINDS[self.kind])[0]
        if not np.isfinite(result):
            raise VerificationError(
                f"{self.joint}.{self.name} is not finite in this run: choose another result"
            )
        return result


@dataclass(frozen=True, eq=False)
class Parameter:
    """A number on which a mechanism depends, and with respect to which results have derivatives.

    Attributes
    ----------
    name
        Name of the parameter, for messages.
    scale
        Size s of the parameter, in its unit; a relative change c changes the parameter by ``c s``.
    make
        Function of the relative change c. It returns the changed mechanism, and the ratio of its
        end time or period to that of the unchanged mechanism.
    same_coordinates
        Whether coordinates of both mechanisms have the same meaning, because the parameter changes
        no reduced body.
    """

    name: str
    scale: float
    make: Callable[[float], tuple[Mechanism, float]]
    same_coordinates: bool = True


def settled(trajectory: Trajectory) -> Trajectory:
    """Repeat a cycle with the same steps until it is periodic to round-off.

    A trajectory that is not of a cycle is returned unchanged.

    Raises
    ------
    PeriodicityError, SolverError
        A step or the search for the periodic cycle failed.
    """
    if trajectory.search is None:
        return trajectory
    return _repeated(trajectory, _balanced(trajectory.base.equations.system.mechanism))


def derivatives(
    trajectory: Trajectory,
    parameter: Parameter,
    objectives: Sequence[Objective],
    *,
    share: float = SHARE,
    finer: bool = False,
) -> dict[Objective, float]:
    """Derivatives of results with respect to a parameter, from replays of a run's steps.

    Parameters
    ----------
    trajectory
        Trajectory of the run, as `settled` returns it.
    parameter, objectives
        Parameter that is changed, and results that are differentiated.
    share
        Relative change of the parameter, see `Parameter.scale`. The run is repeated with plus and
        minus this change.
    finer
        Whether the films are refined by a factor of 1.5 in both directions.

    Raises
    ------
    PeriodicityError, SolverError, SettingsError
        A step or the search for a periodic cycle failed, or there is no finer film.
    """
    sides: list[Trajectory] = []
    for sign in (1, -1):
        mechanism, span = parameter.make(sign * share)
        mechanism = _balanced(with_finer_films(mechanism) if finer else mechanism)
        slack = ROUGHLY if finer else 1.0
        sides.append(_repeated(trajectory, mechanism, span, parameter.same_coordinates, slack))
    above, below = sides
    return {
        objective: (objective.value(above) - objective.value(below)) / (2 * share * parameter.scale)
        for objective in objectives
    }


def _balanced(mechanism: Mechanism) -> Mechanism:
    """Mechanism whose heat balances have the tolerance `BALANCE`."""
    joints = dict(mechanism.joints)
    for name, joint in mechanism.joints.items():
        if isinstance(joint, LubricatedJoint) and joint.heat is not None:
            joints[name] = replace(joint, heat=attrs.evolve(joint.heat, tolerance=BALANCE))
    return replace(mechanism, joints=joints)


def _repeated(
    trajectory: Trajectory,
    mechanism: Mechanism,
    span: float = 1.0,
    same_coordinates: bool = True,
    slack: float = 1.0,
) -> Trajectory:
    """Repeat the steps of a run, or its periodic cycle, with another mechanism.

    Parameters
    ----------
    trajectory, mechanism
        Trajectory of the run, and mechanism that repeats its steps.
    span
        Ratio of the end time or period of `mechanism` to that of the run.
    same_coordinates
        Whether coordinates have the same meaning as in the run, see `Parameter`.
    slack
        Factor on the tolerances of Newton's method and of the periodicity.
    """
    base = trajectory.base
    search = trajectory.search
    run = base.with_mechanism(mechanism)
    sizes = {each.equations.system.n + each.equations.responses.size for each in (base, run)}
    same = same_coordinates and len(sizes) == 1
    tolerance = slack * NEWTON
    if search is None:
        replay = Replay(run, trajectory, tolerance, start=run.state, same_coordinates=same)
        return recorded(replay, float(trajectory.times[-1]) * span, look=columns_of)
    period = search.period * span
    if not same:
        deque(run.until(period), maxlen=0)
    start = transferred_state(base.state, base, run, span) if same else run.state
    replay = Replay(run, trajectory, tolerance, start=start, same_coordinates=same)
    restarted = search.restarted(replay, period, slack * PERIODICITY, MOST)
    return recorded(replay, period, restarted, columns_of)


def sensitivity(
    history: History,
    make: Callable[..., Mechanism],
    parameters: Mapping[str, float],
    of: Sequence[str],
    *,
    progress: Progress | bool = True,
) -> Named:
    """Derivatives of a run's results with respect to parameters of its mechanism.

    Parameters
    ----------
    history
        History of a run that `simulate` returned. The period of a periodic solution must not
        depend on the parameters.
    make
        Function that returns the mechanism for values of the parameters, which are its keyword
        arguments. The coordinates of the mechanism must not depend on the parameters.
    parameters
        Values of the parameters in the run, by name; none may be 0.
    of
        Names of the results: ``big_end.min_film_thickness``, ``mean_friction_power``.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the
        parameters are a stage.

    Returns
    -------
    Named
        Dictionary of derivatives by result, then by parameter.

    Raises
    ------
    InputError
        The history was read from a folder.
    SensitivityError
        A result does not exist, or it has no derivative with respect to a parameter.
    SolverError
        A step failed.
    """
    trajectory = trajectory_of(solved_run(history))

    def parameter(name: str, value: float) -> Parameter:
        if not value:
            raise SensitivityError(
                f"parameters: {name} = 0 has no size to which a change can be relative: give a "
                "value other than 0"
            )

        def changed(share: float) -> tuple[Mechanism, float]:
            return make(**{**parameters, name: value * (1.0 + share)}), 1.0

        return Parameter(name, value, changed)

    along = [parameter(name, value) for name, value in parameters.items()]
    paths = [
        f"joints/{name}/{column}"
        for name, joint in trajectory.joints.items()
        for column in joint.columns
    ]
    objectives = {name: objective_of(name, paths) for name in of}
    check_periods(trajectory.base.equations.system.mechanism, trajectory.period, along)
    slopes: dict[str, dict[Objective, float]] = {}
    with chosen_progress(progress).stage("sensitivity", 1 + len(along), "repetitions") as stage:
        trajectory = settled(trajectory)
        for each in along:
            stage.add(each.name)
            slopes[each.name] = derivatives(trajectory, each, [*objectives.values()])
    by_result: dict[str, Named] = {}
    for name, objective in objectives.items():
        values = {parameter: slope[objective] for parameter, slope in slopes.items()}
        by_result[name] = Named(values, f"slopes[{name!r}]")
    return Named(by_result, "slopes")


def check_periods(
    mechanism: Mechanism, period: float | None, parameters: Sequence[Parameter]
) -> None:
    """Refuse a parameter that changes the periods of some drives and loads of a cycle, but not all.

    Parameters
    ----------
    mechanism, period
        Mechanism of the run, and its period [s]; None if the run is not periodic.
    parameters
        Parameters to check.

    Raises
    ------
    SensitivityError
        The ratio of the period of the cycle to that of a drive or load depends on a parameter; the
        message names both.
    """
    if period is None:
        return
    before = repeats(mechanism, period)
    for parameter in parameters:
        changed, span = parameter.make(TINY)
        after = repeats(changed, span * period)
        off = [
            key for key in before if abs(after[key] - before[key]) > SAME * max(1.0, before[key])
        ]
        if off:
            raise SensitivityError(
                f"{parameter.name}: if only this parameter changes, {', '.join(off)} no longer "
                "repeats with the cycle, and no derivative exists: choose a parameter that changes "
                "no period, or run the scene again with all periods changed"
            )


def objective_of(name: str, paths: Collection[str]) -> Objective:
    """Result of a run by its name, ``big_end.min_film_thickness``.

    The unit may follow the name. If only one joint has such a quantity, the name of the joint may
    be left out, with a warning.

    Parameters
    ----------
    name
        Name of the result.
    paths
        Paths of the columns in the history of the run: ``joints/big_end/min_film_thickness_m``.

    Raises
    ------
    SensitivityError
        No result has this name; the message suggests another name.
    """
    known: dict[str, dict[str, Objective]] = {}
    for path in paths:
        _, joint, column = path.split("/", 2)
        objectives = {objective.name: objective for objective in _objectives(joint, column)}
        without_unit = {split_unit(key)[0]: objective for key, objective in objectives.items()}
        known.setdefault(joint, {}).update(without_unit | objectives)
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
        owner: sorted({split_unit(key)[0] for key in objectives})
        for owner, objectives in known.items()
        if joint == owner or joint not in known
    }
    close = [
        f"{owner}.{match}"
        for owner, names in short.items()
        for match in difflib.get_close_matches(bare_name, names, n=1)
    ]
    every = [f"{owner}.{match}" for owner, names in short.items() for match in names]
    hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(every)}"
    raise SensitivityError(f"unknown quantity {name}: {hint}")


def _objectives(joint: str, column: str) -> list[Objective]:
    """Results that are made from a column of a joint: its extremes and mean.

    The list is empty for an angle or a height, because these may jump.
    """
    if column.endswith(("_deg", "_height_m")):
        return []
    kind = column.partition("_")[0]
    kinds = [kind] if kind in KINDS else [*KINDS]
    return [Objective(joint, kind, column) for kind in kinds]
