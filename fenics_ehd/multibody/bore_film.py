"""Between the coordinates of a reduced body and the film in its bore.

Where bore and film meshes match, shape functions of the bore are evaluated at
the film's Gauss points and nothing else is needed. Where they do not, pressures
go to the bore either conservatively, ``F = int N_s n p``, with resultants that
are the film's own, or by the paper's mortar (14) and the body's load matrix.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from fenics_ehd.errors import InterfaceMismatchError
from fenics_ehd.film import Film, FilmGrid
from fenics_ehd.film.layout import film_grid, film_layout, match
from fenics_ehd.film.surface import Surface
from fenics_ehd.film.transfer import Mortar, outward_displacement
from fenics_ehd.reduction.body import ReducedBody

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
    return grid.family == (body.pressure_family or film_layout(body.pressure_nodes)[1])


def load_projections(body: ReducedBody) -> tuple[np.ndarray, np.ndarray]:
    """Load and spin load projection of a body with rows for its residual patterns too."""
    residual = body.residual
    if residual is None:
        return body.load_projection, body.spin_load_projection
    own = residual.stiffness[:, None] * residual.patterns
    # The moment on a deformation as small as this one does not matter.
    return (
        np.vstack([body.load_projection, own]),
        np.vstack([body.spin_load_projection, np.zeros_like(own)]),
    )


class BoreFilm:
    """Linear maps of one film in the bore of one body.

    Fields of the bore are, in order, its position, the unit translations along
    x and y, the elastic modes, as in `InertiaIntegrals`, and the residual patterns
    of M4: f = 3 + n + r of them.

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
        Components of the fields but the first at the Gauss points, shape
        (cells, points, f - 1).
    normal
        Outward displacement at the Gauss points of displacements of the bore nodes, sparse,
        shape (g, 3 m).
    watched_normal
        The same where the gap is watched, shape (w, 3 m).
    projected
        Mortar from the film's nodal pressures to the bore's, None where there is none.
    watched
        Outward component at Gauss points and film nodes, where the gap is
        watched, shape (w, f - 1).
    load, spin_load
        Generalised force of nodal film pressures on the fields, and their
        moment about z, shape (f, nodes).

    Raises
    ------
    InterfaceMismatchError
        The bore is not the film's cylinder, or the body's load matrix does not
        belong to it.
    """

    def __init__(self, body: ReducedBody, film: Film, transfer: str = "conservative"):
        grid = film.parameters.grid
        self._check_size(body, film)
        surface = bore_surface(body.bore_nodes, body.bore_cells, body.bore_family)
        m = len(body.bore_nodes)
        rigid = np.zeros((m, 3, 3))
        rigid[:, :, 0] = body.bore_nodes
        rigid[:, 0, 1] = rigid[:, 1, 2] = 1.0
        fields = np.concatenate([rigid, body.bore_basis], axis=2)
        if body.residual is not None:
            fields = np.concatenate([fields, body.residual.displacement], axis=2)
        # e_z x: (x, y) to (-y, x), node by node.
        spin = np.zeros_like(fields)
        spin[:, 0], spin[:, 1] = -fields[:, 1], fields[:, 0]
        angle, height = film.points.angle.ravel(), film.points.height.ravel()
        normal = self.normal = outward_displacement(surface, angle, height)
        flat, spin = (x.reshape(3 * m, -1) for x in (fields, spin))
        shape = (*film.points.angle.shape, -1)
        outward = normal @ flat
        # n . (e_z x u) is minus the component of u along the circumference.
        turned = normal @ spin
        self.outward = outward[:, 1:].reshape(shape)
        self.tangential = -turned[:, 1:].reshape(shape)
        nodes = outward_displacement(surface, *grid.node_positions.T)
        self.watched_normal = sparse.vstack([normal, nodes]).tocsr()
        self.watched = np.vstack([outward, nodes @ flat])[:, 1:]
        self._order = match(body.pressure_nodes, grid.nodes) if _same_family(body, grid) else None
        self._mortar = self._mortar_of(body, grid) if self._order is None else None
        self.load = film.load(outward.reshape(shape))
        self.spin_load = film.load(turned.reshape(shape))
        self.projected: np.ndarray | None = None
        if transfer == "mortar" and self._mortar is not None:
            matrix = self.projected = self._mortar.matrix()
            self.load, self.spin_load = (x @ matrix for x in load_projections(body))
        self._check_load(body, film)

    @staticmethod
    def _check_size(body: ReducedBody, film: Film) -> None:
        grid = film.parameters.grid
        for name, own, given in (
            ("radius", grid.radius, body.bore_radius),
            ("width", grid.width, body.bore_width),
        ):
            if not abs(own - given) <= 1e-6 * given:
                raise InterfaceMismatchError(
                    f"the film's {name} of {own:g} m is not that of the bore, {given:g} m"
                )

    def _mortar_of(self, body: ReducedBody, grid: FilmGrid) -> Mortar:
        structure = bore_surface(body.pressure_nodes, body.pressure_cells, body.pressure_family)
        film = Surface(grid.node_positions, grid.cell_nodes, grid.family)
        return Mortar(structure, film, grid.radius)

    @property
    def matching(self) -> bool:
        """Whether the body's pressure nodes are those of the film."""
        return self._mortar is None

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
            own = self.load[1:3] @ pressure
            expected = body.load_projection[1:3] @ self.structure_pressure(pressure)
            defect = np.abs(own - expected).max() / np.abs(expected).max()
            if not defect <= LOAD_TOLERANCE:
                raise InterfaceMismatchError(
                    f"film and body disagree on the work of a pressure by {defect:.1e} "
                    f"(relative, component {component}), above {LOAD_TOLERANCE:.0e}: the body's "
                    "load matrix does not belong to its bore"
                )
