"""Gmsh models to dolfinx meshes."""

from __future__ import annotations

import signal
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import basix
import gmsh
from dolfinx.mesh import Mesh
from mpi4py import MPI

from fenics_ehd import compat
from fenics_ehd.errors import MeshError

#: Gmsh's number of the 27-node hexahedron.
_HEXAHEDRON_27 = 12


@dataclass(frozen=True, eq=False)
class PartMesh:
    """Second-order hexahedral mesh with the numbers of its named groups."""

    mesh: Mesh
    cell_tags: compat.MeshTags
    facet_tags: compat.MeshTags
    groups: Mapping[str, int]

    def group(self, name: str) -> int:
        """Number of a named physical group.

        Raises
        ------
        MeshError
            The model has no group of this name.
        """
        if name not in self.groups:
            raise MeshError(
                f"the mesh has no physical group {name!r} (it has {', '.join(self.groups)}): "
                f"name the surface in the Gmsh model, Physical Surface({name!r})"
            )
        return self.groups[name]


def model_path(name: str) -> Path:
    """Path of a Gmsh model shipped with the package, ``"conrod"`` for instance."""
    return Path(str(resources.files("fenics_ehd.meshes") / f"{name}.geo"))


def _parameter_names(path: Path) -> dict[str, str]:
    """ONELAB name of every parameter of a model, by its last part."""
    gmsh.onelab.clear()
    gmsh.open(str(path))
    names = gmsh.onelab.getNames()
    gmsh.clear()
    # Values survive in ONELAB, so those of a former model would override this one's.
    gmsh.onelab.clear()
    return {name.rsplit("/", 1)[-1]: name for name in names}


def _initialize_gmsh() -> None:
    """Start Gmsh without letting it take Ctrl-C away from Python, as newer versions do."""
    former = signal.getsignal(signal.SIGINT)
    gmsh.initialize([""])
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, former)


def _generate(path: Path, parameters: Mapping[str, float]) -> dict[str, int]:
    """Mesh a model in a fresh Gmsh session; the caller finalises Gmsh."""
    _initialize_gmsh()
    gmsh.option.setNumber("General.Terminal", 0)
    if parameters:
        names = _parameter_names(path)
        for key, value in parameters.items():
            if key not in names:
                raise MeshError(
                    f"model {path.name} has no parameter {key!r}; it has {', '.join(names)}"
                )
            gmsh.onelab.setNumber(names[key], [float(value)])
    gmsh.open(str(path))
    if not gmsh.model.mesh.getNodes()[0].size:
        gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    return {
        gmsh.model.getPhysicalName(*group): group[1] for group in gmsh.model.getPhysicalGroups()
    }


def build_mesh(
    path: str | Path,
    parameters: Mapping[str, float] | None = None,
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    serendipity_geometry: bool = True,
) -> PartMesh:
    """Mesh a Gmsh model on rank 0 and distribute it.

    Parameters
    ----------
    path
        A ``.geo`` model or a ``.msh`` file.
    parameters
        Values for the model's ``DefineConstant`` parameters, by name.
    comm
        Communicator the mesh is distributed over.
    serendipity_geometry
        Put face and cell centres where the 20 edge and corner nodes put them,
        which a 20-node element needs to represent linear fields.

    Returns
    -------
    PartMesh

    Raises
    ------
    MeshError
        Gmsh cannot read or mesh the model, or it holds no hexahedra.
    """
    groups, failure = None, None
    if comm.rank == 0:
        try:
            groups = _generate(Path(path), parameters or {})
            if not len(gmsh.model.mesh.getElementsByType(_HEXAHEDRON_27)[0]):
                failure = f"model {path} gives no hexahedra: check its numbers of cells"
            elif not gmsh.model.getPhysicalGroups(3):
                failure = f"model {path} has no physical volume: name the part's solid"
        except MeshError as error:
            failure = str(error)
        except Exception as error:  # Gmsh raises plain Exception
            failure = f"Gmsh cannot mesh {path}: {error}"
    failure, groups = comm.bcast((failure, groups))
    try:
        if failure:
            raise MeshError(failure)
        mesh, cell_tags, facet_tags = compat.model_to_mesh(gmsh.model, comm)
    finally:
        if comm.rank == 0:
            gmsh.finalize()
    if serendipity_geometry:
        _place_centre_nodes(mesh)
    return PartMesh(mesh, cell_tags, facet_tags, groups)


def _place_centre_nodes(mesh: Mesh) -> None:
    """Move face and cell centres of 27-node hexahedra to the 20-node interpolation."""
    topology = basix.topology(basix.CellType.hexahedron)
    edges = {frozenset(edge): 8 + i for i, edge in enumerate(topology[1])}
    nodes = compat.geometry_dofmap(mesh)
    x = mesh.geometry.x
    for i, face in enumerate(topology[2]):
        sides = [number for edge, number in edges.items() if edge <= set(face)]
        corners, middles = (x[nodes[:, part]].sum(axis=1) for part in (face, sides))
        x[nodes[:, 20 + i]] = -0.25 * corners + 0.5 * middles
    x[nodes[:, 26]] = -0.25 * x[nodes[:, :8]].sum(axis=1) + 0.25 * x[nodes[:, 8:20]].sum(axis=1)
