"""Elastic parts of a scene: meshed or read from a file, reduced, made again for another mesh.

A part is what its settings name: a Gmsh model or the reduced body of a file. Beside its reduction
stands what it was made from, by which a run's part, whose folder holds neither mesh nor basis, is
made again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import attrs
import numpy as np
from mpi4py import MPI
from scipy import sparse

from fenics_ehd.base.errors import EhdError, MeshError, SettingsError
from fenics_ehd.base.needs import NONE
from fenics_ehd.base.settings import keys_excluded_by
from fenics_ehd.fem.models import check_model, is_shipped, model_path, stored_mesh_error
from fenics_ehd.film.grid import match
from fenics_ehd.film.transfer import interpolation_matrix
from fenics_ehd.multibody.history import FIELDS_NAME
from fenics_ehd.multibody.lubricated_joint import bore_surface, sampling_grid
from fenics_ehd.reduction.body import ReducedBody, load_body
from fenics_ehd.reduction.bore import BoreSurface
from fenics_ehd.reduction.fixed_interface_modes import craig_bampton, two_step_craig_bampton
from fenics_ehd.reduction.load_dependent_basis import (
    full_interface,
    load_dependent,
    proper_orthogonal,
)
from fenics_ehd.reduction.mesh_error import (
    BETWEEN_NODES,
    FINER,
    MOST_REFINED,
    ORDER,
    SMOOTH,
    Answers,
    compliance_errors,
    excess,
    smooth_answers,
)
from fenics_ehd.reduction.reductor import Reductor, rigid
from fenics_ehd.reduction.residual_completion import basis_of, residual_flexibility
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.part_settings import ReductionSettings, method_keys
from fenics_ehd.scenes.scene import Scene, changed, flexible, meshed, renamed

#: Reductions by name, of what, by which settings, and with which options that most have.
METHODS: Mapping[str, Callable[[Reductor, ReductionSettings, Mapping[str, Any]], ReducedBody]] = {
    "m1": lambda part, given, common: craig_bampton(part, given.modes, **common),
    "m2": lambda part, given, common: two_step_craig_bampton(
        part, given.modes, given.interior_modes, **common
    ),
    "m3": lambda part, given, common: load_dependent(
        part,
        given.vibration_modes,
        given.residual_modes,
        given.pressure_set,
        given.selection,
        **common,
    ),
    "m4": lambda part, given, common: residual_flexibility(
        part,
        given.vibration_modes,
        truncation=given.residual_truncation,
        centrifugal=part.free,
        **common,
    ),
    "full": lambda part, given, _: full_interface(part, given.vibration_modes, keep_basis=True),
    "rigid": lambda part, _, common: rigid(part, **common),
}


@dataclass(frozen=True, eq=False)
class ReducedPart:
    """A reduced part, and what only displacement fields need.

    `structure` and `columns`, the part-size basis, stay distributed over the
    ranks that reduced the part.
    """

    body: ReducedBody
    structure: Structure
    columns: np.ndarray
    seconds: float


def model_file(part: schema.FlexibleSettings, section: str) -> Path:
    """The Gmsh model of a part whose settings are in a section of that name.

    Raises
    ------
    SettingsError
        There is no such file.
    MeshError
        It is no model.
    """
    path = Path(part.model) if Path(part.model).suffix else model_path(part.model)
    if not path.is_file():
        raise SettingsError(f"{section}.model = {part.model!r}: there is no file {path}")
    check_model(path)
    return path


def require_snapshots(part: schema.FlexibleSettings, section: str) -> None:
    """Refuse snapshots of a folder that holds no run, before anything is meshed for them.

    Raises
    ------
    SettingsError
        Naming the key of the section.
    """
    folder = part.reduction.snapshots
    if folder != NONE and not Path(folder, FIELDS_NAME).is_file():
        raise SettingsError(
            f"{section}.reduction.snapshots = {folder!r}: no folder of a run, it has no "
            f"{FIELDS_NAME}"
        )


def reduce_structure(part: Structure | Reductor, reduction: ReductionSettings) -> ReducedBody:
    """Apply the method that the settings name, and keep the part-size basis.

    A `Reductor` solves as it was made, whatever `solver` the settings name.
    """
    if isinstance(part, Structure):
        part = Reductor(part, solver=reduction.solver)
    common: dict[str, Any] = {"keep_basis": True, "estimate_error": reduction.estimate_error}
    if reduction.method == "m3" and reduction.snapshots != "none":
        return _trained(part, reduction, common)
    return METHODS[reduction.method](part, reduction, common)


def _trained(
    part: Reductor, reduction: ReductionSettings, common: Mapping[str, Any]
) -> ReducedBody:
    """M3 with the main patterns of a former run's pressures, its accuracy with how many more."""
    asked = reduction.residual_modes
    patterns = proper_orthogonal(_snapshots(part.structure, reduction), asked)
    body = load_dependent(
        part, reduction.vibration_modes, patterns.shape[1], patterns, "every-column", **common
    )
    added = {"static_added": float(max(patterns.shape[1] - asked, 0))}
    return replace(body, accuracy={**body.accuracy, **added})


def _snapshots(structure: Structure, reduction: ReductionSettings) -> np.ndarray:
    """Pressures of a former run, shape (k, steps) [Pa]."""
    if len(structure.bores) > 1:
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r}: a run's pressures are those of one "
            f"bore, the part has {', '.join(structure.bores)}"
        )
    from fenics_ehd.multibody.history import load_history

    joints = load_history(reduction.snapshots).joints
    if len(joints) != 1:
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r}: a run with one lubricated joint is "
            f"needed, it has {', '.join(joints) or 'none'}"
        )
    ((_, joint),) = joints.items()
    film, nodes = joint.film, structure.bore.pressure_coordinates
    radius = np.linalg.norm(nodes[:, :2], axis=1).max()
    circle = radius * np.cos(film.angle), radius * np.sin(film.angle)
    places = np.column_stack([*circle, film.height])
    order = match(nodes, places)
    if order is None:
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r}: its {len(places)} film nodes are not "
            f"the {len(nodes)} pressure nodes of this bore"
        )
    return np.asarray(film.pressure)[:, order].T


def structure_provenance(
    part: schema.FlexibleSettings, model: Path, film_element: str
) -> dict[str, str]:
    """Everything that an assembled part depends on, as text by name."""
    return {
        "model": f"{model.name} {hashlib.sha256(model.read_bytes()).hexdigest()[:12]}",
        "element": part.element,
        "clamped": part.clamped,
        # A mesh has the cells it has.
        **({"cells": part.cells} if model.suffix == ".geo" else {}),
        **{name: repr(value) for name, value in attrs.asdict(part.material).items()},
        "film_element": film_element,
        "bores": " ".join(part.bores),
        "points": " ".join(part.points),
        **{f"geometry.{name}": repr(float(v)) for name, v in sorted(part.geometry.items())},
    }


def reduction_provenance(reduction: ReductionSettings) -> dict[str, str]:
    """A method and what it reads of its settings, as text by name."""
    names = ("method", *method_keys(reduction.method))
    return {name: str(getattr(reduction, name)) for name in names}


def require_provenance(
    body: ReducedBody, asked: Mapping[str, str], written: set[str], section: str
) -> None:
    """Refuse a body that was not made as a scene file says.

    One that was not made from a scene is taken as it is.

    Parameters
    ----------
    body
        From a file.
    asked
        Provenance that the scene's would have.
    written
        Names in it that the file writes.
    section
        Of the part.

    Raises
    ------
    SettingsError
        A key in the file differs from the body's.
    """
    made = dict(body.provenance)
    if "model" not in made:
        return
    if "held_by" in made:  # of version 0.2
        made["clamped"] = made.pop("held_by")
    if "geometry" in written:
        written |= {name for name in {*asked, *made} if name.startswith("geometry.")}
    for name in sorted(written & {*asked, *made}):
        if asked.get(name) != made.get(name):
            raise SettingsError(
                f"the body was made with {name} = {made.get(name, 'default')}, {section} says "
                f"{asked.get(name, 'default')}: reduce the part again or take the key out"
            )


def with_counts(settings: schema.FlexibleSettings, key: str) -> schema.FlexibleSettings:
    """The settings of a part, numbers of cells that are its model's own written out; serial."""
    from fenics_ehd.fem.gmsh_session import model_parameters  # Gmsh

    path = model_file(settings, key)
    own = model_parameters(path) if path.suffix == ".geo" else {}
    whole = attrs.evolve(settings, geometry=own).cell_counts
    return attrs.evolve(settings, geometry={k: own[k] for k in whole} | settings.geometry)


@dataclass(frozen=True, eq=False)
class ElasticPart:
    """An elastic part before its reduction.

    Attributes
    ----------
    settings
        Of the body.
    source
        The assembled structure, or the reduced body of a file.
    film_element
        Of its pressures, see `Scene.film_element`.
    """

    settings: schema.FlexibleSettings
    source: Structure | ReducedBody
    film_element: str

    def bore(self, name: str, key: str) -> BoreSurface:
        """A bore.

        Raises
        ------
        SettingsError
            The body's file has none of this name, which a key asks for.
        """
        bores = self.source.bores
        if name not in bores:
            raise SettingsError(f"{key}: {self.settings.body} has the bores {', '.join(bores)}")
        return bores[name]

    @property
    def held(self) -> bool:
        """True for a part that does not move as a whole."""
        if isinstance(self.source, ReducedBody):
            return self.source.frame == "clamped"
        return self.settings.clamped != NONE

    def points(self) -> Mapping[str, tuple[float, float]]:
        """Points by name, from the first bore's centre [m]; collective."""
        if isinstance(self.source, ReducedBody):
            found = {name: field[:2, 0] for name, field in self.source.points.items()}
        else:
            found = {name: _mean_place(self.source, name) for name in self.source.attachments}
        found = {name: bore.centre[:2] for name, bore in self.source.bores.items()} | found
        return {name: (float(x), float(y)) for name, (x, y) in found.items()}

    def reduce(self, reductor: Reductor | None = None, *, mesh_error: bool = False) -> ReducedPart:
        """The assembled structure, reduced; collective.

        Parameters
        ----------
        reductor
            Of the structure, which serves other reductions of the part as well.
        mesh_error
            Whether the body is to know what its mesh misses, as far as the model allows.
        """
        source, settings = self.source, self.settings
        assert isinstance(source, Structure)
        start = perf_counter()
        reductor = reductor or Reductor(source, solver=settings.reduction.solver)
        body = reduce_structure(reductor, settings.reduction)
        columns = body.columns
        assert columns is not None
        if mesh_error:
            with suppress(EhdError):  # whatever goes wrong with another mesh, this one is there
                body = self._with_mesh_error(body, reductor)
        made = structure_provenance(settings, model_file(settings, "body"), self.film_element)
        made |= reduction_provenance(settings.reduction)
        body = replace(body, columns=None, provenance={**body.provenance, **made})
        return ReducedPart(body, source, columns, perf_counter() - start)

    def _with_mesh_error(self, body: ReducedBody, reductor: Reductor) -> ReducedBody:
        settings, part = self.settings, reductor.structure
        if settings.reduction.method == "rigid":  # it does not bend, on any mesh
            loads = SMOOTH * len(part.bores) + 2 * len(part.attachments)
            places = sum(len(sampling_grid(bore).nodes) for bore in part.bores.values())
            return replace(body, mesh_flexibility=np.zeros((places, loads)))
        model = model_file(settings, "body")
        if model.suffix == ".msh":
            error, moved = stored_mesh_error(model, tuple(part.bores), part.attachments)
            moved /= settings.material.youngs_modulus
        else:
            other = self._other_mesh(part, with_counts(settings, "body"))
            there = smooth_answers(StaticSolver(other, solver=settings.reduction.solver))
            errors, moved = missed(part, smooth_answers(reductor.static), other, there)
            error = max(errors.values())
        accuracy = {**body.accuracy, "flexibility_mesh_error": error}
        return replace(body, mesh_flexibility=moved, accuracy=accuracy)

    def _other_mesh(self, part: Structure, counted: schema.FlexibleSettings) -> Structure:
        """The part on a finer mesh if that is small enough and can be made, else a coarser one."""

        def made(factor: float) -> Structure:
            settings = attrs.evolve(counted, geometry=counted.geometry_of(factor))
            size = 1.0 if counted.cell_counts else 1.0 / factor
            return _assembled("body", settings, self.film_element, part.comm, size)

        if part.size <= MOST_REFINED:
            with suppress(MeshError):  # a model has limits to its numbers of cells
                return made(FINER)
        return made(1.0 / FINER)


def missed(
    part: Structure, own: Answers, other: Structure, there: Answers
) -> tuple[dict[str, float], np.ndarray]:
    """Errors of a part's mesh by another mesh of the same part; collective.

    Returns
    -------
    tuple
        Errors of the flexibility, see `compliance_errors`, and `ReducedBody.mesh_flexibility`.

    Raises
    ------
    StructureError
        The meshes are too much alike.
    """
    share, between = (excess(part.size, other.size, order) for order in (ORDER, BETWEEN_NODES))
    wanted = [sampling_grid(bore).node_positions for bore in part.bores.values()]
    nodes = []
    for bore in part.bores.values():
        x, y, z = bore.coordinates.T
        nodes.append(np.column_stack([np.arctan2(y, x), z]))
    at_nodes = _read(part, _read(other, there.outward, nodes), wanted)
    moved = share * (at_nodes - _read(part, own.outward, wanted))
    moved += between * (_read(other, there.outward, wanted) - at_nodes)
    missing = share * (there.compliance - own.compliance)
    return compliance_errors(missing, own.compliance), moved


def _read(part: Structure, outward: np.ndarray, wanted: Sequence[np.ndarray]) -> np.ndarray:
    """Displacements at the nodes of all bores, read at angles and heights in each of them."""
    found = []
    for bore, places in zip(part.bores.values(), wanted, strict=True):
        surface = bore_surface(bore.coordinates, bore.cells, bore.family)
        found.append(interpolation_matrix(surface, *places.T))
    return np.asarray(sparse.block_diag(found, format="csr") @ outward)


def _mean_place(structure: Structure, name: str) -> np.ndarray:
    """Mean position of a boundary point, shape (2,) [m]; collective."""
    # The share of a unit force that a node takes is its weight in the mean position.
    weights = structure.attachments[name][0].array.reshape(-1, 3)[:, 0]
    return structure.comm.allreduce(weights @ structure.coordinates)[:2]


def elastic_part(
    settings: schema.FlexibleSettings, key: str, film_element: str, comm: MPI.Comm
) -> ElasticPart:
    """Mesh and assemble a part, or read its reduced body; collective.

    Raises
    ------
    SettingsError, MeshError, BodyFileError
        Naming what is wrong with its model or file.
    """
    if settings.body != NONE:
        return ElasticPart(settings, load_body(settings.body), film_element)
    require_snapshots(settings, key)
    return ElasticPart(settings, _assembled(key, settings, film_element, comm), film_element)


def _assembled(
    key: str,
    settings: schema.FlexibleSettings,
    film_element: str,
    comm: MPI.Comm,
    size: float = 1.0,
) -> Structure:
    # Gmsh and dolfinx are for scenes that mesh a part.
    from fenics_ehd.fem.structure import assemble_structure, build_mesh

    mesh = build_mesh(
        model_file(settings, key),
        settings.geometry,
        comm=comm,
        serendipity_geometry=settings.element == "serendipity",
        cells=settings.cells,
        bores=settings.bores,
        size=size,
    )
    return assemble_structure(
        mesh,
        settings.material,
        family=settings.element,
        pressure_family=film_element,
        bores=settings.bores,
        attachments=settings.points,
        clamped=None if settings.clamped == NONE else settings.clamped,
    )


def remade_part(scene: Scene, name: str, body: ReducedBody, programs: Sequence[str]) -> ReducedPart:
    """Mesh and reduce a body of a scene again, with the coordinates that a run recorded; serial.

    Nothing is meshed unless settings and model are those that the body was made with.

    Parameters
    ----------
    scene
        Of the run.
    name
        Of a body with a model.
    body
        As the run has it.
    programs
        Models that may be run: the scene of a run's folder may be another person's.

    Raises
    ------
    SettingsError, MeshError
        Its model is gone, is not what it was, or is a program that is not among those.
    VerificationError
        From `basis_of`.
    """
    settings, key = scene.bodies[name], f"bodies.{name}"
    # Coordinates do not depend on the estimate.
    reduction = attrs.evolve(settings.reduction, estimate_error=False)
    settings = attrs.evolve(settings, reduction=reduction)
    element, model = scene.film_element(name), model_file(settings, key)
    found = structure_provenance(settings, model, element) | reduction_provenance(reduction)
    for made, value in found.items():
        former = body.provenance.get(made, value)
        if former != value:
            raise SettingsError(
                f"{key} was made with {made} = {former}, which is {value} now: put back what it "
                "was, or run the scene anew"
            )
    program = model.suffix == ".geo" and not is_shipped(model)
    if program and not any(model.samefile(known) for known in programs):
        raise SettingsError(
            f"{key}.model = {settings.model!r} is a program, which the run's folder names: if you "
            f"know it, have it run by --model {model}"
        )
    part = elastic_part(settings, key, element, MPI.COMM_SELF).reduce()
    return replace(part, body=body, columns=basis_of(body, part.body, part.columns))


def with_body(scene: Scene, file: str, written: Mapping[str, Any]) -> Scene:
    """The scene with the reduced body of a file.

    Parameters
    ----------
    scene
        With one flexible body.
    file
        Made by ``fenics-ehd reduce``.
    written
        Tables as the user wrote them: what they say of the body must be so.

    Raises
    ------
    SettingsError
        There are several flexible bodies or none, or the file's was made otherwise than written.
    BodyFileError
        The file cannot be read.
    """
    names = flexible(scene)
    if len(names) != 1:
        raise SettingsError(
            f"--body {file}: scene {scene.name} has {len(names)} flexible bodies, not one: "
            "give body = FILE in [bodies.NAME]"
        )
    (name,) = names
    settings = scene.bodies[name]
    if settings.model != NONE:
        model, element = model_file(settings, f"bodies.{name}"), scene.film_element(name)
        asked = structure_provenance(settings, model, element)
        asked |= reduction_provenance(settings.reduction)
        own = renamed(written)[0].get("bodies", {}).get(name, {})
        require_provenance(
            load_body(file),
            asked,
            {*own, *own.get("material", {}), *own.get("reduction", {})},
            f"bodies.{name}",
        )
    entry = {
        k: v
        for k, v in scene.tables["bodies"][name].items()
        if k not in (*keys_excluded_by(schema.FlexibleSettings, "body"), "model")
    }
    return changed(scene, {f"bodies.{name}": {**entry, "body": str(file)}})


def with_method(scene: Scene, method: str) -> Scene:
    """The scene with another reduction method for every part that it meshes.

    Raises
    ------
    SettingsError
        There is none.
    """
    names = meshed(scene)
    if not names:
        raise SettingsError(f"--method {method}: scene {scene.name} has no model to reduce")
    return changed(scene, {f"bodies.{name}.reduction.method": method for name in names})
