"""From the settings of a rod to its reduced body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

from mpi4py import MPI

from fenics_ehd.errors import SettingsError
from fenics_ehd.reduction import LoadDependentBasis, ReducedBody, Structure, load_dependent
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings


@dataclass(frozen=True, eq=False)
class ReducedRod:
    """A reduced rod, and what only displacement fields need.

    `structure` and `basis` stay distributed over the ranks that reduced the rod.
    """

    body: ReducedBody
    structure: Structure
    basis: LoadDependentBasis
    seconds: float


def _model(settings: SliderCrankSettings) -> Path:
    from fenics_ehd.geometry import model_path

    name = settings.rod.model
    path = Path(name) if Path(name).suffix else model_path(name)
    if not path.is_file():
        raise SettingsError(f"rod.model = {name!r}: there is no file {path}")
    return path


def build_structure(settings: SliderCrankSettings, comm: MPI.Comm) -> Structure:
    """Mesh the rod and assemble its matrices, on every rank of `comm`."""
    from fenics_ehd.geometry import build_mesh
    from fenics_ehd.structure import Material, assemble_structure

    rod = settings.rod
    part = build_mesh(
        _model(settings), rod.geometry, comm=comm,
        serendipity_geometry=rod.element == "serendipity",
    )  # fmt: skip
    material = Material(rod.youngs_modulus, rod.poissons_ratio, rod.density)
    return assemble_structure(
        part, material, family=rod.element, pressure_family=settings.film.element
    )


def reduce_rod(settings: SliderCrankSettings, comm: MPI.Comm = MPI.COMM_WORLD) -> ReducedRod:
    """Mesh, assemble and reduce the rod.

    Raises
    ------
    MeshError, SettingsError, SolverError
        From the mesh, the settings and the solvers.
    """
    start = perf_counter()
    structure = build_structure(settings, comm)
    reduction = settings.reduction
    rigid = reduction.method == "rigid"
    body, basis = load_dependent(
        structure,
        0 if rigid else reduction.vibration_modes,
        0 if rigid else reduction.residual_modes,
        reduction.pressure_set,
        reduction.selection,
        estimate_error=reduction.estimate_error,
    )
    if rigid:
        body = body.rigid()
    rod = settings.rod
    origin = {
        "model": rod.model,
        "element": rod.element,
        "film_element": settings.film.element,
        "youngs_modulus": repr(rod.youngs_modulus),
        "poissons_ratio": repr(rod.poissons_ratio),
        "density": repr(rod.density),
        **{f"geometry.{name}": repr(value) for name, value in rod.geometry.items()},
    }
    body = replace(body, provenance={**body.provenance, **origin})
    return ReducedRod(body, structure, basis, perf_counter() - start)
