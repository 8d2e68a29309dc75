"""``fenics-ehd reduce``: reduction of a part, on any number of ranks."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import attrs
import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import naming, require_output, versions
from fenics_ehd.base.processes import require_alike
from fenics_ehd.base.progress import shown_progress
from fenics_ehd.base.settings import unusual
from fenics_ehd.cli.options import answer, say_reducing, warn_of
from fenics_ehd.reduction.body import (
    BODY_KIND,
    EXPORT_KIND,
    ModeRecord,
    ReducedBody,
    export_npz,
    save_body,
)
from fenics_ehd.reduction.part_files import BASIS_KIND, save_basis
from fenics_ehd.reduction.superelement import DMIG_KIND, OP4_KIND, export_dmig, export_op4
from fenics_ehd.scenes.part import body_counts, elastic_part, kept_entry
from fenics_ehd.scenes.scene import Scene, changed, input_files, meshed, read_scene

#: Scenes by the names of shipped models, which `reduce` accepts without a scene.
SHIPPED = {"conrod": "slider-crank-paper", "housing": "rotor-paper"}

#: Largest number of printed modes in a group of modes that are not coordinates of the body.
SHOWN = 8


def reduce_part(
    part: str,
    path: str,
    scene: str | None,
    cells: str | None,
    basis_path: str | None,
    exports: tuple[str, ...],
    as_json: bool,
    **options: str | float | None,
) -> None:
    """Reduce a part on all ranks; the first rank writes the body.

    `options` are values of the settings in ``[reduction]``, by key. A value of None does not change
    the setting of the scene.
    """
    targets = {form: str(Path(path).with_suffix(f".{form}")) for form in exports}
    outputs = {"-o": path, "--basis": basis_path or ""}
    outputs |= {f"--export {form}": file for form, file in targets.items()}
    _require_outputs(outputs, [scene] if scene else [])
    machine, name = _flexible(part, scene)
    inputs = input_files(scene or "", machine)
    _require_outputs(outputs, inputs)
    key = f"bodies.{name}."
    values = {f"{key}reduction.{word}": value for word, value in options.items()}
    values[f"{key}cells"] = cells
    machine = changed(machine, {k: value for k, value in values.items() if value is not None})
    settings = machine.bodies[name]
    _require_coordinates(exports, settings.reduction.method)
    warn_of(unusual(settings, key))
    require_alike("part, or settings of it,", repr((attrs.asdict(settings), bool(basis_path))))
    element = machine.film_element(name)
    edges = machine.film_edges(name)
    comm = MPI.COMM_WORLD
    start = perf_counter()
    entry = kept_entry(settings, f"bodies.{name}", element, edges, comm, mesh_error=True)
    body = entry.body()
    say_reducing([name] if body is None else [], [] if body is None else [name])
    rod = None
    if body is None or basis_path:
        progress = shown_progress(logs=True)
        with progress.stage(name):
            elastic = elastic_part(
                settings, f"bodies.{name}", element, comm, edges, entry, progress
            )
            start = perf_counter()
            rod = elastic.reduce(mesh_error=True)
        body = rod.body
    seconds = perf_counter() - start
    # Other processes may have written files since the first check.
    _require_outputs(outputs, inputs)
    if basis_path and rod is not None:
        write_basis = partial(save_basis, basis_path, rod.structure, rod.columns)
        _in_place(basis_path, write_basis)
    if MPI.COMM_WORLD.rank:
        return
    _in_place(path, lambda: save_body(body, path))
    for form, target in targets.items():
        _in_place(target, partial(EXPORTS[form], body, target))
    summary = reduction_summary(body, seconds) | {"file": path, "basis_file": basis_path}
    summary |= {"versions": versions(), "part": part, "exports": targets}
    answer(summary, report(body, summary), as_json)


def _flexible(part: str, scene_name: str | None) -> tuple[Scene, str]:
    """Read the scene that has a part; return it with the name of the part's flexible body.

    `part` is the name of the body or the name of its model.

    Raises
    ------
    SettingsError
        No flexible body of the scene has this name or model, or several have it.
    """
    if scene_name is None and part not in SHIPPED:
        raise SettingsError(
            f"part {part!r} is not {' or '.join(SHIPPED)}: for another part give --scene FILE"
        )
    scene = read_scene(scene_name or SHIPPED[part])
    models = {name: scene.bodies[name].model for name in meshed(scene)}
    meant = [name for name, model in models.items() if part in (name, model, Path(model).stem)]
    if len(meant) != 1:
        known = ", ".join(models) or "none"
        raise SettingsError(
            f"part {part!r}: scene {scene.name} has {len(meant)} flexible bodies of that name or "
            f"model, but one is needed: name one of its bodies with a model, {known}"
        )
    return scene, meant[0]


#: Function that writes an export, by its form.
EXPORTS = {"npz": export_npz, "op4": export_op4, "dmig": export_dmig}

#: Kind of the output file of each option.
KINDS = {
    "-o": BODY_KIND,
    "--basis": BASIS_KIND,
    "--export npz": EXPORT_KIND,
    "--export op4": OP4_KIND,
    "--export dmig": DMIG_KIND,
}


def _require_coordinates(exports: Collection[str], method: str) -> None:
    """Refuse a superelement of M4, before the part is reduced.

    Raises
    ------
    SettingsError
        If a superelement of M4 is to be exported.
    """
    wanted = [form for form in exports if form != "npz"]
    if wanted and method == "m4":
        raise SettingsError(
            f"--export {wanted[0]} with method m4: M4 has flexibility without coordinates, which a "
            "superelement cannot have: give --method m1, m2 or m3"
        )


def _require_outputs(outputs: Mapping[str, str], inputs: Collection[str | Path]) -> None:
    """Refuse an output file that cannot be written, or that replaces an input or another output."""
    taken: dict[Path, str] = {}
    for option, file in outputs.items():
        if not file:
            continue
        require_output(file, KINDS[option], inputs, option)
        path = Path(file).resolve()
        if path in taken:
            raise SettingsError(
                f"{option} would write over {shlex.quote(file)}, the file of {taken[path]}: give "
                "the two options different files"
            )
        taken[path] = option


def _in_place(path: str, write: Any) -> None:
    with naming(Path(path)):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        write()


def reduction_summary(body: ReducedBody, seconds: float) -> dict[str, object]:
    """Settings and results of a reduction, for JSON and the printed table.

    `seconds` is the time spent now, on the reduction or on reading the body from the cache [s].
    """
    inertia = body.inertia
    counts = body_counts(body)
    return {
        # Settings come first, so that results replace settings of the same key.
        **{key: text for key, text in body.provenance.items() if key not in counts},
        **body.accuracy,
        "method": body.method,
        "modes": body.modes,
        "frame": body.frame,
        "mass_kg": inertia.total_mass,
        "centre_of_mass_m": float(np.hypot(*inertia.centre_of_mass)),
        "polar_inertia_kg_m2": inertia.polar_inertia,
        "frequencies_Hz": [float(f) for f in body.frequencies],
        "kinds": list(body.kinds),
        "participation": [r.participation for r in body.inventory if not r.dropped][: body.modes],
        "dropped_modes": sum(bool(r.dropped) for r in body.inventory),
        "residual_patterns": body.residual.rank if body.residual else 0,
        "counts": counts,
        "reduction_time_s": seconds,
    }


#: Lines on the accuracy of a reduction by key: factor to the printed unit, and text.
NOTES = {
    "flexibility_followed": (100, "these modes contain {:.4g} % of the bore's flexibility"),
    "flexibility_mesh_error": (100, "mesh error of the bore's flexibility: {:.2g} %"),
    "flexibility_error": (
        100,
        "verified error of the bore's displacement under pressure: at most {:.2g} %",
    ),
    "static_dropped": (1, "{:.0f} static modes dropped as linearly dependent"),
    "static_added": (
        1,
        "{:.0f} residual modes more than requested: their pressures have the same singular value "
        "as the last one",
    ),
}


def report(body: ReducedBody, summary: Mapping[str, Any]) -> str:
    """Printed table of a reduction: main results, and the inventory of modes."""
    inertia = body.inertia
    lines = [
        f"{body.method}: {body.modes} modes of {summary['degrees_of_freedom']} degrees of freedom, "
        f"frame {body.frame}, {summary['reduction_time_s']:.2f} s",
        f"  mass {inertia.total_mass:.4f} kg, centre {summary['centre_of_mass_m'] * 1e3:.2f} mm "
        f"from the bore centre, polar inertia {inertia.polar_inertia:.4g} kg m2",
    ]
    for key, (factor, text) in NOTES.items():
        # If no static mode was dropped or added, the number is not printed.
        if key in body.accuracy and (body.accuracy[key] or not key.startswith("static_")):
            lines.append(f"  {text.format(factor * body.accuracy[key])}")
    lines.append(
        "  factorisations: {part_factorisations}, static solves: {static_solves}, "
        "applications in the eigensolver: {eigensolver_applications}".format_map(summary["counts"])
    )
    lines.append("  number  kind            frequency [Hz]  bore flexibility")
    kept = [r for r in body.inventory if not r.dropped]
    for i, mode in enumerate(kept[: body.modes], 1):
        lines.append(f"  {i:6d}  {_line(mode)}")
    lines += _group("quasi-static patterns", kept[body.modes :])
    lines += _group("dropped", [r for r in body.inventory if r.dropped])
    lines.append(f"  written to {summary['file']}")
    if summary["basis_file"]:
        lines.append(f"  displacement and stress of the part: {summary['basis_file']}")
    lines += [f"  exported to {target}" for target in summary["exports"].values()]
    return "\n".join(lines)


def _group(name: str, modes: list[ModeRecord]) -> list[str]:
    """Printed lines of a group of modes: heading, first modes, and number of modes not shown."""
    if not modes:
        return []
    lines = [f"  {name}: {len(modes)}, {100 * sum(m.participation for m in modes):.3g} %"]
    lines += [f"       -  {_line(mode)}" for mode in modes[:SHOWN]]
    if len(modes) > SHOWN:
        lines.append(f"       -  {len(modes) - SHOWN} more")
    return lines


def _line(mode: ModeRecord) -> str:
    share = f"{100 * mode.participation:14.4f} %"
    return f"{mode.kind:14s}  {mode.frequency:14.1f}  {share}  {mode.dropped}".rstrip()
