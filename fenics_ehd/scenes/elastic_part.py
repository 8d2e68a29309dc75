"""An elastic part of a scene, meshed or read, then reduced."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from time import perf_counter

import attrs
import numpy as np
from mpi4py import MPI
from scipy import sparse

from fenics_ehd.base.errors import EhdError, MeshError, SettingsError
from fenics_ehd.fem.models import stored_mesh_error
from fenics_ehd.film.layout import film_grid
from fenics_ehd.film.surface_reading import interpolation_matrix
from fenics_ehd.multibody.bore_film import bore_surface
from fenics_ehd.reduction import ReducedBody, Reductor, Structure, load_body
from fenics_ehd.reduction.bore import BoreSurface
from fenics_ehd.reduction.mesh_error import (
    FINER,
    MOST_REFINED,
    SMOOTH,
    compliance_errors,
    excess,
    outward_of,
    smooth_answers,
)
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.part import (
    ReducedPart,
    model_file,
    pressure_family,
    reduce_structure,
    reduction_provenance,
    structure_provenance,
)
from fenics_ehd.scenes.part_cells import counts, part_cells, with_counts


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
        Of the film in its first bore that has one.
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

    def check_cells(self, name: str) -> None:
        """Refuse a bore that offers no cells to a film without cells of its own.

        Raises
        ------
        InterfaceMismatchError
            See `film_grid`.
        """
        bore = self.source.bores[name]
        if bore.pressure_family != "triangle":
            film_grid(bore.pressure_coordinates)

    @property
    def held(self) -> bool:
        """Whether it does not move as a whole."""
        if isinstance(self.source, ReducedBody):
            return self.source.frame == "clamped"
        return self.settings.held_by != NONE

    def points(self) -> Mapping[str, tuple[float, float]]:
        """Points by name, from the first bore's centre [m]; collective."""
        if isinstance(self.source, ReducedBody):
            found = {name: field[:2, 0] for name, field in self.source.points.items()}
        else:
            found = {name: _mean_place(self.source, name) for name in self.source.attachments}
        found = {name: bore.centre[:2] for name, bore in self.source.bores.items()} | found
        return {name: (float(x), float(y)) for name, (x, y) in found.items()}

    def reduce(
        self, reductor: Reductor | None = None, *, mesh_error: bool = False
    ) -> ReducedPart | ReducedBody:
        """The reduced part, that of a file as it is; collective.

        Parameters
        ----------
        reductor
            Of the structure, which serves other reductions of the part as well.
        mesh_error
            Whether the body is to know what its mesh misses, as far as the model allows.
        """
        source, settings = self.source, self.settings
        if isinstance(source, ReducedBody):
            return source
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
            none = np.zeros((len(part.bore_nodes), SMOOTH * len(part.bores)))
            return replace(body, mesh_flexibility=none)
        model, own = model_file(settings, "body"), smooth_answers(reductor.static)
        if model.suffix == ".msh":
            missing = stored_mesh_error(model, tuple(part.bores)) / settings.material.youngs_modulus
            moved = outward_of(missing, part.bores)
        else:
            other = self._other_mesh(part, with_counts(settings, "body"))
            there = smooth_answers(StaticSolver(other, solver=settings.reduction.solver))
            share = excess(part.size, other.size)
            missing = share * (there.compliance - own.compliance)
            moved = share * (_read(other.bores, part.bores) @ there.outward - own.outward)
        error = max(compliance_errors(missing, own.compliance).values())
        accuracy = {**body.accuracy, "flexibility_mesh_error": error}
        return replace(body, mesh_flexibility=moved, accuracy=accuracy)

    def _other_mesh(self, part: Structure, counted: schema.FlexibleSettings) -> Structure:
        """The part on a finer mesh if that is small enough and can be made, else a coarser one."""

        def made(factor: float) -> Structure:
            settings = attrs.evolve(counted, geometry=part_cells(counted, factor))
            size = 1.0 if counts(counted) else 1.0 / factor
            return _assembled("body", settings, self.film_element, part.comm, size)

        if part.size <= MOST_REFINED:
            with suppress(MeshError):  # a model has limits to its numbers of cells
                return made(FINER)
        return made(1.0 / FINER)


def _read(bores: Mapping[str, BoreSurface], wanted: Mapping[str, BoreSurface]) -> sparse.csr_matrix:
    """From values at the nodes of bores to those at the nodes of the same bores on another mesh."""
    found = []
    for name, bore in bores.items():
        surface = bore_surface(bore.coordinates, bore.cells, bore.family)
        x, y, z = wanted[name].coordinates.T
        found.append(interpolation_matrix(surface, np.arctan2(y, x), z))
    return sparse.block_diag(found, format="csr")


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
    return ElasticPart(settings, _assembled(key, settings, film_element, comm), film_element)


def _assembled(
    key: str,
    settings: schema.FlexibleSettings,
    film_element: str,
    comm: MPI.Comm,
    size: float = 1.0,
) -> Structure:
    # Gmsh and dolfinx are for scenes that mesh a part.
    from fenics_ehd.fem.geometry import build_mesh
    from fenics_ehd.fem.material import Material
    from fenics_ehd.fem.structure import assemble_structure

    mesh = build_mesh(
        model_file(settings, key),
        settings.geometry,
        comm=comm,
        serendipity_geometry=settings.element == "serendipity",
        cells=settings.cells,
        bores=settings.bores,
        size=size,
    )
    material = settings.material
    return assemble_structure(
        mesh,
        Material(material.youngs_modulus, material.poissons_ratio, material.density),
        family=settings.element,
        pressure_family=pressure_family(film_element),
        bores=settings.bores,
        attachments=settings.points,
        clamped=None if settings.held_by == NONE else settings.held_by,
    )
