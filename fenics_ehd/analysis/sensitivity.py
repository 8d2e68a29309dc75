"""Derivatives of extremes and means of a run, or of its periodic cycle, along its parameters.

With a parameter p changed by a share of its scale s to either side the steps of the run are taken
once more (`Replay`),

    dq/dp = (q(p + eps s) - q(p - eps s)) / (2 eps s).

Runs that choose their steps differ by the noise of this choice, 1e-4 of an extreme at a tolerance
of 1e-4, which is a hundredth of a derivative along 1 %. In the same steps, solved to round-off,
objectives are as smooth as the equations. A cycle is repeated until it is periodic.

Extremes lie between nodes and between steps (`fenics_ehd.base.extremes`): the largest nodal value
jumps where the peak passes a node, a saw-tooth along any parameter, whose slopes are wrong by the
distance of nodes. A mean is the integral of cubics through four steps.
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
from fenics_ehd.base.errors import SensitivityError, VerificationError
from fenics_ehd.base.extremes import over_time
from fenics_ehd.base.renamed import joint_of_bare_name
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.periodic import repeats
from fenics_ehd.multibody.quantities import joint_row
from fenics_ehd.multibody.trust import integral

#: Change of a parameter over its scale. Differences have errors of its square; friction, whose oil
#: in cavities appears and disappears point by point, has a derivative only over such a share.
SHARE = 0.01

#: Tolerance of Newton's last update. The squeeze velocity has its error over the step: in steps of
#: a degree 1e-6 puts a peak pressure's derivative 0.9 % off, 1e-8 less than 0.01 %.
NEWTON = 1e-8

#: Tolerance of a periodic cycle, as a share of the gaps.
PERIODICITY = 1e-6

#: Tolerance of balanced temperatures [K].
BALANCE = 1e-4

#: Factor of the first two tolerances on finer films, which show by how much a derivative changes.
ROUGHLY = 10.0

#: Largest number of cycles.
MOST = 40

#: Change of a parameter, over its scale, with which a mechanism is built to compare its periods.
TINY = 3e-6

#: Change of a number of periods in a cycle that is round-off.
SAME = 1e-9

#: Kinds of objectives by the prefix of their names, and the sign of the extreme; a mean has none.
KINDS = {"max": 1, "min": -1, "mean": 0}


def smooth_mean(times: np.ndarray, values: np.ndarray, period: float | None) -> float:
    """Mean of a curve over time.

    Parameters
    ----------
    times, values
        Times of the steps from the start of the run or the cycle [s], and values, shape (steps,).
    period
        Period of a cycle whose last step is its start [s]; None: the curve is not periodic.
    """
    if period is not None:
        # The end of a cycle is its start, too.
        times = np.append(0.0, times)
        values = np.append(values[-1], values)
    length = times[-1] - times[0]
    return float(integral(times, values[:, None])[0] / length if length else values[-1])


def columns_of(step: MechanismStep) -> dict[str, float]:
    """Columns of every lubricated joint at a step, by path with unit."""
    return {
        f"joints/{joint.binding.name}/{column}": value
        for joint in step.solution.joints
        for column, value in joint_row(joint).items()
    }


@dataclass(frozen=True)
class Objective:
    """An extreme or a mean of a column of one joint.

    Attributes
    ----------
    joint
        Name of the joint.
    kind
        ``"max"``, ``"min"`` or ``"mean"``.
    column
        Name with its unit, as in a history.
    """

    joint: str
    kind: str
    column: str

    @property
    def name(self) -> str:
        """As in a summary: ``min_film_thickness_m``, ``mean_friction_power_W``."""
        extreme = self.column.startswith(("max_", "min_"))
        return self.column if extreme else f"{self.kind}_{self.column}"

    def value(self, trajectory: Trajectory) -> float:
        """Value for a run, or its last cycle, whose trajectory has the columns of `columns_of`.

        Raises
        ------
        VerificationError
            It is no finite number.
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
                f"{self.joint}.{self.name} is no finite number in this run: ask for another one"
            )
        return result


@dataclass(frozen=True, eq=False)
class Parameter:
    """A number that a mechanism is made with.

    Attributes
    ----------
    name
        For messages.
    scale
        Number, in the unit of the parameter, that changes are shares of.
    make
        Returns the mechanism with the parameter changed by a share of its scale, and the time to
        simulate, or the period, over that of the unchanged mechanism.
    same_coordinates
        Whether reduced bodies stay as they are, so that coordinates keep their meaning.
    """

    name: str
    scale: float
    make: Callable[[float], tuple[Mechanism, float]]
    same_coordinates: bool = True


def settled(trajectory: Trajectory) -> Trajectory:
    """The run in its own steps, its periodic cycle repeated until only round-off is left.

    Raises
    ------
    PeriodicityError, SolverError
        From the steps, and `PeriodicSolver`.
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
    """Derivatives of objectives along a parameter, in the steps of a run that is `settled`.

    Parameters
    ----------
    trajectory
        Trajectory of the run.
    parameter, objectives
        To differentiate along, and to differentiate.
    share
        Change of the parameter to either side over its scale.
    finer
        Whether films have half as many cells again in both directions.

    Raises
    ------
    PeriodicityError, SolverError, SettingsError
        From the steps and `PeriodicSolver`; there is no finer film.
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
    """The mechanism with temperatures that are balanced to `BALANCE`."""
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
    """Steps of a run taken by another mechanism.

    Parameters
    ----------
    trajectory, mechanism
        Trajectory of the run, and mechanism that repeats its steps.
    span
        Time to simulate, or period, over that of the run.
    same_coordinates
        See `Parameter`.
    slack
        Factor of the tolerances.
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
) -> dict[str, dict[str, float]]:
    """Derivatives of objectives of a run from `simulate` along parameters of its mechanism.

    Parameters
    ----------
    history
        History of the run, or of its periodic solution, whose period must not depend on the
        parameters.
    make
        Returns the mechanism with the same coordinates for parameters by name.
    parameters
        Values that the run was made with, none of them 0.
    of
        Objectives: ``big_end.min_film_thickness``, ``mean_friction_power``.

    Returns
    -------
    dict
        Derivatives by objective, then by parameter.

    Raises
    ------
    InputError
        The history was read from a folder.
    SensitivityError
        There is no such objective, or no derivative along a parameter.
    SolverError
        From the steps.
    """
    trajectory = trajectory_of(solved_run(history))

    def parameter(name: str, value: float) -> Parameter:
        if not value:
            raise SensitivityError(
                f"parameters: {name} = 0 has no size that a small change could be a share of: give "
                "a value other than 0"
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
    trajectory = settled(trajectory)
    slopes = {each.name: derivatives(trajectory, each, [*objectives.values()]) for each in along}
    return {
        name: {parameter: values[objective] for parameter, values in slopes.items()}
        for name, objective in objectives.items()
    }


def check_periods(
    mechanism: Mechanism, period: float | None, parameters: Sequence[Parameter]
) -> None:
    """Refuse parameters along which there is no periodic solution.

    Parameters
    ----------
    mechanism, period
        Mechanism and period of the run [s]; None: the run is not periodic.
    parameters
        To differentiate along.

    Raises
    ------
    SensitivityError
        Naming what keeps its own period although the cycle's changes, or the other way round.
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
                f"{parameter.name}: along it alone {', '.join(off)} would not repeat with the "
                "cycle any more, and no derivative exists: ask along a parameter that does not "
                "change any period, or run the scene with both changed together"
            )


def objective_of(name: str, paths: Collection[str]) -> Objective:
    """Objective of a name, ``big_end.min_film_thickness``.

    Its unit may follow the name. A bare name is accepted with a warning if exactly one joint has
    such a quantity.

    Parameters
    ----------
    name
        Name of the objective.
    paths
        Paths of the columns of a run: ``joints/big_end/min_film_thickness_m``.

    Raises
    ------
    SensitivityError
        There is none of that name.
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
    """Objectives of a column: none of a position, which may jump or go around."""
    if column.endswith(("_deg", "_height_m")):
        return []
    kind = column.partition("_")[0]
    kinds = [kind] if kind in KINDS else [*KINDS]
    return [Objective(joint, kind, column) for kind in kinds]
