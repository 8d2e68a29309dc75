"""``fenics-ehd stress``: stresses of the flexible bodies over the last cycle of a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.cli.options import json_option

if TYPE_CHECKING:  # slow to import, and --help does without
    import numpy as np

    from fenics_ehd.multibody.result import Result
    from fenics_ehd.results.replay import Replay
    from fenics_ehd.scenes.scene import Scene

#: Relative difference of the cells around a place above which its stress is said to be unresolved.
LARGEST_SCATTER = 0.2

#: Methods whose basis misses flexibility of the bore.
PARTIAL = ("m1", "m2", "m3")


@click.command()
@click.argument("directory", type=click.Path(file_okay=False))
@click.option(
    "--body", "chosen", multiple=True, help="Flexible body [default: all of them]. Repeatable."
)
@click.option(
    "--damping/--no-damping",
    default=True,
    show_default=True,
    help="Whether stress is that which balances the loads, or that of the deformation alone, "
    "without what the material's damping carries.",
)
@click.option(
    "--complete",
    is_flag=True,
    help="Add the static answer that the basis misses of the films' pressures and of turning: for "
    "m1, m2 and m3, which know a part of it.",
)
@click.option(
    "--model",
    "programs",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False),
    help="A .geo model of the run, a program, which may be run. Repeatable.",
)
@json_option
def stress(
    directory: str,
    chosen: tuple[str, ...],
    damping: bool,
    complete: bool,
    programs: tuple[str, ...],
    as_json: bool,
) -> None:
    """Stresses of flexible bodies over the last cycle of a run.

    DIRECTORY holds a complete run. Parts are meshed and reduced again. Written there are
    stress.json and vtk/BODY_stress.vtu: the largest von Mises stress of a half-range of the stress
    tensor over all pairs of instants, its mean, the largest principal stress.
    """
    from mpi4py import MPI

    import fenics_ehd.scenes.remade_part  # noqa: F401 - PETSc and SLEPc start and end on all ranks
    from fenics_ehd.base.output import to_json, write_whole
    from fenics_ehd.results.run_folder import STRESS

    if MPI.COMM_WORLD.rank:  # one does it all
        return
    if complete and not damping:
        raise click.UsageError("--complete is in balance with the loads: drop --no-damping")
    folder = Path(directory)
    found = _stresses(folder, chosen, damping, complete, programs)
    write_whole(folder / STRESS, to_json(found) + "\n")
    click.echo(to_json(found) if as_json else _report(found, folder))


def _stresses(
    folder: Path,
    chosen: tuple[str, ...],
    damping: bool,
    complete: bool,
    programs: tuple[str, ...],
) -> dict[str, Any]:
    """What ``stress.json`` holds; fields are written on the way."""
    from time import perf_counter

    from fenics_ehd.base.folder import claim
    from fenics_ehd.base.output import require_complete, require_writable, versions
    from fenics_ehd.cli.notices import say_reducing
    from fenics_ehd.plotting.recorded import recorded
    from fenics_ehd.results.load import load_results
    from fenics_ehd.results.run_folder import SCENE_NAME, SERIES, STRESS
    from fenics_ehd.results.stress import cycle_stress, figures, write_fields
    from fenics_ehd.scenes.remade_part import remade_part
    from fenics_ehd.scenes.scene_text import as_stored

    start = perf_counter()
    summary = require_complete(folder)
    require_writable(folder)
    claim(folder, (STRESS, SERIES))
    answer = load_results(folder)
    run = recorded(folder, answer)
    scene = as_stored(folder / SCENE_NAME)
    bodies, skipped = _bodies(scene, run, folder, chosen)
    rows = last_rows(answer)
    instants = _instants(scene, answer, rows)
    say_reducing(bodies)
    found = {}
    for body in bodies:
        part = remade_part(scene, body, run.part(body), programs)
        motion = run.in_equilibrium(body) if damping else run.elastic(body)
        coordinates, amplitudes = (values[rows] for values in motion)
        loads = None
        if complete:
            forces, speeds = run.loads(body)
            loads = forces[rows], speeds[rows]
        result = cycle_stress(
            part.structure, part.body, part.columns, coordinates, amplitudes, loads
        )
        path = folder / "vtk" / f"{body}_stress.vtu"
        write_fields(path, result, instants["time_s"])
        found[body] = {
            "method": part.body.method,
            "modes": part.body.modes,
            "nodes": len(result.nodes),
            **figures(result, instants),
            "fields": str(path.relative_to(folder)),
        }
    return {
        "scene": summary["scene"],
        "cycle": answer.cycle_used,
        "instants": len(instants["time_s"]),
        "damping": damping,
        "complete": complete,
        "bodies": found,
        "skipped": skipped,
        "versions": versions(),
        "wall_time_s": perf_counter() - start,
    }


def last_rows(result: Result) -> slice:
    """Steps of the cycle that the run's figures are of, its start among them where it is one."""
    import numpy as np

    return slice(int(np.searchsorted(result.run.time, result.cycle_start * (1 - 1e-9))), None)


def _bodies(
    scene: Scene, run: Replay, folder: Path, chosen: tuple[str, ...]
) -> tuple[list[str], dict[str, str]]:
    """Bodies with stresses, and why others have none.

    Raises
    ------
    SettingsError
        One that was asked for has none, or none has.
    """
    from fenics_ehd.multibody.flexible_body import FlexibleBody
    from fenics_ehd.multibody.rigid_body import RigidBody
    from fenics_ehd.scenes.scene import GROUND, meshed

    skipped = {}
    names = [name for name in scene.bodies if name != GROUND]
    for name in names:
        body = run.bodies[name]
        if isinstance(body, RigidBody):
            skipped[name] = "it is rigid"
        elif not isinstance(body, FlexibleBody):
            skipped[name] = "it is no part with a mesh"
        elif name not in meshed(scene):
            skipped[name] = "it was read from a file of a reduced body, which has no mesh"
        elif not body.reduced.modes:
            skipped[name] = "it was reduced to a rigid body"
    wanted = list(chosen) or [name for name in names if name not in skipped]
    for name in chosen:
        if name not in names:
            raise SettingsError(f"--body {name}: bodies of this run: {', '.join(names)}")
        if name in skipped:
            raise SettingsError(f"--body {name}: {skipped[name]}")
    if not wanted:
        why = ", ".join(f"{name}: {reason}" for name, reason in skipped.items())
        raise SettingsError(f"{folder}: no body with stresses ({why})")
    return list(dict.fromkeys(wanted)), skipped


def _instants(scene: Scene, result: Result, rows: slice) -> dict[str, np.ndarray]:
    """When the instants are: in the cycle [s], and the angle of the body that counts the turns."""
    import numpy as np

    found = {"time_s": np.asarray(result.run.time)[rows] - result.cycle_start}
    turning = result.bodies.get(scene.time.of)
    if turning is not None and "angle" in turning:
        found[f"{scene.time.of}_angle_deg"] = np.degrees(np.asarray(turning.angle)[rows]) % 360.0
    return found


def _report(found: Mapping[str, Any], folder: Path) -> str:
    """Worst places in a table."""
    lines = [f"{found['scene']}: stresses over {found['instants']} instants ({found['cycle']})"]
    for name, body in found["bodies"].items():
        half, top = body["half_range"], body["largest_principal"]
        about = f"  {name}: {body['method']} with {body['modes']} modes, {body['nodes']} nodes"
        lines += [
            f"{about:56}{'MPa':>9}   cells around",
            *_extreme("half-range, von Mises", half["von_mises_Pa"], half),
            _row("  its mean, von Mises", half["mean_von_mises_Pa"]),
            _row("  its mean, hydrostatic", half["mean_hydrostatic_Pa"]),
            *_extreme("largest principal stress", top["stress_Pa"], top),
            f"    fields in {folder / body['fields']}",
        ]
        if body["method"] in PARTIAL and not found["complete"]:
            lines.append(
                f"    {body['method']} knows a part of what pressures do: --complete adds the rest"
            )
    lines += [f"  {name}: none, {why}" for name, why in found["skipped"].items()]
    return "\n".join([*lines, f"  time {found['wall_time_s']:.1f} s"])


def _row(name: str, value: float, more: str = "") -> str:
    """A stress by its name."""
    return f"    {name:52}{value * 1e-6:9.2f}{more}"


def _extreme(name: str, value: float, found: Mapping[str, Any]) -> list[str]:
    """A stress with what single cells say of it, where and when."""
    ends = found["in_cells_around_Pa"]
    around = " to ".join(f"{end * 1e-6:.1f}" for end in ends)
    place = ", ".join(f"{1e3 * x:.2f}" for x in found["place_m"])
    lines = [_row(name, value, f"   {around}"), f"      at ({place}) mm, {_when(found)}"]
    if ends[1] - ends[0] > LARGEST_SCATTER * abs(value):
        lines.append("      no mesh, or not this one, resolves it: a corner, an edge of a support?")
    return lines


def _when(more: Mapping[str, Any]) -> str:
    """Instants in words."""
    found = []
    for name, values in more.items():
        if name == "time_s":
            factor, unit = 1e3, "ms"
        elif name.endswith("_angle_deg"):
            factor, unit = 1.0, f"deg of {name.removesuffix('_angle_deg')}"
        else:
            continue
        each = values if isinstance(values, list) else [values]
        found.append(" and ".join(f"{factor * value:.2f}" for value in each) + f" {unit}")
    return ", ".join(found)
