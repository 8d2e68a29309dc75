"""Elastic parts of a scene: meshed or read from a file, reduced, and made again.

A part is a Gmsh model or the reduced body of a file. The provenance of a reduced body lists the
settings and the model that it was made from: a run's folder holds neither mesh nor basis, and its
parts are made again from these.

Imports inside functions: Gmsh and dolfinx are for scenes that mesh a part.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
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
from fenics_ehd.multibody.elastic_bore import bore_surface, sampling_grid
from fenics_ehd.multibody.history import FIELDS_NAME
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
    SmoothResponses,
    compliance_errors,
    excess,
    smooth_responses,
)
from fenics_ehd.reduction.reductor import Reductor, rigid
from fenics_ehd.reduction.residual_completion import basis_of, residual_flexibility
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.part_settings import ReductionSettings, method_keys
from fenics_ehd.scenes.scene import Scene, changed, flexible, meshed, renamed

#: Reductions by the name of their method: functions of the part, settings, and common options.
METHODS: Mapping[str, Callable[[Reductor, ReductionSettings, Mapping[str, Any]], ReducedBody]] = {
    "m1": lambda part, chosen, common: craig_bampton(part, chosen.modes, **common),
    "m2": lambda part, chosen, common: two_step_craig_bampton(
        part, chosen.modes, chosen.interior_modes, **common
    ),
    "m3": lambda part, chosen, common: load_dependent(
        part,
        chosen.vibration_modes,
        chosen.residual_modes,
        chosen.pressure_set,
        chosen.selection,
        **common,
    ),
    "m4": lambda part, chosen, common: residual_flexibility(
        part,
        chosen.vibration_modes,
        tolerance=chosen.flexibility_tolerance,
        centrifugal=part.free,
        **common,
    ),
    "full": lambda part, chosen, _: full_interface(part, chosen.vibration_modes, keep_basis=True),
    "rigid": lambda part, _, common: rigid(part, **common),
}


@dataclass(frozen=True, eq=False)
class ReducedPart:
    """A reduced part with the mesh and the basis of its displacement fields.

    Attributes
    ----------
    body
        The reduced body.
    structure
        Assembled structure, distributed over the ranks that reduced the part.
    columns
        Basis of the whole part, shape (owned dofs, n), distributed likewise.
    seconds
        Time of the reduction [s].
    """

    body: ReducedBody
    structure: Structure
    columns: np.ndarray
    seconds: float


def model_file(part: schema.FlexibleSettings, section: str) -> Path:
    """File of the Gmsh model of a part; `section` is that of its settings, for messages.

    Raises
    ------
    SettingsError
        The file does not exist.
    MeshError
        The file is no model.
    """
    path = Path(part.model) if Path(part.model).suffix else model_path(part.model)
    if not path.is_file():
        raise SettingsError(f"{section}.model = {part.model!r}: there is no file {path}")
    check_model(path)
    return path


def require_snapshots(part: schema.FlexibleSettings, section: str) -> None:
    """Refuse snapshots from a folder without a run, before anything is meshed.

    Raises
    ------
    SettingsError
        Naming the key of the section.
    """
    folder = part.reduction.snapshots
    if folder != NONE and not Path(folder, FIELDS_NAME).is_file():
        raise SettingsError(
            f"{section}.reduction.snapshots = {folder!r} must be the folder of a run: it has no "
            f"{FIELDS_NAME}"
        )


def reduce_structure(part: Structure | Reductor, reduction: ReductionSettings) -> ReducedBody:
    """Reduce a part by the method of the settings, and keep the basis of the whole part.

    A `Reductor` keeps its own solver; the setting `solver` is for structures.
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
    """M3 with the main pressure patterns of a former run; the accuracy has the number added."""
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
    film = joint.film
    nodes = structure.bore.pressure_coordinates
    radius = np.linalg.norm(nodes[:, :2], axis=1).max()
    circle = radius * np.cos(film.angle), radius * np.sin(film.angle)
    film_nodes = np.column_stack([*circle, film.height])
    order = match(nodes, film_nodes)
    if order is None:
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r}: its {len(film_nodes)} film nodes are "
            f"not the {len(nodes)} pressure nodes of this bore"
        )
    return np.asarray(film.pressure)[:, order].T


def structure_provenance(
    part: schema.FlexibleSettings, model: Path, film_element: str
) -> dict[str, str]:
    """All that an assembled part depends on, as text by name."""
    return {
        "model": f"{model.name} {hashlib.sha256(model.read_bytes()).hexdigest()[:12]}",
        "element": part.element,
        "clamped": part.clamped,
        # The cells of a stored mesh are not chosen.
        **({"cells": part.cells} if model.suffix == ".geo" else {}),
        **{name: repr(value) for name, value in attrs.asdict(part.material).items()},
        "film_element": film_element,
        "bores": " ".join(part.bores),
        "points": " ".join(part.points),
        **{f"geometry.{name}": repr(float(v)) for name, v in sorted(part.geometry.items())},
    }


def reduction_provenance(reduction: ReductionSettings) -> dict[str, str]:
    """Method and the settings that it reads, as text by name."""
    names = ("method", *method_keys(reduction.method))
    return {name: str(getattr(reduction, name)) for name in names}


#: Present names of entries of a body's provenance, by the former name of version 0.2 or 0.3.
FORMER_PROVENANCE = {"held_by": "clamped", "residual_truncation": "flexibility_tolerance"}


def require_provenance(
    body: ReducedBody, asked: Mapping[str, str], written: set[str], section: str
) -> None:
    """Refuse a body that was made with other settings than those of a scene file.

    A body that was not made from a scene is accepted.

    Parameters
    ----------
    body
        Body of a file.
    asked
        Provenance of a body with the settings of the scene.
    written
        Names of the provenance that the scene file writes.
    section
        Section of the part, for messages.

    Raises
    ------
    SettingsError
        A value of the scene file differs from the body's.
    """
    made = dict(body.provenance)
    if "model" not in made:
        return
    for former, name in FORMER_PROVENANCE.items():
        if former in made:
            made[name] = made.pop(former)
    if "geometry" in written:
        written |= {name for name in {*asked, *made} if name.startswith("geometry.")}
    for name in sorted(written & {*asked, *made}):
        if asked.get(name) != made.get(name):
            raise SettingsError(
                f"the body was made with {name} = {made.get(name, 'default')}, {section} has "
                f"{asked.get(name, 'default')}: reduce the part again or drop the key"
            )


def with_counts(settings: schema.FlexibleSettings, key: str) -> schema.FlexibleSettings:
    """Settings of a part with the numbers of cells that its model has by default; serial."""
    from fenics_ehd.fem.gmsh_session import model_parameters  # Gmsh

    path = model_file(settings, key)
    defaults = model_parameters(path) if path.suffix == ".geo" else {}
    counts = attrs.evolve(settings, geometry=defaults).cell_counts
    geometry = {key: defaults[key] for key in counts} | settings.geometry
    return attrs.evolve(settings, geometry=geometry)


@dataclass(frozen=True, eq=False)
class ElasticPart:
    """An elastic part before its reduction.

    Attributes
    ----------
    settings
        Settings of the body.
    source
        Assembled structure, or reduced body.
    film_element
        Element of the pressures in its bores, see `Scene.film_element`.
    film_edges
        Edges of the films in its bores, see `Scene.film_edges`.
    """

    settings: schema.FlexibleSettings
    source: Structure | ReducedBody
    film_element: str
    film_edges: Mapping[str, Sequence[float]] = field(default_factory=dict)

    def reductor(self) -> Reductor:
        """A reductor of the assembled structure, for the pressures of its films."""
        assert isinstance(self.source, Structure)
        solver = self.settings.reduction.solver
        return Reductor(self.source, solver=solver, film_edges=self.film_edges)

    def bore(self, name: str, key: str) -> BoreSurface:
        """A bore by its name; `key` is the setting that names it, for messages.

        Raises
        ------
        SettingsError
            The body's file has no bore of this name.
        """
        bores = self.source.bores
        if name not in bores:
            raise SettingsError(f"{key}: {self.settings.body} has the bores {', '.join(bores)}")
        return bores[name]

    @property
    def held(self) -> bool:
        """True for a part that is clamped: it deforms and does not move otherwise."""
        if isinstance(self.source, ReducedBody):
            return self.source.frame == "clamped"
        return self.settings.clamped != NONE

    def points(self) -> Mapping[str, tuple[float, float]]:
        """Points by name, from the first bore's centre [m]; collective."""
        if isinstance(self.source, ReducedBody):
            points = {name: field[:2, 0] for name, field in self.source.points.items()}
        else:
            points = {name: _mean_position(self.source, name) for name in self.source.attachments}
        centres = {name: bore.centre[:2] for name, bore in self.source.bores.items()}
        return {name: (float(x), float(y)) for name, (x, y) in (centres | points).items()}

    def reduce(self, reductor: Reductor | None = None, *, mesh_error: bool = False) -> ReducedPart:
        """Reduce the assembled structure; collective.

        Parameters
        ----------
        reductor
            Reductor of the structure that other reductions of the part share.
        mesh_error
            Whether the error of the mesh is estimated, if the model can be meshed otherwise.
        """
        source = self.source
        settings = self.settings
        assert isinstance(source, Structure)
        start = perf_counter()
        reductor = reductor or self.reductor()
        body = reduce_structure(reductor, settings.reduction)
        columns = body.columns
        assert columns is not None
        if mesh_error:
            with suppress(EhdError):  # the body is complete without a second mesh
                body = self._with_mesh_error(body, reductor)
        made = structure_provenance(settings, model_file(settings, "body"), self.film_element)
        made |= reduction_provenance(settings.reduction)
        body = replace(body, columns=None, provenance={**body.provenance, **made})
        return ReducedPart(body, source, columns, perf_counter() - start)

    def _with_mesh_error(self, body: ReducedBody, reductor: Reductor) -> ReducedBody:
        settings = self.settings
        part = reductor.structure
        if settings.reduction.method == "rigid":  # no mesh makes it bend
            loads = SMOOTH * len(part.bores) + 2 * len(part.attachments)
            samples = sum(len(sampling_grid(bore).nodes) for bore in part.bores.values())
            return replace(body, mesh_flexibility=np.zeros((samples, loads)))
        model = model_file(settings, "body")
        if model.suffix == ".msh":
            error, moved = stored_mesh_error(model, tuple(part.bores), part.attachments)
            moved /= settings.material.youngs_modulus
        else:
            other = self._other_mesh(part, with_counts(settings, "body"))
            there = smooth_responses(StaticSolver(other, solver=settings.reduction.solver))
            errors, moved = missed(part, smooth_responses(reductor.static), other, there)
            error = max(errors.values())
        accuracy = {**body.accuracy, "flexibility_mesh_error": error}
        return replace(body, mesh_flexibility=moved, accuracy=accuracy)

    def _other_mesh(self, part: Structure, counted: schema.FlexibleSettings) -> Structure:
        """The part on a finer mesh, or a coarser one if this mesh is large or the model refuses."""

        def made(factor: float) -> Structure:
            settings = attrs.evolve(counted, geometry=counted.geometry_of(factor))
            size = 1.0 if counted.cell_counts else 1.0 / factor
            return _assembled("body", settings, self.film_element, part.comm, size)

        if part.size <= MOST_REFINED:
            with suppress(MeshError):  # a model has limits to its numbers of cells
                return made(FINER)
        return made(1.0 / FINER)


def missed(
    part: Structure, own: SmoothResponses, other: Structure, there: SmoothResponses
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
    at_nodes = _sampled(part, _sampled(other, there.outward, nodes), wanted)
    moved = share * (at_nodes - _sampled(part, own.outward, wanted))
    moved += between * (_sampled(other, there.outward, wanted) - at_nodes)
    missing = share * (there.compliance - own.compliance)
    return compliance_errors(missing, own.compliance), moved


def _sampled(part: Structure, outward: np.ndarray, wanted: Sequence[np.ndarray]) -> np.ndarray:
    """Displacements at the nodes of all bores, interpolated to angles and heights in each bore."""
    blocks = []
    for bore, positions in zip(part.bores.values(), wanted, strict=True):
        surface = bore_surface(bore.coordinates, bore.cells, bore.family)
        blocks.append(interpolation_matrix(surface, *positions.T))
    return np.asarray(sparse.block_diag(blocks, format="csr") @ outward)


def _mean_position(structure: Structure, name: str) -> np.ndarray:
    """Mean position of a boundary point, shape (2,) [m]; collective."""
    # The fraction of a unit force at a node is its weight in the mean position.
    weights = structure.attachments[name][0].array.reshape(-1, 3)[:, 0]
    return structure.comm.allreduce(weights @ structure.coordinates)[:2]


def elastic_part(
    settings: schema.FlexibleSettings,
    key: str,
    film_element: str,
    comm: MPI.Comm,
    film_edges: Mapping[str, Sequence[float]] | None = None,
) -> ElasticPart:
    """Mesh and assemble a part, or read its reduced body; collective.

    Raises
    ------
    SettingsError, MeshError, BodyFileError
        The model or file cannot be used.
    """
    source: Structure | ReducedBody
    if settings.body != NONE:
        source = load_body(settings.body)
    else:
        require_snapshots(settings, key)
        source = _assembled(key, settings, film_element, comm)
    return ElasticPart(settings, source, film_element, film_edges or {})


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
    """Mesh and reduce a body of a recorded run again, in the coordinates of the record; serial.

    Settings and model must be those that the body was made with, or nothing is meshed.

    Parameters
    ----------
    scene
        Scene of the run.
    name
        Name of a body with a model.
    body
        Reduced body of the run.
    programs
        Models that may be executed: the scene of a run's folder may be from another person.

    Raises
    ------
    SettingsError, MeshError
        The model is missing, has changed, or is a program that is not among `programs`.
    VerificationError
        From `basis_of`.
    """
    settings = scene.bodies[name]
    key = f"bodies.{name}"
    # Coordinates do not depend on the estimate.
    reduction = attrs.evolve(settings.reduction, estimate_error=False)
    settings = attrs.evolve(settings, reduction=reduction)
    element = scene.film_element(name)
    model = model_file(settings, key)
    present = structure_provenance(settings, model, element) | reduction_provenance(reduction)
    for made, value in present.items():
        former = body.provenance.get(made, value)
        if former != value:
            raise SettingsError(
                f"{key} was made with {made} = {former}, which is {value} now: restore the former "
                "value, or run the scene again"
            )
    program = model.suffix == ".geo" and not is_shipped(model)
    if program and not any(model.samefile(known) for known in programs):
        raise SettingsError(
            f"{key}.model = {settings.model!r} is a program, named by the scene of the run: if you "
            f"trust it, allow it to run by --model {model}"
        )
    edges = scene.film_edges(name)
    part = elastic_part(settings, key, element, MPI.COMM_SELF, edges).reduce()
    return replace(part, body=body, columns=basis_of(body, part.body, part.columns))


def with_body(scene: Scene, file: str, written: Mapping[str, Any]) -> Scene:
    """The scene with the reduced body of a file.

    Parameters
    ----------
    scene
        Scene with one flexible body.
    file
        File made by ``fenics-ehd reduce``.
    written
        Tables as the user wrote them: the body must have been made with their values.

    Raises
    ------
    SettingsError
        There are several flexible bodies or none, or the body was made with other values.
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
        model = model_file(settings, f"bodies.{name}")
        element = scene.film_element(name)
        asked = structure_provenance(settings, model, element)
        asked |= reduction_provenance(settings.reduction)
        table = renamed(written)[0].get("bodies", {}).get(name, {})
        require_provenance(
            load_body(file),
            asked,
            {*table, *table.get("material", {}), *table.get("reduction", {})},
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
        The scene has no part with a model.
    """
    names = meshed(scene)
    if not names:
        raise SettingsError(f"--method {method}: scene {scene.name} has no model to reduce")
    return changed(scene, {f"bodies.{name}.reduction.method": method for name in names})
