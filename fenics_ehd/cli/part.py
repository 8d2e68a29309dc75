"""``fenics-ehd part``: conversion of drawings and foreign meshes to models for scenes.

Imports inside functions: ``--help`` must not import Gmsh, PETSc and reductions, which is slow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import attrs
import click
from click.core import ParameterSource

from fenics_ehd.base.errors import MeshError, SettingsError
from fenics_ehd.base.needs import Needs
from fenics_ehd.base.settings import build, toml_string
from fenics_ehd.base.shared_settings import Material
from fenics_ehd.cli.options import (
    Real,
    Whole,
    aligned,
    answer,
    json_option,
    option,
    output_option,
    question,
    setting_options,
    warn_of,
)

if TYPE_CHECKING:  # the import is slow, and --help must be fast
    from fenics_ehd.fem.drawn_part import NamedFaces, OpenedPart, PlacedPart

UNITS = ("m", "cm", "mm", "um", "in")

#: Largest number of faces that are listed in one row each; more are grouped by size.
MOST_LISTED = 60

#: Largest number of ranges of face numbers that a row of grouped faces shows.
MOST_RUNS = 6

#: Condition of the options that matter only when a model is written.
WRITTEN = (Needs(("target",)),)


@question("How does a drawing or a mesh become a flexible body?")
@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "--bore",
    "bores",
    multiple=True,
    metavar="[NAME=]FACE",
    help="Lubricated bore: number of its face, or its radius, 22.5mm. Repeatable; the centre of "
    "the first bore becomes the origin, its axis becomes z.",
)
@option(
    "--point",
    "points",
    multiple=True,
    metavar="[NAME=]FACE",
    help="Boundary point, named 'pin' if no name is given. Repeatable; x points from the first "
    "bore to the first point.",
    needs=WRITTEN,
)
@option("--held", metavar="FACE,...", help="Numbers of the clamped faces.", needs=WRITTEN)
@click.option(
    "--unit",
    type=click.Choice(UNITS),
    help="Length unit of the file. [default: m for meshes, the unit in the file for drawings]",
)
@click.option(
    "--angle",
    type=Real(1.0, 90.0),
    default=35.0,
    show_default=True,
    help="Angle of an edge that separates two faces of a mesh, at least [degrees].",
)
@option(
    "--cells-around",
    "around",
    type=Whole(min=8),
    default=40,
    show_default=True,
    help="Number of cells around each bore in the mesh of a drawing.",
    needs=WRITTEN,
)
@setting_options(Material, needs=WRITTEN)
@option(
    "--check/--no-check",
    default=True,
    help="Also compute the mass and the mesh error of the model.",
    needs=WRITTEN,
)
@output_option("target", "File of the model to write, rod.msh.", folder=False)
@json_option
def part(
    file: str,
    bores: tuple[str, ...],
    points: tuple[str, ...],
    held: str | None,
    unit: str | None,
    angle: float,
    around: int,
    check: bool,
    target: str | None,
    as_json: bool,
    **material: float,
) -> None:
    """List the faces of FILE, or convert it to a model for scenes.

    FILE is a drawing (STEP, IGES) or a mesh of tetrahedra or hexahedra (Gmsh, Abaqus,
    CalculiX, Nastran and other formats of meshio). Without -o the faces are listed with their
    numbers. With -o and --bore a .msh file is written, in metres and with the bore's axis along z.
    Values of the material that no option gives are read from FILE, if it has a material.
    """
    from mpi4py import MPI

    import fenics_ehd.base.petsc_start  # noqa: F401 - collective: every rank starts PETSc
    from fenics_ehd.fem.drawn_part import open_part, place_part
    from fenics_ehd.fem.foreign_mesh import part_material

    if MPI.COMM_WORLD.rank:  # the other ranks have nothing to do
        return
    if (target is None) != (not bores):
        raise click.UsageError("give both -o FILE.msh and --bore FACE to write a model")
    build(Material, material)  # raises an error if a value is outside its limits
    chosen = {name: value for name, value in material.items() if _on_command_line(name)}
    if target is not None and Path(target).suffix != ".msh":
        raise SettingsError(f"-o {target}: the name of a model must end with .msh")
    opened = open_part(Path(file), unit, angle)
    warn_of(opened.notices)
    if target is None:
        faces = faces_listed(opened)
        table = "\n".join([face_table(faces), *_left_out(opened)])
        answer({"file": file, "faces": faces, "left_out": opened.left_out}, table, as_json)
        return
    part_of, replaced = part_material(opened.materials, unit or "m", chosen, file)
    warn_of(replaced)
    _require_target(target, file)
    placed = place_part(opened, _named(opened, bores, points, held), around).quadratic()
    figures = model_figures(target, opened, placed, part_of, around)
    figures["material_from"] = _material_from(opened, chosen)
    figures |= _write_model(target, opened, placed, part_of, around if check else 0)
    figures |= _verdict(figures)
    if placed.size < 1:
        warn_of(
            [
                f"{target} has {around / placed.size:.0f} cells around its bores: with {around} "
                "cells, some were inside out"
            ]
        )
    if figures["verdict"] == "refuse":
        warn_of([f"{target}: the mesh should not be used: {figures['verdict_reason']}"])
    answer(figures, "\n".join([made_table(figures), *_left_out(opened)]), as_json)


def _verdict(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of the verdict on a mesh: word, reason, and size of the mesh to try next.

    The size is a number of cells around the bores of a drawing, or the ratio of cell sizes of a
    foreign mesh.
    """
    from fenics_ehd.reduction.mesh_error import mesh_verdict

    error = figures.get("flexibility_mesh_error")
    verdict = mesh_verdict(figures["worst_cell"], error if isinstance(error, float) else None)
    entries: dict[str, Any] = {"verdict": verdict.word, "verdict_reason": verdict.reason}
    if "cells_around" in figures:
        entries["next_cells_around"] = 2 * ceil(0.5 * verdict.ratio * figures["cells_around"])
    else:
        entries["next_cell_size"] = 1.0 / verdict.ratio
    if verdict.next_error is not None:
        entries["next_mesh_error"] = verdict.next_error
    return entries


def _require_target(target: str, file: str) -> None:
    """Refuse a path of the model that would replace another file, or whose folder does not exist.

    Raises
    ------
    InputError
        The path is refused by `require_output`, or its folder does not exist.
    """
    from fenics_ehd.base.files import require_output
    from fenics_ehd.fem.models import MODEL_KIND

    require_output(target, MODEL_KIND, [file])
    if not Path(target).absolute().parent.is_dir():
        raise SettingsError(f"-o {target}: folder {Path(target).parent} does not exist: create it")


def model_figures(
    target: str, opened: OpenedPart, placed: PlacedPart, material: Material, around: int
) -> dict[str, Any]:
    """Figures of a model for JSON and tables: cells, bores, points and material."""
    from fenics_ehd.fem.solid import corner_volumes

    cells_around = {"cells_around": around / placed.size} if opened.drawn else {}
    return {
        "file": target,
        "cells": placed.solid.kind,
        "number_of_cells": len(placed.solid.cells),
        "worst_cell": float(corner_volumes(placed.solid).min()),
        **cells_around,
        "bores": {
            name: {"radius_m": opened.radius(number), "moved_m": placed.moved[name]}
            for name, number in placed.named.bores.items()
        },
        "points": list(placed.named.points),
        "clamped": "held" if placed.named.held else "none",
        "material": attrs.asdict(material),
        "material_from": "",
        "left_out": opened.left_out,
    }


def _write_model(
    target: str, opened: OpenedPart, placed: PlacedPart, material: Material, checked: int
) -> dict[str, Any]:
    """Write a model; if `checked` is not 0, also estimate its mesh error, see `_checked`.

    `checked` is the number of cells around a bore.

    Returns
    -------
    dict
        Figures of the check, see `_checked`; empty if the model is not checked.

    Raises
    ------
    MeshError
        The model is not a valid part; the message has its path.
    """
    from fenics_ehd.base.files import written_aside
    from fenics_ehd.fem.drawn_part import write_part
    from fenics_ehd.fem.models import mark_model, store_material

    figures: dict[str, Any] = {}
    try:
        with written_aside(Path(target)) as aside:
            write_part(aside, placed.solid, placed.surfaces())
            store_material(aside, material)
            mark_model(aside)
            if checked:
                figures = _checked(opened, placed, aside, checked / placed.size, material)
    except MeshError as error:
        raise MeshError(str(error).replace(str(aside), target)) from None
    return figures


def _on_command_line(option: str) -> bool:
    """True if the user gave the option on the command line."""
    source = click.get_current_context().get_parameter_source(option)
    return source is not ParameterSource.DEFAULT


def _material_from(opened: OpenedPart, chosen: Mapping[str, float]) -> str:
    """Name of the material in the file, if at least one of its values is used; else empty."""
    if opened.materials and set(opened.materials[0].values) - set(chosen):
        return opened.materials[0].name
    return ""


def _left_out(opened: OpenedPart) -> list[str]:
    """List of one line that names the contents of a file besides its solid; empty without any."""
    return [f"left out of the file: {opened.left_out}"] if opened.left_out else []


def _pairs(entries: Sequence[str], default: str, option: str) -> dict[str, str]:
    """Split the values ``[NAME=]FACE`` of an option; return the texts FACE by the texts NAME.

    A value without NAME gets the name `default`.
    """
    faces: dict[str, str] = {}
    for entry in entries:
        name, _, face = entry.rpartition("=")
        name = name or default
        if not name.isidentifier() or name in ("part", "held"):
            raise SettingsError(
                f"{option} {entry}: {name!r} cannot be the name of a surface: use letters, digits "
                "and _, and neither 'part' nor 'held'"
            )
        if name in faces:
            raise SettingsError(
                f"{option} {entry}: {name!r} names two faces: give each its own name, NAME=FACE"
            )
        faces[name] = face
    return faces


def _named(
    opened: OpenedPart, bores: Sequence[str], points: Sequence[str], held: str | None
) -> NamedFaces:
    """Numbers of the faces that options name; a name or number that is repeated is refused."""
    from fenics_ehd.fem.drawn_part import NamedFaces

    named = NamedFaces(
        {n: opened.face(f, ("bore",)) for n, f in _pairs(bores, "bore", "--bore").items()},
        {n: opened.face(f) for n, f in _pairs(points, "pin", "--point").items()},
        [opened.face(text.strip()) for text in held.split(",")] if held else (),
    )
    if set(named.bores) & set(named.points):
        raise SettingsError(
            "--point: a bore has the same name as a point: give the point another name, NAME=FACE"
        )
    numbers = [number for faces in named.all().values() for number in faces]
    twice = sorted({number for number in numbers if numbers.count(number) > 1})
    if twice:
        raise SettingsError(f"face {twice[0]} is given twice: give each face one name only")
    return named


def _checked(
    opened: OpenedPart, placed: PlacedPart, path: Path, around: float, material: Material
) -> dict[str, Any]:
    """Figures of a model: mass, number of unknowns, and mesh error of the bores' flexibility.

    The error is estimated from a second mesh, and also stored in the file of the model. The second
    mesh of a drawing is finer, or coarser if a finer mesh has too many unknowns. The second mesh of
    a foreign mesh has eight cells in place of each cell. `around` is the number of cells around the
    bores of a drawing at a relative cell size of 1.
    """
    from tempfile import TemporaryDirectory

    from fenics_ehd.fem.drawn_part import place_part, write_part
    from fenics_ehd.fem.models import store_mesh_error
    from fenics_ehd.fem.structure import part_responses
    from fenics_ehd.reduction.mesh_error import FINER, MOST_REFINED
    from fenics_ehd.reduction.reductor import rigid
    from fenics_ehd.scenes.part import missed

    bores = tuple(placed.named.bores)
    points = tuple(placed.named.points)
    clamped = "held" if placed.named.held else None
    structure, answers = part_responses(path, material, bores, clamped, points=points)
    figures: dict[str, Any] = {
        "mass_kg": rigid(structure).inertia.total_mass,
        "degrees_of_freedom": structure.size,
    }
    small = structure.size <= MOST_REFINED
    if not (opened.drawn or small):
        return figures | {"flexibility_mesh_error": "not estimated", "second_mesh": "none"}
    if opened.drawn:
        other = place_part(opened, placed.named, around, 1.0 / FINER if small else FINER)
    else:
        other = placed.refined()
    with TemporaryDirectory() as folder:
        file = Path(folder, "other.msh")
        write_part(file, other.solid, other.surfaces())
        other_answers = part_responses(file, material, bores, clamped, points=points)
    errors, moved = missed(structure, answers, *other_answers)
    error = max(errors.values())
    store_mesh_error(path, bores, points, error, material.youngs_modulus * moved)
    return figures | {
        "flexibility_mesh_error": error,
        "flexibility_mesh_error_by_pattern": errors,
        "second_mesh": "finer" if small else "coarser",
    }


def faces_listed(opened: OpenedPart) -> list[dict[str, Any]]:
    """Figures of every face: number, kind, area, cylinder, axis and centre."""
    rows = []
    for number, face in enumerate(opened.faces, 1):
        row: dict[str, Any] = {"number": number, "kind": face.kind, "area_m2": face.area}
        if face.cylinder is not None:
            row |= {
                "radius_m": face.cylinder.radius,
                "width_m": face.cylinder.width,
                "arc_degrees": 360 * min(face.arc, 1.0),
                "deviation_m": face.cylinder.deviation,
            }
        row |= {"axis": face.axis.tolist(), "centre_m": face.centre.tolist()}
        rows.append(row)
    return rows


def face_table(faces: Sequence[dict[str, Any]]) -> str:
    """Printed table of faces in millimetres; in long lists faces of equal size share a row."""
    rows = [
        ["face", "kind", "radius", "width", "around", "area", "axis or normal", "centre"],
        ["", "", "[mm]", "[mm]", "[deg]", "[mm2]", "", "[mm]"],
    ]
    grouped = len(faces) > MOST_LISTED
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for face in faces:
        alike = _size_columns(face) if grouped else (str(face["number"]),)
        groups.setdefault(alike, []).append(face)
    rows += [_face_row(group) for group in groups.values()]
    lines = aligned(rows, words=(0, 1, 6, 7) if grouped else (1, 6, 7))
    if grouped:
        lines.append(f"{len(faces)} faces, faces of equal size in one row: --json lists every face")
    return "\n".join(lines)


def _size_columns(face: dict[str, Any]) -> tuple[str, ...]:
    """Printed cells of a face: kind, radius, width, angle around the cylinder, area."""
    area = f"{face['area_m2'] * 1e6:.2f}"
    if "radius_m" not in face:
        return face["kind"], "", "", "", area
    radius = face["radius_m"] * 1e3
    width = face["width_m"] * 1e3
    return face["kind"], f"{radius:.4f}", f"{width:.3f}", f"{face['arc_degrees']:.0f}", area


def _face_row(group: Sequence[dict[str, Any]]) -> list[str]:
    """Printed row of one face, or of several faces of equal size."""
    first = group[0]
    if len(group) > 1:
        numbers = _ranges([face["number"] for face in group])
        return [numbers, *_size_columns(first), "", f"{len(group)} faces"]
    axis = " ".join(f"{round(value, 3) + 0.0:6.3f}" for value in first["axis"])
    centre = " ".join(f"{round(value * 1e3, 3) + 0.0:.3f}" for value in first["centre_m"])
    return [str(first["number"]), *_size_columns(first), axis, centre]


def _ranges(numbers: Sequence[int]) -> str:
    """Text of ascending numbers, in which consecutive numbers are a range: ``3-7, 9``."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    shown = [f"{low}-{high}" if high > low else str(low) for low, high in runs[:MOST_RUNS]]
    return ", ".join(shown + ["..."] * (len(runs) > MOST_RUNS))


def made_table(figures: dict[str, Any]) -> str:
    """Printed table of a model, and the lines of a scene file that refer to it."""
    kind = {"tet": "10-node tetrahedra", "hex": "20-node hexahedra"}[figures["cells"]]
    lines = [
        f"{figures['file']}: {figures['number_of_cells']} {kind}, worst cell "
        f"{figures['worst_cell']:.3f}"
    ]
    for name, bore in figures["bores"].items():
        lines.append(
            f"  {name}: radius {bore['radius_m'] * 1e3:.6g} mm, nodes moved by "
            f"{bore['moved_m'] * 1e6:.2g} um at most"
        )
    material = figures["material"]
    origin = figures["material_from"]
    lines.append(
        f"  material{f' {origin} of the file' if origin else ''}: "
        f"{material['youngs_modulus'] * 1e-9:.6g} GPa, {material['poissons_ratio']:g}, "
        f"{material['density']:.6g} kg/m3"
    )
    if "mass_kg" in figures:
        error = figures["flexibility_mesh_error"]
        text = error
        if not isinstance(error, str):
            text = f"{100 * error:.2g} %, from a {figures['second_mesh']} mesh"
        lines += [
            f"  mass {figures['mass_kg']:.6g} kg, {figures['degrees_of_freedom']} unknowns",
            f"  mesh error of the bore's flexibility: {text}",
        ]
    lines += _verdict_lines(figures)
    bores = ", ".join(f'"{name}"' for name in figures["bores"])
    points = ", ".join(f'"{name}"' for name in figures["points"])
    lines += [
        "in a scene:",
        f"  model = {toml_string(figures['file'])}",
        f"  bores = [{bores}]",
        f"  points = [{points}]",
        f'  clamped = "{figures["clamped"]}"',
    ]
    return "\n".join(lines)


def _verdict_lines(figures: Mapping[str, Any]) -> list[str]:
    """Printed lines of the verdict on a mesh, and of the mesh to try next."""
    if "next_cells_around" in figures:
        size = f"--cells-around {figures['next_cells_around']}"
    else:
        size = f"cells {figures['next_cell_size']:.2g} times as large"
    expected = ""
    if "next_mesh_error" in figures:
        expected = f", for a mesh error of about {100 * figures['next_mesh_error']:.2g} %"
    return [
        f"  mesh: {figures['verdict']} ({figures['verdict_reason']})",
        f"  next size to try: {size}{expected}",
    ]
