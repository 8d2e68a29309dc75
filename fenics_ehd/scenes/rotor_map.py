"""Rotor map of a scene: bodies that rotate at the speeds of the map, and forces that act.

All bodies that rotate in the scene rotate at the speeds of the map, or only a body that is chosen
by name. Their drives, by speed, table or torque, are replaced by a constant speed. The times of a
run are not used, and a scene for maps alone needs no duration. Rotating forces
do not act in an equilibrium: unbalances are the excitation of the response, and other rotating
forces are reported in a notice. Heat is balanced at each speed if the scene has a heat balance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import pi, radians
from pathlib import Path

from fenics_ehd.analysis.rotor_map import MapPoint, RotorMap, rotor_map_of
from fenics_ehd.base.arguments import require_class, require_count, require_list, require_number
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import FILM_MESHES
from fenics_ehd.base.progress import SILENT, Progress, chosen_progress
from fenics_ehd.multibody.forces import Force, Unbalance
from fenics_ehd.multibody.joints import Speed, require_body, require_point
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.shaft import require_shaft_point
from fenics_ehd.scenes.build import build
from fenics_ehd.scenes.film_meshes import scenes_on_meshes
from fenics_ehd.scenes.scene import GROUND, Scene, changed, points_of, read_scene

#: Unbalances in kg m by their points, or as forces with a phase each.
Unbalances = Mapping[str, float] | Sequence[Unbalance]


@dataclass(frozen=True)
class RotorPlan:
    """Checked arguments of a rotor map of a scene.

    Attributes
    ----------
    scene
        The scene.
    speeds
        Speeds in ascending order of their absolute values [rad/s].
    rotating
        Names of the bodies that rotate at the speeds of the map.
    unbalances
        Unbalances whose response is computed.
    meshes
        Number of film meshes over which the matrices of small motions are averaged.
    notices
        Notices of rotating forces that are not included.
    """

    scene: Scene
    speeds: tuple[float, ...]
    rotating: tuple[str, ...]
    unbalances: tuple[Unbalance, ...]
    meshes: int
    notices: tuple[str, ...]


def rotor_map(
    scene: Scene | str | Path,
    speeds: Sequence[float | str],
    *,
    of: str = "",
    unbalance: Unbalances | None = None,
    meshes: int = FILM_MESHES,
    progress: Progress | bool = True,
) -> RotorMap:
    """Compute modes, critical speeds, stability limits and unbalance response over the speed.

    Parameters
    ----------
    scene
        Scene as read, or the source of a scene as for `read_scene`. Its drives determine the
        rotating bodies, but not their speeds.
    speeds
        Speeds of one sign, none of them 0 [rad/s], or with a unit: ``"3000 rpm"``.
    of
        Name of the body whose speed is varied; by default all bodies that rotate.
    unbalance
        Magnitudes of unbalances [kg m] by their points, or `Unbalance` forces; by default the
        unbalances of the scene.
    meshes
        Number of film meshes, 1 to 4, over which stiffness and damping are averaged.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which reductions
        and speeds are stages.

    Raises
    ------
    SettingsError
        An argument or the scene cannot be used; the message names it.
    SolverError
        No equilibrium was found at any speed.
    """
    require_class("scene", scene, Scene, str, Path)
    source = scene if isinstance(scene, Scene) else read_scene(scene)
    plan = plan_map(source, speeds, of=of, unbalance=unbalance, meshes=meshes)
    return solve_map(plan, progress=chosen_progress(progress))


def plan_map(
    scene: Scene,
    speeds: Sequence[float | str],
    *,
    of: str = "",
    unbalance: Unbalances | None = None,
    meshes: int = FILM_MESHES,
    option: str = "{}",
) -> RotorPlan:
    """Check the arguments of a rotor map, see `rotor_map`.

    `option` is the form of an argument in messages: ``--{}`` for options of the command.
    """
    require_class("scene", scene, Scene)
    meshes = require_count(option.format("meshes"), meshes, 1, FILM_MESHES)
    require_class(option.format("of"), of, str)
    ordered = _ordered_speeds(speeds, option.format("speeds"))
    for name, joint in scene.films.items():
        if joint.cavitation != "reynolds":
            raise SettingsError(
                f"joints.{name}.cavitation = {joint.cavitation!r}: a rotor map is made of small "
                "motions about equilibria, and stiffness and damping of this film depend on the "
                "frequency: use 'reynolds'"
            )
        for label, supply in joint.supply.items():
            if any(supply.head_radius):
                raise SettingsError(
                    f"joints.{name}.supply.{label}.head_radius = {list(supply.head_radius)} m: a "
                    "rotor map changes the speed, on which the pressure in a drilling depends: "
                    "drop head_radius, and give the pressure at the film"
                )
    rotating = _rotating(scene, of, option.format("of"))
    unbalances = _unbalances(scene, unbalance, rotating, option)
    scene = _with_time(scene, abs(ordered[0]))
    name_of_unbalance = option.format("unbalance")
    notices = tuple(
        f"forces.{name} is left out, because a rotating force is not part of an equilibrium: for "
        f"the response to an unbalance give it the kind 'unbalance', or use {name_of_unbalance}"
        for name, force in scene.forces.items()
        if isinstance(force, Force) and force.left_out_of_equilibrium
        and not isinstance(force, Unbalance)
    )  # fmt: skip
    return RotorPlan(scene, ordered, rotating, unbalances, meshes, notices)


def solve_map(
    plan: RotorPlan,
    *,
    stored: MutableMapping[float, MapPoint] | None = None,
    progress: Progress = SILENT,
    between: Callable[[], None] = lambda: None,
) -> RotorMap:
    """Compute a planned rotor map.

    Parameters
    ----------
    plan
        Checked arguments.
    stored, progress, between
        Known points by speed; progress in which reductions and speeds are stages; and function
        that is called between two speeds, see `rotor_map_of`.
    """
    first, *finer = scenes_on_meshes(plan.scene, plan.meshes)
    machine = build(first, progress=progress)
    mechanisms = [machine.mechanism]
    for scene in finer:
        mechanisms.append(build(scene, bodies=machine.bodies, progress=progress).mechanism)
    makers = [partial(_at_speed, mechanism, plan) for mechanism in mechanisms]
    chart = rotor_map_of(
        makers,
        plan.speeds,
        unbalances=plan.unbalances,
        stored=stored,
        progress=progress,
        between=between,
    )
    return replace(chart, notices=(*plan.notices, *machine.warnings, *chart.notices))


def _at_speed(mechanism: Mechanism, plan: RotorPlan, speed: float) -> Mechanism:
    """Copy of a mechanism whose rotating bodies turn at `speed`, one of the map's speeds [rad/s].

    Forces that do not act in an equilibrium, and torques on the rotating bodies, are left out.
    """
    angles = {name: radians(plan.scene.bodies[name].angle) for name in plan.rotating}
    drives = {name: Speed(speed, angle) for name, angle in angles.items()}
    forces = {
        name: force
        for name, force in mechanism.forces.items()
        if not force.left_out_of_equilibrium and force.turned_body not in plan.rotating
    }
    return replace(mechanism, drives={**mechanism.drives, **drives}, forces=forces)


def _ordered_speeds(speeds: Sequence[float | str], name: str) -> tuple[float, ...]:
    """Speeds of a map, sorted by their absolute values [rad/s]; messages begin with `name`.

    Raises
    ------
    SettingsError
        There is no speed; or a speed is not a finite number, is 0, is repeated, or has another
        sign than the first speed.
    """
    listed = require_list(name, speeds, "speeds [rad/s]")
    values = [require_number(f"{name}[{n}]", v, unit="rad/s") for n, v in enumerate(listed)]
    if not values:
        raise SettingsError(f"{name}: give at least one speed")
    for speed in values:
        if not speed:
            raise SettingsError(
                f"{name}: 0 rad/s has no equilibrium, because a film at rest carries no load: drop "
                "this speed"
            )
        if (speed > 0) != (values[0] > 0):
            raise SettingsError(
                f"{name}: {values[0]:g} and {speed:g} rad/s have different signs: make a map for "
                "each sense of rotation"
            )
    if len(set(values)) < len(values):
        raise SettingsError(f"{name}: a speed is given twice: drop one of them")
    return tuple(sorted(values, key=abs))


def _with_time(scene: Scene, speed: float) -> Scene:
    """The scene; without a duration, a copy that lasts one revolution at a speed [rad/s]."""
    if scene.has_duration:
        return scene
    heated = any(joint.heat is not None for joint in scene.films.values())
    cycle = {"time.periodic": True, "time.period": 2 * pi / speed}
    return changed(scene, cycle if heated else {"time.end": 2 * pi / speed})


def _rotating(scene: Scene, of: str, option: str) -> tuple[str, ...]:
    """Names of the bodies that rotate at the speeds of the map; `of`: name of a chosen body.

    `option` is the name of the argument `of` in messages.

    Raises
    ------
    SettingsError
        No body rotates; or several bodies rotate at different speeds, and none is chosen.
    """
    points = {GROUND: (), **{name: points_of(body) for name, body in scene.bodies.items()}}
    if of:
        require_body(option, of, points)
        if of == GROUND or getattr(scene.bodies[of], "angle", None) is None:
            raise SettingsError(f"{option} = {of!r}: this body cannot rotate")
        return (of,)
    journals = [joint.journal.partition(".")[0] for joint in scene.films.values()]
    candidates = dict.fromkeys([*scene.drives, *(name for name in journals if name != GROUND)])
    driven = {name: scene.speed_of(name) for name in candidates}
    rotating = {name: speed for name, speed in driven.items() if speed}
    # A drive by a table or a torque has no speed in the scene, and a map needs no drive.
    rotating = rotating or dict.fromkeys(scene.drives or candidates, 0.0)
    if not rotating:
        raise SettingsError(
            "no body of the scene has a drive, a speed or a journal of a lubricated joint: name "
            f"the body whose speed is varied with {option}"
        )
    if len(set(rotating.values())) > 1:
        listed = ", ".join(f"{name} ({speed:g} rad/s)" for name, speed in rotating.items())
        raise SettingsError(
            f"bodies rotate at different speeds: {listed}: choose the body whose speed is varied "
            f"with {option}; the other bodies keep their speeds"
        )
    return tuple(rotating)


def _unbalances(
    scene: Scene, unbalance: Unbalances | None, rotating: tuple[str, ...], option: str
) -> tuple[Unbalance, ...]:
    """Unbalances whose response is computed, by default those of the scene.

    `option` is the form of arguments in messages.

    Raises
    ------
    SettingsError
        An unbalance is malformed, a point does not exist, or its body does not rotate at the
        speeds of the map.
    """
    name = option.format("unbalance")
    unbalances: list[Unbalance]
    if unbalance is None:
        unbalances = [force for force in scene.forces.values() if isinstance(force, Unbalance)]
    elif isinstance(unbalance, Mapping):
        unbalances = []
        for point, magnitude in unbalance.items():
            try:
                unbalances.append(Unbalance(point, magnitude))
            except SettingsError as error:
                raise SettingsError(f"{name}[{point!r}]: {error}") from None
    else:
        unbalances = require_list(
            name, unbalance, "Unbalance forces, or magnitudes [kg m] by point"
        )
    points = {GROUND: (), **{name: points_of(body) for name, body in scene.bodies.items()}}
    for each in unbalances:
        require_class(name, each, Unbalance)
        require_point(name, each.point, points)
        require_shaft_point(name, each.point, scene.bodies.get(each.rotates_with))
        if each.rotates_with not in rotating:
            raise SettingsError(
                f"{name} of {each.point}: body {each.rotates_with} does not rotate at the "
                f"speeds of the map, which are those of {', '.join(rotating)}: choose the body of "
                f"the unbalance with {option.format('of')}, or drop the unbalance"
            )
    return tuple(unbalances)
