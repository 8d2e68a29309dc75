"""``fenics-ehd reduce``: a part to a reduced body, on any number of ranks."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import attrs
import click
import numpy as np
from mpi4py import MPI

from fenics_ehd.commands import rotor
from fenics_ehd.commands.recording import warn
from fenics_ehd.commands.scene_kinds import tables_of
from fenics_ehd.commands.scenes import read_scene, reduce_with_notice
from fenics_ehd.errors import SettingsError
from fenics_ehd.output import require_writable, to_json, versions
from fenics_ehd.reduction import (
    ModeRecord,
    ReducedBody,
    export_exudyn,
    export_matrix_market,
    export_npz,
    save_basis,
    save_body,
    spatial_inertia,
)
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.settings import build
from fenics_ehd.whole_file import naming

if TYPE_CHECKING:
    from fenics_ehd.scenes.part import ReducedPart

#: Polar inertia of the paper's rod, Table 1 [kg m^2].
PAPER_INERTIA = 4e-3

#: Writers of other programs' formats.
EXPORTS: dict[str, Callable[[ReducedBody, str], Path]] = {
    "npz": export_npz,
    "mtx": export_matrix_market,
    "exudyn": export_exudyn,
}

#: Most lines of the inventory for modes that are no coordinates.
SHOWN = 8


def reduce_part(
    part: str,
    path: str,
    scene: str | None,
    cells: str | None,
    basis_path: str | None,
    exports: tuple[str, ...],
    options: Mapping[str, Any],
    as_json: bool,
) -> None:
    """Reduce the part: every rank takes part, the first one writes the body."""
    targets = {form: _export_path(path, form) for form in exports}
    outputs = {"-o": path, "--basis": basis_path or ""}
    _require_outputs(outputs | {f"--export {form}": file for form, file in targets.items()})
    settings = _part_settings(part, scene, cells)
    tables = {**attrs.asdict(settings.reduction), **options}
    reduction: Any = build(type(settings.reduction), tables, "reduction.")
    if "exudyn" in exports and reduction.method in ("m4", "rigid"):
        raise SettingsError(
            f"--export exudyn: not with --method {reduction.method}, Exudyn's reduced body has "
            "coordinates with mass only; use m1, m2, m3 or full"
        )
    settings = attrs.evolve(settings, reduction=reduction)
    warn(settings)
    if isinstance(settings, RotorSettings):
        rod = rotor.reduce_with_notice(settings)
    else:
        rod = reduce_with_notice(settings)
    body = rod.body
    if "exudyn" in exports:
        mass = MassOperator(rod.structure.mass)
        body = replace(body, spatial=spatial_inertia(rod.structure, mass, rod.columns))
    if basis_path:
        _in_place(basis_path, lambda: save_basis(basis_path, rod.structure, rod.columns))
    if MPI.COMM_WORLD.rank:
        return
    _in_place(path, lambda: save_body(rod.body, path))
    for form, target in targets.items():
        _in_place(target, lambda form=form, target=target: EXPORTS[form](body, target))
    summary = reduction_summary(rod, path, basis_path) | {"part": part, "exports": targets}
    click.echo(to_json(summary) if as_json else report(rod.body, summary))


def _part_settings(
    part: str, scene: str | None, cells: str | None
) -> SliderCrankSettings | RotorSettings:
    """Settings of the scene that a part belongs to."""
    if part == "housing":
        if cells == "tet":
            raise SettingsError("--cells tet: housing is meshed with hexahedra only, use hex")
        tables = tables_of(scene, "rotor") if scene else {}
        if tables is None:
            raise SettingsError(f"--scene {scene}: not a rotor scene, housing needs one")
        return rotor.read_settings(scene or "rotor", tables)
    settings = read_scene(scene)[0] if scene else SliderCrankSettings()
    if cells:
        settings = attrs.evolve(settings, rod=attrs.evolve(settings.rod, cells=cells))
    return settings


def _export_path(path: str, form: str) -> str:
    """Beside the body's file, by its name: ``rod.h5`` to ``rod.npz``, ``rod-mtx``, ..."""
    endings = {"npz": ".npz", "mtx": "-mtx", "exudyn": "-exudyn.npz"}
    return str(Path(path).with_suffix("")) + endings[form]


def _require_outputs(outputs: Mapping[str, str]) -> None:
    """Refuse files that cannot be written, or that two options would write."""
    taken: dict[Path, str] = {}
    for option, file in outputs.items():
        if not file:
            continue
        require_writable(file)
        path = Path(file).resolve()
        if path.exists() and path.is_dir() != (option == "--export mtx"):
            wanted = "a file" if path.is_dir() else "a folder"
            raise SettingsError(f"{option} would write {wanted} {shlex.quote(file)}: it is none")
        if path in taken:
            raise SettingsError(
                f"{option} would write over {shlex.quote(file)} of {taken[path]}: choose another "
                "name for one of them"
            )
        taken[path] = option


def _in_place(path: str, write: Any) -> None:
    with naming(Path(path)):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        write()


def reduction_summary(rod: ReducedPart, path: str, basis_path: str | None) -> dict[str, object]:
    """Figures of a reduction."""
    body = rod.body
    inertia = body.inertia
    return {
        # Settings first: what came out of them has the last word on a key of the same name.
        **body.provenance,
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
        "reduction_time_s": rod.seconds,
        "file": path,
        "basis_file": basis_path,
        "versions": versions(),
    }


def report(body: ReducedBody, summary: Mapping[str, Any]) -> str:
    """What was done, and the mode inventory."""
    inertia = body.inertia
    share = 100 * (inertia.polar_inertia / PAPER_INERTIA - 1)
    compared = f" ({share:+.1f} % of the paper's 4e-3)" if summary["part"] == "conrod" else ""
    lines = [
        f"{body.method}: {body.modes} modes of {summary['degrees_of_freedom']} degrees of freedom, "
        f"frame {body.frame}, {summary['reduction_time_s']:.2f} s",
        f"  mass {inertia.total_mass:.4f} kg, centre {summary['centre_of_mass_m'] * 1e3:.2f} mm "
        f"from the bore centre, polar inertia {inertia.polar_inertia:.4g} kg m2{compared}",
    ]
    if "flexibility_followed" in body.accuracy:
        share = 100 * body.accuracy["flexibility_followed"]
        lines.append(f"  these modes follow {share:.4g} % of the bore's flexibility")
    if body.accuracy.get("static_dropped"):
        lines.append(
            f"  {int(body.accuracy['static_dropped'])} static modes dropped as linearly dependent"
        )
    if body.accuracy.get("static_added"):
        lines.append(
            f"  {int(body.accuracy['static_added'])} residual modes more than asked for: their "
            "pressures have the same singular value as the last one"
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
    """Some lines of a long list, and what the rest amounts to."""
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
