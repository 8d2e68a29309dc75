"""From the settings of a housing to its reduced body."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mpi4py import MPI

from fenics_ehd.reduction import ReducedBody, Structure
from fenics_ehd.scenes import part
from fenics_ehd.scenes.part import ReducedPart, model_file, pressure_family, reduce_structure
from fenics_ehd.scenes.rotor_settings import RotorSettings

#: Named surface of the model by which the housing is held.
FOOT = "foot"


def build_structure(settings: RotorSettings, comm: MPI.Comm) -> Structure:
    """Mesh the housing, assemble its matrices and hold its foot, on every rank of `comm`."""
    from fenics_ehd.geometry import build_mesh
    from fenics_ehd.structure import Material, assemble_structure

    housing = settings.housing
    mesh = build_mesh(
        model_file(housing, "housing"),
        housing.geometry,
        comm=comm,
        serendipity_geometry=housing.element == "serendipity",
    )
    return assemble_structure(
        mesh,
        Material(housing.youngs_modulus, housing.poissons_ratio, housing.density),
        family=housing.element,
        pressure_family=pressure_family(settings.film.element),
        attachments=(),
        clamped=FOOT,
    )


def reduce_housing(
    settings: RotorSettings,
    comm: MPI.Comm = MPI.COMM_WORLD,
    check: Callable[[Structure], None] | None = None,
) -> ReducedPart:
    """Mesh, assemble and reduce the housing.

    Parameters
    ----------
    settings
        The scene.
    comm
        Ranks that share the work.
    check
        Called with the structure before its reduction, on every rank, to refuse it.

    Raises
    ------
    MeshError, SettingsError, SolverError
        From the mesh, the settings and the solvers.
    """
    return part.reduce_part(
        lambda: build_structure(settings, comm),
        lambda structure: reduce_structure(structure, settings.reduction),
        origin(settings),
        check,
    )


def origin(settings: RotorSettings) -> dict[str, str]:
    """What a body depends on, see `part.origin`."""
    housing = settings.housing
    model = model_file(housing, "housing")
    return part.origin(housing, model, settings.film.element, settings.reduction)


def check_origin(body: ReducedBody, settings: RotorSettings, tables: Mapping) -> None:
    """See `part.check_origin`."""
    part.check_origin(body, origin(settings), tables, "housing")
