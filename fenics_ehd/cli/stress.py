"""Stresses of a run's flexible bodies over its last cycle: computation, storage and report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import (
    claim,
    require_complete,
    require_writable,
    to_json,
    versions,
    write_whole,
)
from fenics_ehd.base.needs import no_effect
from fenics_ehd.base.progress import shown_progress
from fenics_ehd.cli.options import say_reducing
from fenics_ehd.cli.run import share
from fenics_ehd.fem.models import is_shipped
from fenics_ehd.multibody.body import FlexibleBody, MasslessBody
from fenics_ehd.multibody.history import History, load_history
from fenics_ehd.plotting.shown import recorded
from fenics_ehd.results.motion import RecordedMotion
from fenics_ehd.results.recorded_run import SCENE_NAME, SERIES, STRESS
from fenics_ehd.results.stress import (
    COMPONENTS,
    PARTIAL,
    cycle_stress,
    figures,
    stress_errors,
    write_fields,
)
from fenics_ehd.scenes.part import model_file, remade_part
from fenics_ehd.scenes.scene import GROUND, Scene, as_stored, meshed

#: Relative scatter of the stress in the cells around a node, above which it is not resolved.
LARGEST_SCATTER = 0.2


def cycle_stresses(
    folder: Path,
    chosen: tuple[str, ...],
    damping: bool,
    complete: bool,
    programs: tuple[str, ...],
) -> dict[str, Any]:
    """Compute the stresses of bodies, and write the fields and ``stress.json``.

    Parameters
    ----------
    folder
        Folder of a complete run.
    chosen
        Names of bodies; empty for all flexible bodies.
    damping
        Whether the stress of material damping is added to the elastic stress. With it, the stress
        balances the loads.
    complete
        Whether the part of the static response that the basis of the modes lacks is added.
    programs
        Paths of models that are programs, and that the user allows to be executed.

    Returns
    -------
    dict
        Content of ``stress.json``.
    """
    start = perf_counter()
    progress = shown_progress(logs=True)
    summary = require_complete(folder)
    require_writable(folder)
    claim(folder, (STRESS, SERIES))
    answer = load_history(folder).last_cycle()
    run = recorded(folder, answer)
    scene = as_stored(folder / SCENE_NAME)
    bodies, skipped = _bodies(scene, run, folder, chosen)
    _require_models(scene, bodies, programs)
    instants = instants_of(scene, answer)
    by_body = {}
    for body in bodies:
        part = remade_part(scene, body, run.part(body), programs, say_reducing, progress)
        motion = run.in_equilibrium(body) if damping else run.elastic(body)
        loads = run.loads(body) if complete else None
        result = cycle_stress(part.structure, part.body, part.columns, *motion, loads)
        errors = stress_errors(summary, part.body, body, complete)
        path = folder / "vtk" / f"{body}_stress.vtu"
        write_fields(path, result, instants["time_s"])
        by_body[body] = {
            "method": part.body.method,
            "modes": part.body.modes,
            "nodes": len(result.nodes),
            **figures(result, instants, errors),
            "fields": str(path.relative_to(folder)),
        }
    answered = {
        "scene": summary["scene"],
        "cycle": answer.cycle.label,
        "instants": len(instants["time_s"]),
        "damping": damping,
        "complete": complete,
        "bodies": by_body,
        "skipped": skipped,
        "versions": versions(),
        "wall_time_s": perf_counter() - start,
    }
    write_whole(folder / STRESS, to_json(answered) + "\n")
    return answered


def _bodies(
    scene: Scene, run: RecordedMotion, folder: Path, chosen: tuple[str, ...]
) -> tuple[list[str], dict[str, str]]:
    """Names of the bodies whose stresses are computed, and reasons why others have none, by name.

    Raises
    ------
    SettingsError
        A chosen body has no stresses, or no body of the run has stresses.
    """
    names = [name for name in scene.bodies if name != GROUND]
    reasons = {name: _why_none(run.bodies[name], name in meshed(scene)) for name in names}
    skipped = {name: why for name, why in reasons.items() if why}
    for name in chosen:
        if reasons.get(name, "unknown"):
            why = skipped.get(name, f"bodies of this run: {', '.join(names)}")
            raise SettingsError(f"--body {name}: {why}")
    wanted = dict.fromkeys(chosen or [name for name in names if name not in skipped])
    if not wanted:
        listed = ", ".join(f"{name}: {reason}" for name, reason in skipped.items())
        raise SettingsError(f"{folder}: no body of this run has stresses ({listed})")
    return list(wanted), skipped


def _require_models(scene: Scene, bodies: Sequence[str], programs: Sequence[str]) -> None:
    """Refuse a path in `programs` that is not the model of one of the bodies."""
    if not programs:
        return
    models = [model_file(scene.bodies[name], f"bodies.{name}") for name in bodies]
    unnamed = [m for m in models if not any(m.samefile(program) for program in programs)]
    if any(model.suffix == ".geo" and not is_shipped(model) for model in unnamed):
        return  # reading the part refuses its model, with the model's name
    for program in programs:
        if not any(model.samefile(program) for model in models):
            raise no_effect("--model", program, "without a body in the run that has this model")


def _why_none(body: object, has_model: bool) -> str:
    """Reason why a body has no stresses; empty text if it has stresses."""
    if isinstance(body, MasslessBody):
        return "it is rigid"
    if not isinstance(body, FlexibleBody):
        return "it has no mesh"
    if not has_model:
        return "it was read from a file of a reduced body, which has no mesh"
    return "" if body.reduced.modes else "it was reduced to a rigid body"


def instants_of(scene: Scene, result: History) -> dict[str, np.ndarray]:
    """Instants of a history, as arrays by column: times since the start of the cycle [s], angles.

    The angles are those of the scene's reference body [degrees], if it has one.
    """
    instants = {"time_s": result.run.time - result.cycle.start}
    body = scene.time.of
    angle = result.angle_of(body) if f"{body}.angle" in result else None
    if angle is not None:
        instants[f"{body}_angle_deg"] = angle
    return instants


def report(result: Mapping[str, Any], folder: Path) -> str:
    """Printed table of the extreme stresses of every body."""
    lines = [f"{result['scene']}: stresses over {result['instants']} instants ({result['cycle']})"]
    for name, body in result["bodies"].items():
        half = body["half_range"]
        top = body["largest_principal"]
        about = f"  {name}: {body['method']} with {body['modes']} modes, {body['nodes']} nodes"
        lines += [
            f"{about:56}{'MPa':>9}   cells around",
            *_extreme("half-range, von Mises", half["von_mises_Pa"], half),
            _row("  its mean, von Mises", half["mean_von_mises_Pa"]),
            _row("  its mean, hydrostatic", half["mean_hydrostatic_Pa"]),
            *_extreme("largest principal stress", top["stress_Pa"], top),
            f"    fields in {folder / body['fields']}",
        ]
        if body["method"] in PARTIAL and not result["complete"]:
            lines.append(
                f"    {body['method']} does not contain the full static response to pressure: use "
                "--complete"
            )
    lines += [f"  {name}: none, {why}" for name, why in result["skipped"].items()]
    return "\n".join([*lines, f"  time {result['wall_time_s']:.1f} s"])


def _row(name: str, value: float, more: str = "") -> str:
    """Printed row of a stress; `value` is in Pa, the row has it in MPa."""
    return f"    {name:52}{value * 1e-6:9.2f}{more}"


def _extreme(name: str, value: float, extreme: Mapping[str, Any]) -> list[str]:
    """Printed rows of an extreme stress: value, range in the cells around the node, place, time."""
    ends = extreme["in_cells_around_Pa"]
    around = " to ".join(f"{end * 1e-6:.1f}" for end in ends)
    position = ", ".join(f"{1e3 * x:.2f}" for x in extreme["place_m"])
    lines = [
        _row(name, value, f"   {around}"),
        f"      {_bound(extreme['errors'])}",
        f"      at ({position}) mm, {_when(extreme)}",
    ]
    if ends[1] - ends[0] > LARGEST_SCATTER * abs(value):
        lines.append("      not resolved by the mesh: refine it; a sharp corner or edge never is")
    return lines


def _bound(errors: Mapping[str, float | str]) -> str:
    """Text of the error of a stress: the sum, and its components or the reason for none."""
    each = ", ".join(f"{name} {share(errors[name])}" for name in COMPONENTS)
    return f"+- {share(errors['known'])}: {each}"


def _when(extreme: Mapping[str, Any]) -> str:
    """Text with the times of an extreme and the angle of the reference body at these times."""
    words = []
    for name, values in extreme.items():
        body = name.removesuffix("_angle_deg")
        if name == "time_s" or body != name:
            factor, unit = (1e3, "ms") if name == "time_s" else (1.0, f"deg of {body}")
            each = " and ".join(f"{factor * value:.2f}" for value in np.atleast_1d(values))
            words.append(f"{each} {unit}")
    return ", ".join(words)
