"""Elastic parts of a scene: meshed or read from a file, reduced, and remade for a stored run.

A part comes from a Gmsh model, or from the file of a reduced body. A run's folder holds neither
mesh nor basis of a part. To remake a part, the provenance in its reduced body lists the model and
settings with which it was made.

Imports inside functions: Gmsh and dolfinx are needed only by scenes that mesh a part.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import attrs
import numpy as np
from mpi4py import MPI
from scipy import sparse

from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import EhdError, MeshError, SettingsError
from fenics_ehd.base.needs import NONE
from fenics_ehd.base.progress import SILENT, Progress
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
from fenics_ehd.reduction.pressure_family import edges_text
from fenics_ehd.reduction.reductor import Reductor, rigid
from fenics_ehd.reduction.residual_completion import basis_of, residual_flexibility
from fenics_ehd.reduction.static import WORK, StaticSolver
from fenics_ehd.reduction.structure import Structure
from fenics_ehd.scenes import kept_bodies, schema
from fenics_ehd.scenes.kept_bodies import (
    MESH_ERROR,
    Entry,
    checksum,
    content_of,
    environment,
)
from fenics_ehd.scenes.part_settings import ReductionSettings, method_keys
from fenics_ehd.scenes.scene import Scene

#: Function that is called with the names of bodies to reduce, and of those read from the cache.
Announce = Callable[[Sequence[str], Sequence[str]], None]

#: Function of each reduction method, called with the part, its settings, and common options.
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
class ReducedPart(Described):
    """A reduced part, with its assembled structure and the basis of its displacement fields.

    Attributes
    ----------
    body
        The reduced body.
    structure
        Assembled structure of the part, distributed over the ranks that reduced it.
    columns
        Displacement fields of the n modes in the complete part, shape (dofs of this rank, n).
    seconds
        Time of the reduction in this process, or of reading the body from the cache [s].
    """

    body: ReducedBody
    structure: Structure
    columns: np.ndarray
    seconds: float


def model_file(part: schema.FlexibleSettings, section: str) -> Path:
    """Path of a part's Gmsh model; `section` is the key of the part's settings, for messages.

    Raises
    ------
    SettingsError
        The file does not exist.
    MeshError
        The file is not a model.
    """
    path = Path(part.model) if Path(part.model).suffix else model_path(part.model)
    if not path.is_file():
        raise SettingsError(f"{section}.model = {part.model!r}: file {path} does not exist")
    check_model(path)
    return path


def require_snapshots(part: schema.FlexibleSettings, section: str) -> None:
    """Refuse snapshots from a folder without a run, before any part is meshed.

    Raises
    ------
    SettingsError
        The folder has no history of a run; the message names the key of the setting.
    """
    folder = part.reduction.snapshots
    if folder != NONE and not Path(folder, FIELDS_NAME).is_file():
        raise SettingsError(
            f"{section}.reduction.snapshots = {folder!r} must be the folder of a run, but it has "
            f"no {FIELDS_NAME}"
        )


def reduce_structure(part: Structure | Reductor, reduction: ReductionSettings) -> ReducedBody:
    """Reduce a part by the method in its settings.

    The attribute `columns` of the body has the displacement fields of the complete part. The
    setting `solver` is used for a `Structure`; a `Reductor` has its solver already.
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
    """Reduce a part by M3 with the main patterns of the pressures in a former run.

    The number of patterns may exceed the requested number. The entry ``static_added`` in the
    accuracy of the body has the difference.
    """
    asked = reduction.residual_modes
    patterns = proper_orthogonal(_snapshots(part.structure, reduction), asked)
    body = load_dependent(
        part, reduction.vibration_modes, patterns.shape[1], patterns, "every-column", **common
    )
    added = {"static_added": float(max(patterns.shape[1] - asked, 0))}
    return replace(body, accuracy={**body.accuracy, **added})


def _snapshots(structure: Structure, reduction: ReductionSettings) -> np.ndarray:
    """Film pressures of a former run at the pressure nodes of a bore, shape (nodes, steps) [Pa].

    Raises
    ------
    SettingsError
        The part has several bores, or the nodes of the former run's film are not those of the bore.
    """
    if len(structure.bores) > 1:
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r} needs a part with one bore, but the "
            f"part has the bores {', '.join(structure.bores)}"
        )
    from fenics_ehd.multibody.history import load_history

    joints = load_history(reduction.snapshots).joints
    if len(joints) != 1:
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r} must be a run with one lubricated "
            f"joint, but it has {', '.join(joints) or 'none'}"
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
            f"reduction.snapshots = {reduction.snapshots!r}: the {len(film_nodes)} film nodes of "
            f"that run are not at the {len(nodes)} pressure nodes of this bore: use a run whose "
            "film has the mesh of the bore"
        )
    return np.asarray(film.pressure)[:, order].T


def structure_provenance(
    part: schema.FlexibleSettings, model: Path, film_element: str
) -> dict[str, str]:
    """Texts, by name, of everything on which an assembled part depends: model, cells, material."""
    return {
        "model": f"{model.name} {hashlib.sha256(model.read_bytes()).hexdigest()[:12]}",
        "element": part.element,
        "clamped": part.clamped,
        # A stored mesh leaves no choice of cells.
        **({"cells": part.cells} if model.suffix == ".geo" else {}),
        **{name: repr(value) for name, value in attrs.asdict(part.material).items()},
        "film_element": film_element,
        "bores": " ".join(part.bores),
        "points": " ".join(part.points),
        **{f"geometry.{name}": repr(float(v)) for name, v in sorted(part.geometry.items())},
    }


def reduction_provenance(reduction: ReductionSettings) -> dict[str, str]:
    """Texts, by name, of the reduction method and of the settings that this method reads."""
    names = ("method", *method_keys(reduction.method))
    return {name: str(getattr(reduction, name)) for name in names}


#: Keys of a body's provenance with the wall and processor time that its reduction took [s].
SECONDS = "reduction_time_s"
PROCESSOR_SECONDS = "reduction_processor_time_s"


#: Names of the counts of work in a body's provenance: of its reduction, and of its mesh error.
COUNTS = (*WORK, *(f"{MESH_ERROR}{name}" for name in WORK))


def body_counts(body: ReducedBody) -> dict[str, int]:
    """Counts of the work of a body's reduction, by name; unknown counts are missing."""
    return {name: int(body.provenance[name]) for name in COUNTS if name in body.provenance}


def clock() -> np.ndarray:
    """Present wall time and processor time of this process, shape (2,) [s]."""
    return np.array([perf_counter(), process_time()])


def part_texts(
    settings: schema.FlexibleSettings,
    model: Path,
    film_element: str,
    film_edges: Mapping[str, Sequence[float]],
) -> dict[str, str]:
    """Texts, by name, of everything on which a part and its static responses depend."""
    return structure_provenance(settings, model, film_element) | {
        "solver": settings.reduction.solver,
        "film_edges": edges_text(film_edges),
    }


def reduction_texts(reduction: ReductionSettings) -> dict[str, str]:
    """Texts, by name, of the settings of a reduction on which a reduced body depends."""
    texts = reduction_provenance(reduction)
    if "snapshots" in texts:
        # The body depends on the pressures of the former run, not on the path of its folder.
        texts["snapshots"] = content_of(reduction.snapshots) or reduction.snapshots
    return texts | {"estimate_error": str(reduction.estimate_error)}


#: Words of a ``.geo`` model that may depend on more than its own content: other files, the machine.
OUTSIDE = re.compile(
    rb"\b(Include|Merge\w*|ShapeFromFile|Open|\w*SystemCall|OnelabRun|GetEnv|FileName|Plugin|Rand|"
    rb"Cpu|Memory|TotalMemory|Today|CurrentDirectory)\b"
)


def kept_entry(
    settings: schema.FlexibleSettings,
    key: str,
    film_element: str,
    film_edges: Mapping[str, Sequence[float]],
    comm: MPI.Comm,
    *,
    mesh_error: bool = False,
    after: Sequence[str] = (),
    cache: bool = True,
) -> Entry:
    """Entry of a part's reduced body in the cache, which may not exist yet; collective.

    Parameters
    ----------
    settings, key
        Settings of the body in the scene, and their key, for messages.
    film_element, film_edges
        See `ElasticPart`.
    comm
        Ranks that share the part.
    mesh_error
        Whether the body has an estimate of its mesh error.
    after
        Names of the bodies that the same reductor reduces before this body. Their intermediate
        results are used again, so that the last bits of this body depend on them.
    cache
        Whether the cache is used.
    """
    names = made = None
    if cache and comm.rank == 0 and kept_bodies.is_on():
        model = model_file(settings, key)
        content = model.read_bytes()
        if model.suffix == ".geo" and not is_shipped(model) and OUTSIDE.search(content):
            word = OUTSIDE.findall(content)[0].decode()
            kept_bodies.report(
                f"{key}: the reduced body is not kept, since {model} may depend on more than its "
                f"content: it has {word}"
            )
        else:
            made = structure_provenance(settings, model, film_element)
            made |= reduction_provenance(settings.reduction)
            texts = environment() | part_texts(settings, model, film_element, film_edges)
            texts |= reduction_texts(settings.reduction)
            texts["model_content"] = hashlib.sha256(content).hexdigest()
            texts["ranks"] = str(comm.size)
            texts["after"] = " ".join(after)
            names = [checksum(texts | {"mesh_error": str(known)}, 32) for known in (False, True)]
    names, made = comm.bcast((names, made))
    if names is None:
        return Entry()
    plain, complete = names
    return Entry(complete, made, comm) if mesh_error else Entry(plain, made, comm, complete)


def with_counts(settings: schema.FlexibleSettings, key: str) -> schema.FlexibleSettings:
    """Settings of a part with the default numbers of cells of its model added; on one rank."""
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
        Settings of the body in the scene.
    source
        Assembled structure of the part, or its reduced body if this exists already.
    film_element
        Element family of the pressures in the part's bores, see `Scene.film_element`.
    film_edges
        Edges of the films in the part's bores, see `Scene.film_edges`.
    entry
        Entry of the reduced body in the cache; by default the body is not kept.
    spent
        Wall time and processor time that mesh and matrices took, shape (2,) [s].
    progress
        Progress in which the reduction opens its stages.
    """

    settings: schema.FlexibleSettings
    source: Structure | ReducedBody
    film_element: str
    film_edges: Mapping[str, Sequence[float]] = field(default_factory=dict)
    entry: Entry = field(default_factory=Entry)
    spent: np.ndarray = field(default_factory=lambda: np.zeros(2))
    progress: Progress = SILENT

    def reductor(self) -> Reductor:
        """Make a reductor of the assembled structure, for pressures with the edges of its films."""
        assert isinstance(self.source, Structure)
        return Reductor(
            self.source,
            solver=self.settings.reduction.solver,
            film_edges=self.film_edges,
            progress=self.progress,
        )

    def bore(self, name: str, key: str) -> BoreSurface:
        """Bore of the part by its name; `key` is the key of the setting with the name.

        Raises
        ------
        SettingsError
            The part has no bore of this name; the message lists its bores.
        """
        bores = self.source.bores
        if name not in bores:
            raise SettingsError(
                f"{key}: {self.settings.body} has no bore {name!r}: choose from {', '.join(bores)}"
            )
        return bores[name]

    @property
    def held(self) -> bool:
        """True if the part is clamped, so that it deforms but has no rigid motion."""
        if isinstance(self.source, ReducedBody):
            return self.source.frame == "clamped"
        return self.settings.clamped != NONE

    def points(self) -> Mapping[str, tuple[float, float]]:
        """Positions of the part's points relative to the first bore's centre [m]; collective."""
        if isinstance(self.source, ReducedBody):
            points = {name: field[:2, 0] for name, field in self.source.points.items()}
        else:
            points = {name: _mean_position(self.source, name) for name in self.source.attachments}
        centres = {name: bore.centre[:2] for name, bore in self.source.bores.items()}
        return {name: (float(x), float(y)) for name, (x, y) in (centres | points).items()}

    def reduce(self, reductor: Reductor | None = None, *, mesh_error: bool = False) -> ReducedPart:
        """Reduce the assembled structure of the part, or read its body from the cache; collective.

        A new body is stored in the cache.

        Parameters
        ----------
        reductor
            Reductor of the structure, if several reductions share it; the body is then reduced
            without reading the cache. By default a reductor is made.
        mesh_error
            Whether the error of the mesh is also estimated, from a second mesh of the model.
        """
        source = self.source
        assert isinstance(source, Structure)
        start = clock()
        if reductor is not None:
            return self._reduced(reductor, start, mesh_error=mesh_error)
        with self.entry.locked():
            kept = self.entry.fields(source)
            if kept is not None:
                return ReducedPart(kept[0], source, kept[1], float((clock() - start)[0]))
            return self._reduced(self.reductor(), start, mesh_error=mesh_error)

    def _reduced(self, reductor: Reductor, start: np.ndarray, *, mesh_error: bool) -> ReducedPart:
        """Reduce the part, and store the body in the cache.

        `start` has the times of `clock` at the beginning.
        """
        settings = self.settings
        structure = reductor.structure
        body = reduce_structure(reductor, settings.reduction)
        columns = body.columns
        assert columns is not None
        if mesh_error:
            # The body is valid without an estimate from a second mesh.
            with self.progress.stage("mesh error"), suppress(EhdError):
                body = self._with_mesh_error(body, reductor)
        made = structure_provenance(settings, model_file(settings, "body"), self.film_element)
        made |= reduction_provenance(settings.reduction)
        seconds = clock() - start
        total = structure.comm.bcast(seconds + self.spent)  # a body is the same on all ranks
        took = dict(zip((SECONDS, PROCESSOR_SECONDS), map(repr, total.tolist()), strict=True))
        body = replace(body, columns=None, provenance={**body.provenance, **made, **took})
        self.entry.keep(body, structure, columns)
        return ReducedPart(body, structure, columns, float(seconds[0]))

    def _with_mesh_error(self, body: ReducedBody, reductor: Reductor) -> ReducedBody:
        settings = self.settings
        part = reductor.structure
        if settings.reduction.method == "rigid":  # a rigid body has no flexibility on any mesh
            loads = SMOOTH * len(part.bores) + 2 * len(part.attachments)
            samples = sum(len(sampling_grid(bore).nodes) for bore in part.bores.values())
            return replace(body, mesh_flexibility=np.zeros((samples, loads)))
        model = model_file(settings, "body")
        if model.suffix == ".msh":
            error, moved = stored_mesh_error(model, tuple(part.bores), part.attachments)
            moved /= settings.material.youngs_modulus
        else:
            here = smooth_responses(reductor.static)
            reductor.forget()  # the factors of the second mesh need the memory
            other = self._other_mesh(part, with_counts(settings, "body"))
            solver = StaticSolver(
                other, solver=settings.reduction.solver, once=True, work=reductor.work
            )
            there = smooth_responses(solver)
            errors, moved = missed(part, here, other, there)
            error = max(errors.values())
        accuracy = {**body.accuracy, "flexibility_mesh_error": error}
        provenance = {
            **body.provenance,
            **{f"{MESH_ERROR}{name}": text for name, text in reductor.work.take().items()},
        }
        return replace(body, mesh_flexibility=moved, accuracy=accuracy, provenance=provenance)

    def _other_mesh(self, part: Structure, counted: schema.FlexibleSettings) -> Structure:
        """Structure of the part on a second mesh, which is finer than the mesh of `part`.

        The second mesh is coarser if the first is large, or if the model refuses a finer mesh.
        """

        def made(factor: float) -> Structure:
            settings = attrs.evolve(counted, geometry=counted.geometry_of(factor))
            size = 1.0 if counted.cell_counts else 1.0 / factor
            return _assembled("body", settings, self.film_element, part.comm, self.progress, size)

        if part.size <= MOST_REFINED:
            with suppress(MeshError):  # the model limits its numbers of cells
                return made(FINER)
        return made(1.0 / FINER)


def missed(
    part: Structure, own: SmoothResponses, other: Structure, there: SmoothResponses
) -> tuple[dict[str, float], np.ndarray]:
    """Mesh error of a part, estimated from a second mesh of the same part; collective.

    Parameters
    ----------
    part, own
        Structure of the part on the first mesh, and its responses to smooth loads.
    other, there
        Structure of the part on the second mesh, and its responses to the same loads.

    Returns
    -------
    tuple
        Relative errors of the flexibility, see `compliance_errors`, and errors of displacements,
        see `ReducedBody.mesh_flexibility`.

    Raises
    ------
    StructureError
        The numbers of unknowns of the meshes are too similar.
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
    """Interpolate outward displacements at the nodes of all bores to other positions.

    `wanted` has the angles and heights of the positions in each bore, shape (k, 2).
    """
    blocks = []
    for bore, positions in zip(part.bores.values(), wanted, strict=True):
        surface = bore_surface(bore.coordinates, bore.cells, bore.family)
        blocks.append(interpolation_matrix(surface, *positions.T))
    return np.asarray(sparse.block_diag(blocks, format="csr") @ outward)


def _mean_position(structure: Structure, name: str) -> np.ndarray:
    """Mean position of a boundary point along x and y, shape (2,) [m]; collective."""
    # The weight of a node in the mean is its fraction of a unit force on the point.
    weights = structure.attachments[name][0].array.reshape(-1, 3)[:, 0]
    return structure.comm.allreduce(weights @ structure.coordinates)[:2]


def elastic_part(
    settings: schema.FlexibleSettings,
    key: str,
    film_element: str,
    comm: MPI.Comm,
    film_edges: Mapping[str, Sequence[float]] | None = None,
    entry: Entry | None = None,
    progress: Progress = SILENT,
) -> ElasticPart:
    """Mesh and assemble a part, or read its reduced body from a file; collective.

    `entry` is the entry of the part's body in the cache, which `ElasticPart.reduce` reads. Mesh and
    reduction open their stages in `progress`.

    Raises
    ------
    SettingsError, MeshError, BodyFileError
        The model or the file cannot be used.
    """
    if settings.body != NONE:
        return ElasticPart(settings, load_body(settings.body), film_element, film_edges or {})
    require_snapshots(settings, key)
    start = clock()
    structure = _assembled(key, settings, film_element, comm, progress)
    spent = clock() - start
    return ElasticPart(
        settings, structure, film_element, film_edges or {}, entry or Entry(), spent, progress
    )


def _assembled(
    key: str,
    settings: schema.FlexibleSettings,
    film_element: str,
    comm: MPI.Comm,
    progress: Progress,
    size: float = 1.0,
) -> Structure:
    # Only scenes that mesh a part need Gmsh and dolfinx.
    from fenics_ehd.fem.structure import assemble_structure, build_mesh

    with progress.stage("mesh"):
        mesh = build_mesh(
            model_file(settings, key),
            settings.geometry,
            comm=comm,
            serendipity_geometry=settings.element == "serendipity",
            cells=settings.cells,
            bores=settings.bores,
            size=size,
        )
    with progress.stage("matrices"):
        return assemble_structure(
            mesh,
            settings.material,
            family=settings.element,
            pressure_family=film_element,
            bores=settings.bores,
            attachments=settings.points,
            clamped=None if settings.clamped == NONE else settings.clamped,
        )


def remade_part(
    scene: Scene,
    name: str,
    body: ReducedBody,
    programs: Sequence[str],
    announce: Announce = lambda reduced, read: None,
    progress: Progress = SILENT,
) -> ReducedPart:
    """Mesh and reduce a body of a stored run again, with the coordinates of the run; on one rank.

    If the body is in the cache, the part is only meshed. If the settings or the model are not those
    with which the body was made, the part is refused before it is meshed.

    Parameters
    ----------
    scene
        Scene of the run.
    name
        Name of a body with a model.
    body
        Reduced body of the run.
    programs
        Paths of models that may be executed. Other models that are programs are refused, because
        the folder of the run may be from another person.
    announce, progress
        See `fenics_ehd.scenes.build.build`.

    Raises
    ------
    SettingsError, MeshError
        The model does not exist, has changed, or is a program that is not in `programs`.
    VerificationError
        The new basis does not reproduce the displacements of the body, see `basis_of`.
    """
    settings = scene.bodies[name]
    key = f"bodies.{name}"
    # The coordinates do not depend on the error estimate.
    reduction = attrs.evolve(settings.reduction, estimate_error=False)
    settings = attrs.evolve(settings, reduction=reduction)
    element = scene.film_element(name)
    model = model_file(settings, key)
    present = structure_provenance(settings, model, element) | reduction_provenance(reduction)
    for made, value in present.items():
        former = body.provenance.get(made, value)
        if former != value:
            raise SettingsError(
                f"{key} was made with {made} = {former}, but the value is {value} now: restore the "
                "former value, or run the scene again"
            )
    program = model.suffix == ".geo" and not is_shipped(model)
    if program and not any(model.samefile(known) for known in programs):
        raise SettingsError(
            f"{key}.model = {settings.model!r} is a program, to which the scene of the run refers: "
            f"if you trust it, allow it to run by --model {model}"
        )
    edges = scene.film_edges(name)
    entries = [
        kept_entry(each, key, element, edges, MPI.COMM_SELF)
        for each in (scene.bodies[name], settings)
    ]
    kept = next((entry for entry in entries if entry.body() is not None), None)
    announce([name] if kept is None else [], [] if kept is None else [name])
    entry = kept or entries[-1]
    with progress.stage(name):
        part = elastic_part(settings, key, element, MPI.COMM_SELF, edges, entry, progress).reduce()
    return replace(part, body=body, columns=basis_of(body, part.body, part.columns))
