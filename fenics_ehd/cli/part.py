"""``fenics-ehd part``: a drawing or a mesh from elsewhere as a model for scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    setting_options,
    warn_of,
)

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.fem.drawn_part import NamedFaces, OpenedPart, PlacedPart

UNITS = ("m", "cm", "mm", "um", "in")

#: Most faces that are listed in a row each.
MOST_LISTED = 60

#: Most runs of numbers in a row of several faces.
MOST_RUNS = 6

#: Of options for the model that is written.
WRITTEN = (Needs(("target",)),)


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "--bore",
    "bores",
    multiple=True,
    metavar="[NAME=]FACE",
    help="Lubricated surface: number of a face, or its radius, 22.5mm. Repeatable; the first is "
    "the origin, its axis z.",
)
@option(
    "--point",
    "points",
    multiple=True,
    metavar="[NAME=]FACE",
    help="Boundary point, 'pin' unless named. Repeatable; x goes from the bore to the first.",
    needs=WRITTEN,
)
@option("--held", metavar="FACE,...", help="Faces that are held.", needs=WRITTEN)
@click.option(
    "--unit",
    type=click.Choice(UNITS),
    help="Of the file's lengths. [default: m for meshes, what a drawing declares]",
)
@click.option(
    "--angle",
    type=Real(1.0, 90.0),
    default=35.0,
    show_default=True,
    help="A face of a mesh ends at an edge as sharp as this [degrees].",
)
@option(
    "--cells-around",
    "around",
    type=Whole(min=8),
    default=40,
    show_default=True,
    help="Cells around the bores of a drawing.",
    needs=WRITTEN,
)
@setting_options(Material, needs=WRITTEN)
@option("--check/--no-check", default=True, help="Also find mass and mesh error.", needs=WRITTEN)
@output_option("target", "Model to write, rod.msh.", folder=False)
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
    """List the faces of FILE, or make it a model that scenes take.

    FILE is a drawing (STEP, IGES) or a mesh of tetrahedra or hexahedra (Gmsh, Abaqus,
    CalculiX, Nastran and what else meshio reads). Without -o its faces are listed with their
    numbers; with it and a --bore a .msh file is written, in metres, the bore's axis along z.
    A deck's material is taken unless another is given.
    """
    from mpi4py import MPI

    import fenics_ehd.base.petsc_start  # noqa: F401 - collective: every rank starts PETSc
    from fenics_ehd.base.files import require_output, written_aside
    from fenics_ehd.fem.drawn_part import open_part, place_part, write_part
    from fenics_ehd.fem.foreign_mesh import part_material
    from fenics_ehd.fem.models import MODEL_KIND, mark_model, store_material
    from fenics_ehd.fem.solid import corner_volumes

    if MPI.COMM_WORLD.rank:  # one does it all
        return
    if (target is None) != (not bores):
        raise click.UsageError("to write a model give both -o FILE.msh and --bore FACE")
    build(Material, material)  # checks it
    given = {name: value for name, value in material.items() if _on_command_line(name)}
    if target is not None and Path(target).suffix != ".msh":
        raise SettingsError(f"-o {target}: a model's name must end with .msh")
    opened = open_part(Path(file), unit, angle)
    warn_of(opened.notices)
    if target is None:
        listed = faces_listed(opened)
        table = "\n".join([face_table(listed), *_left_out(opened)])
        answer({"file": file, "faces": listed, "left_out": opened.left_out}, table, as_json)
        return
    made_of, replaced = part_material(opened.materials, unit or "m", given, file)
    warn_of(replaced)
    require_output(target, MODEL_KIND, [file])
    if not Path(target).absolute().parent.is_dir():
        raise SettingsError(f"-o {target}: there is no folder {Path(target).parent}")
    named = _named(opened, bores, points, held)
    placed = place_part(opened, named, around).quadratic()
    figures: dict[str, Any] = {
        "file": target,
        "cells": placed.solid.kind,
        "number_of_cells": len(placed.solid.cells),
        "worst_cell": float(corner_volumes(placed.solid).min()),
        **({"cells_around": around / placed.size} if opened.drawn else {}),
        "bores": {
            name: {"radius_m": opened.radius(number), "moved_m": placed.moved[name]}
            for name, number in named.bores.items()
        },
        "points": list(named.points),
        "clamped": "held" if named.held else "none",
        "material": attrs.asdict(made_of),
        "material_from": _material_from(opened, given),
        "left_out": opened.left_out,
    }
    try:
        with written_aside(Path(target)) as aside:
            write_part(aside, placed.solid, placed.surfaces())
            store_material(aside, made_of)
            mark_model(aside)
            if check:
                figures |= _checked(opened, placed, aside, around / placed.size, made_of)
    except MeshError as error:
        raise MeshError(str(error).replace(str(aside), target)) from None
    if placed.size < 1:
        warn_of(
            [
                f"{target} has {around / placed.size:.0f} cells around its bores: with {around}, "
                "cells were turned inside out"
            ]
        )
    answer(figures, "\n".join([made_table(figures), *_left_out(opened)]), as_json)


def _on_command_line(option: str) -> bool:
    """True of an option that the user gave."""
    source = click.get_current_context().get_parameter_source(option)
    return source is not ParameterSource.DEFAULT


def _material_from(opened: OpenedPart, given: Mapping[str, float]) -> str:
    """Name of the file's material if any value of it is taken, else empty."""
    if opened.materials and set(opened.materials[0].values) - set(given):
        return opened.materials[0].name
    return ""


def _left_out(opened: OpenedPart) -> list[str]:
    """A line of what the file has besides the solid, if anything."""
    return [f"left out of the file: {opened.left_out}"] if opened.left_out else []


def _pairs(given: Sequence[str], default: str, option: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for entry in given:
        name, _, face = entry.rpartition("=")
        name = name or default
        if not name.isidentifier() or name in ("part", "held"):
            raise SettingsError(f"{option} {entry}: {name!r} is no name for a surface")
        if name in found:
            raise SettingsError(f"{option} {entry}: {name!r} is named twice: NAME=FACE")
        found[name] = face
    return found


def _named(
    opened: OpenedPart, bores: Sequence[str], points: Sequence[str], held: str | None
) -> NamedFaces:
    """Numbers of the faces asked for, none of them twice."""
    from fenics_ehd.fem.drawn_part import NamedFaces

    named = NamedFaces(
        {n: opened.face(f, ("bore",)) for n, f in _pairs(bores, "bore", "--bore").items()},
        {n: opened.face(f) for n, f in _pairs(points, "pin", "--point").items()},
        [opened.face(text.strip()) for text in held.split(",")] if held else (),
    )
    if set(named.bores) & set(named.points):
        raise SettingsError("--point: a bore has that name already: NAME=FACE")
    numbers = [number for faces in named.all().values() for number in faces]
    twice = sorted({number for number in numbers if numbers.count(number) > 1})
    if twice:
        raise SettingsError(f"face {twice[0]} is asked for twice: a face has one name")
    return named


def _checked(
    opened: OpenedPart, placed: PlacedPart, path: Path, around: float, material: Material
) -> dict[str, Any]:
    """Mass, unknowns, and how far the bores' flexibility is from the exact one, left in the file.

    A drawing is meshed again, more finely if that can be paid; a mesh has every cell cut in eight.
    """
    from tempfile import TemporaryDirectory

    from fenics_ehd.fem.drawn_part import place_part, write_part
    from fenics_ehd.fem.models import store_mesh_error
    from fenics_ehd.fem.structure import part_answers
    from fenics_ehd.reduction.mesh_error import FINER, MOST_REFINED
    from fenics_ehd.reduction.reductor import rigid
    from fenics_ehd.scenes.part import missed

    bores = tuple(placed.named.bores)
    points = tuple(placed.named.points)
    clamped = "held" if placed.named.held else None
    structure, answers = part_answers(path, material, bores, clamped, points=points)
    found: dict[str, Any] = {
        "mass_kg": rigid(structure).inertia.total_mass,
        "degrees_of_freedom": structure.size,
    }
    small = structure.size <= MOST_REFINED
    if not (opened.drawn or small):
        return found | {"flexibility_mesh_error": "not estimated", "second_mesh": "none"}
    if opened.drawn:
        other = place_part(opened, placed.named, around, 1.0 / FINER if small else FINER)
    else:
        other = placed.refined()
    with TemporaryDirectory() as folder:
        file = Path(folder, "other.msh")
        write_part(file, other.solid, other.surfaces())
        there = part_answers(file, material, bores, clamped, points=points)
    errors, moved = missed(structure, answers, *there)
    error = max(errors.values())
    store_mesh_error(path, bores, points, error, material.youngs_modulus * moved)
    return found | {
        "flexibility_mesh_error": error,
        "flexibility_mesh_error_by_pattern": errors,
        "second_mesh": "finer" if small else "coarser",
    }


def faces_listed(opened: OpenedPart) -> list[dict[str, Any]]:
    """Every face with what tells it from others."""
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
    """The list in millimetres, equal faces of long lists in one row."""
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
        lines.append(f"{len(faces)} faces, those of equal size in one row: --json lists each")
    return "\n".join(lines)


def _size_columns(face: dict[str, Any]) -> tuple[str, ...]:
    """Kind, radius, width, angle and area of a face as they are printed."""
    area = f"{face['area_m2'] * 1e6:.2f}"
    if "radius_m" not in face:
        return face["kind"], "", "", "", area
    radius = face["radius_m"] * 1e3
    width = face["width_m"] * 1e3
    return face["kind"], f"{radius:.4f}", f"{width:.3f}", f"{face['arc_degrees']:.0f}", area


def _face_row(group: Sequence[dict[str, Any]]) -> list[str]:
    """Row of a face or of several of equal size."""
    first = group[0]
    if len(group) > 1:
        numbers = _ranges([face["number"] for face in group])
        return [numbers, *_size_columns(first), "", f"{len(group)} faces"]
    axis = " ".join(f"{round(value, 3) + 0.0:6.3f}" for value in first["axis"])
    centre = " ".join(f"{round(value * 1e3, 3) + 0.0:.3f}" for value in first["centre_m"])
    return [str(first["number"]), *_size_columns(first), axis, centre]


def _ranges(numbers: Sequence[int]) -> str:
    """Rising numbers, ``3-7, 9``."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    shown = [f"{low}-{high}" if high > low else str(low) for low, high in runs[:MOST_RUNS]]
    return ", ".join(shown + ["..."] * (len(runs) > MOST_RUNS))


def made_table(figures: dict[str, Any]) -> str:
    """Figures of the model, and the lines of a scene that take it."""
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
        told = error
        if not isinstance(error, str):
            told = f"{100 * error:.2g} %, from a {figures['second_mesh']} mesh"
        lines += [
            f"  mass {figures['mass_kg']:.6g} kg, {figures['degrees_of_freedom']} unknowns",
            f"  mesh error of the bore's flexibility: {told}",
        ]
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
