"""Between the coordinates of a reduced body and the film in its bore.

Where bore and film meshes match, shape functions of the bore are evaluated at
the film's Gauss points and nothing else is needed. Where they do not, pressures
go to the bore either conservatively, ``F = int N_s n p``, with resultants that
are the film's own, or by the paper's mortar (14) and the body's load matrix.

A bore may have holes. The gap in one follows the bore as extended from the rim
(`fenics_ehd.film.surface_reading`). The film's pressure there bends nothing: elastic modes are
loaded on the remaining surface alone, as in the body's own matrix. It is part of the force between
journal and body, for the oil in the hole presses on the far end of its passage.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import InterfaceMismatchError
from fenics_ehd.film import Film, FilmGrid
from fenics_ehd.film.layout import film_grid, film_layout, match
from fenics_ehd.film.surface import Surface
from fenics_ehd.film.transfer import Mortar, outward_displacement, solid_share
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.inertia import TRANSLATIONS
from fenics_ehd.reduction.rigid_motion import turned

#: Largest difference of the film's load from the body's own, relative to the largest, of a cosine
#: pressure. The body integrates over its quadratic cells, 1e-5 off the cylinder with 20 of them.
LOAD_TOLERANCE = 5e-4


def bore_surface(nodes: np.ndarray, cells: np.ndarray, family: str) -> Surface:
    """Surface mesh of a body's bore; a body without cells must have a structured one."""
    if cells.size:
        return Surface.on_cylinder(nodes, cells, family)
    grid = film_grid(nodes)
    order = match(grid.nodes, nodes)
    assert order is not None
    return Surface.on_cylinder(nodes, order[grid.cell_nodes], grid.family)


def _same_family(body: ReducedBody, grid: FilmGrid) -> bool:
    """Whether equal nodal pressures are one pressure: 4-node cells may have 9-node cells' nodes."""
    return grid.family == (body.bore.pressure_family or film_layout(body.pressure_nodes)[1])


class BoreFilm:
    """Linear maps of one film in the bore of one body.

    Parameters
    ----------
    body
        Reduced body.
    film
        Film on its bore.
    transfer
        How pressures reach a bore whose mesh the film's does not match.

    Attributes
    ----------
    outward, tangential
        Components of the elastic modes at the Gauss points, shape (g, n).
    normal
        Outward displacement at the Gauss points of displacements of the bore nodes, sparse,
        shape (g, 3 m).
    observed_normal
        The same where the gap is observed, shape (w, 3 m).
    projected
        Mortar from the film's nodal pressures to the bore's, None where there is none.
    observed
        Outward component at Gauss points and film nodes, where the gap is
        observed, shape (w, n).
    force, load
        Force of nodal film pressures along x and y, shape (2, nodes), and generalised forces on
        the elastic modes, shape (n, nodes).
    holes, solid
        Holes of the bore's mesh, and what they leave of every Gauss point's area, shape (cells,
        points); None: the bore is whole.

    Raises
    ------
    InterfaceMismatchError
        The bore is not the film's cylinder, or the body's load matrix does not
        belong to it.
    """

    def __init__(self, body: ReducedBody, film: Film, transfer: str = "conservative"):
        grid = film.parameters.grid
        self._check_size(body, film)
        surface = bore_surface(body.bore_nodes, body.bore.cells, body.bore.family)
        m = len(body.bore_nodes)
        # Unit translations along x and y, then the elastic modes.
        fields = np.zeros((m, 3, 2 + body.modes))
        fields[:, 0, 0] = fields[:, 1, 1] = 1.0
        fields[:, :, 2:] = body.bore_basis
        fields = fields.reshape(3 * m, -1)
        angle, height = film.points.angle.ravel(), film.points.height.ravel()
        normal = self.normal = outward_displacement(surface, angle, height)
        outward = normal @ fields
        self.outward = outward[:, 2:]
        # n . (e_z x u) is minus the component of u along the circumference.
        self.tangential = -(normal @ turned(fields[:, 2:], 2))
        nodes = outward_displacement(surface, *grid.node_positions.T)
        self.observed_normal = sparse.vstack([normal, nodes]).tocsr()
        self.observed = np.vstack([outward, nodes @ fields])[:, 2:]
        self._order = match(body.pressure_nodes, grid.nodes) if _same_family(body, grid) else None
        self._mortar = self._mortar_of(body, grid) if self._order is None else None
        fields = outward.reshape(*film.points.angle.shape, -1)
        self.holes, self.solid, whole = surface.holes, None, None
        if surface.holes:
            mesh = Surface(grid.node_positions, grid.cell_nodes, grid.family)
            self.solid = solid_share(surface, mesh, film.assembly.tensors.points)
            whole, fields = film.load(fields[..., :2]), self.solid[..., None] * fields
        load = film.load(fields)
        self.projected: np.ndarray | None = None
        if transfer == "mortar" and self._mortar is not None:
            matrix = self.projected = self._mortar.matrix()
            load = body.load_projection[1:] @ matrix
        self.force, self.load = load[:2], load[2:]
        self._check_load(body, film)
        if whole is not None:
            self.force = whole

    @staticmethod
    def _check_size(body: ReducedBody, film: Film) -> None:
        grid = film.parameters.grid
        for name, own, given in (
            ("radius", grid.radius, body.bore.radius),
            ("width", grid.width, body.bore.width),
        ):
            if not abs(own - given) <= 1e-6 * given:
                raise InterfaceMismatchError(
                    f"the film's {name} of {own:g} m is not that of the bore, {given:g} m"
                )

    def _mortar_of(self, body: ReducedBody, grid: FilmGrid) -> Mortar:
        structure = bore_surface(
            body.pressure_nodes, body.bore.pressure_cells, body.bore.pressure_family
        )
        film = Surface(grid.node_positions, grid.cell_nodes, grid.family)
        return Mortar(structure, film, grid.radius)

    def structure_pressure(self, pressure: np.ndarray) -> np.ndarray:
        """Pressure on the body's pressure nodes, shape (k,): ``P_s`` of (14)."""
        if self._mortar is not None:
            return self._mortar.to_structure(pressure)
        return pressure[self._order]

    def _check_load(self, body: ReducedBody, film: Film) -> None:
        """A smooth pressure must do the same work by the film's integrals and by the body's J."""
        grid = film.parameters.grid
        for angle_of, component in ((np.cos, 1), (np.sin, 2)):
            pressure = 1.0 + angle_of(grid.node_positions[:, 0])
            own = self.force @ pressure
            expected = body.load_projection[TRANSLATIONS] @ self.structure_pressure(pressure)
            defect = np.abs(own - expected).max() / np.abs(expected).max()
            if not defect <= LOAD_TOLERANCE:
                raise InterfaceMismatchError(
                    f"film and body disagree on the work of a pressure by {defect:.1e} "
                    f"(relative, component {component}), above {LOAD_TOLERANCE:.0e}: the body's "
                    "load matrix does not belong to its bore"
                )
