"""Elastic bores: the bore of a reduced body as one surface of a film.

If the meshes of a body's bore and of its film match, shape functions of the bore are evaluated at
the Gauss points of the film. If they do not match, pressures are transferred to the bore in one of
two ways: conservatively, ``F = int N_s n p``, with the resultants of the film; or by the mortar,
equation (14) of the paper, with the body's load matrix.

A bore may have holes. The gap in a hole is that of the bore surface extended from the rim
(`fenics_ehd.film.transfer`). Pressure in a hole does not load the elastic modes, as in the body's
load matrix. It is part of the force between journal and body, because the oil in the hole presses
on the far end of its passage.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from fenics_ehd.base.arguments import require_class, require_word
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import InterfaceMismatchError
from fenics_ehd.base.fields import TRANSFERS
from fenics_ehd.film.film import Film
from fenics_ehd.film.grid import FilmGrid, film_grid, film_layout, match, uniform_grid
from fenics_ehd.film.transfer import (
    Mortar,
    interpolation_matrix,
    outward_displacement,
    solid_share,
)
from fenics_ehd.film.transfer import Surface as SurfaceMesh
from fenics_ehd.multibody.surface import (
    Compliance,
    MissingFlexibility,
    Side,
    Surface,
    SurfaceRows,
    observed_positions,
)
from fenics_ehd.reduction.body import (
    TRANSLATIONS,
    ReducedBody,
    ResidualFlexibility,
    bore_fields,
)
from fenics_ehd.reduction.bore import SAMPLED, BoreSurface, turned
from fenics_ehd.reduction.mesh_error import smooth_part

#: Largest difference between the loads of a cosine pressure by the film and by the body, over the
#: largest load. The body integrates over quadratic cells, whose areas differ from those of the
#: cylinder by 1e-5 with 20 cells.
LOAD_TOLERANCE = 5e-4


def bore_surface(nodes: np.ndarray, cells: np.ndarray, family: str) -> SurfaceMesh:
    """Make the surface mesh of a body's bore from its nodes [m] and cells.

    If `cells` is empty, the nodes must be those of a structured mesh.
    """
    if cells.size:
        return SurfaceMesh.on_cylinder(nodes, cells, family)
    grid = film_grid(nodes)
    order = match(grid.nodes, nodes)
    assert order is not None
    return SurfaceMesh.on_cylinder(nodes, order[grid.cell_nodes], grid.family)


def sampling_grid(bore: BoreSurface) -> FilmGrid:
    """Film mesh at whose nodes the mesh error of a part's bore is stored."""
    return uniform_grid(bore.radius, bore.width, SAMPLED)


class BoreFilm(Described):
    """Linear maps between a film and the elastic modes of the bore of a reduced body.

    Parameters
    ----------
    body
        Reduced body.
    film
        Film on the body's bore.
    transfer
        Transfer of pressures to a bore whose mesh does not match that of the film, one of
        `TRANSFERS`.

    Attributes
    ----------
    outward, tangential
        Outward and tangential components of the elastic modes at the Gauss points, shape (g, n)
        each.
    normal
        Sparse matrix from displacements of the bore nodes to outward displacements at the Gauss
        points, shape (g, 3 m).
    observed_normal
        Sparse matrix from displacements of the bore nodes to outward displacements at Gauss points
        and film nodes, shape (w, 3 m).
    projected
        Mortar matrix from nodal pressures of the film to nodal pressures of the bore; None without
        mortar.
    observed
        Outward components of the elastic modes at Gauss points and film nodes, shape (w, n).
    force, load
        Force along x and y for unit nodal pressures of the film, shape (2, nodes), and generalised
        forces on the elastic modes, shape (n, nodes).
    holes, solid
        Holes of the bore's mesh, and solid fraction of the area of every Gauss point, shape (cells,
        points). The fraction is None if the bore has no holes.

    Raises
    ------
    InterfaceMismatchError
        If the bore is not the film's cylinder, or the body's load matrix does not belong to the
        bore.
    """

    def __init__(self, body: ReducedBody, film: Film, transfer: str = "conservative"):
        require_class("body", body, ReducedBody)
        require_class("film", film, Film)
        require_word("transfer", transfer, TRANSFERS)
        grid = film.parameters.grid
        self._check_size(body, film)
        mesh = bore_surface(body.bore_nodes, body.bore.cells, body.bore.family)
        m = len(body.bore_nodes)
        # Columns are unit translations along x and y, then the elastic modes.
        fields = np.zeros((m, 3, 2 + body.modes))
        fields[:, 0, 0] = fields[:, 1, 1] = 1.0
        fields[:, :, 2:] = body.bore_basis
        fields = fields.reshape(3 * m, -1)
        inside = film.points.angle.size
        self.observed_normal = outward_displacement(mesh, *observed_positions(film))
        normal = self.normal = self.observed_normal[:inside]
        self.observed = (self.observed_normal @ fields)[:, 2:]
        outward = normal @ fields
        self.outward = self.observed[:inside]
        # n . (e_z x u) is minus the component of u along the circumference.
        self.tangential = -(normal @ turned(fields[:, 2:], 2))
        # Meshes of 4-node and of 9-node cells may have the same nodes, but other shape functions.
        family = body.bore.pressure_family or film_layout(body.pressure_nodes)[1]
        alike = grid.family == family
        self._order = match(body.pressure_nodes, grid.nodes) if alike else None
        self._mortar = self._mortar_of(body, grid) if self._order is None else None
        fields = outward.reshape(*film.points.angle.shape, -1)
        self.holes = mesh.holes
        self.solid = None
        force_with_holes = None
        if mesh.holes:
            of_film = SurfaceMesh(grid.node_positions, grid.cell_nodes, grid.family)
            self.solid = solid_share(mesh, of_film, film.assembly.reference)
            force_with_holes = film.load(fields[..., :2])
            fields = self.solid[..., None] * fields
        load = film.load(fields)
        self.projected: np.ndarray | None = None
        if transfer == "mortar" and self._mortar is not None:
            matrix = self.projected = self._mortar.to_structure(np.eye(len(grid.nodes)))
            load = body.load_projection[1:] @ matrix
        self.force = load[:2]
        self.load = load[2:]
        self._check_load(body, film)
        if force_with_holes is not None:
            self.force = force_with_holes

    @staticmethod
    def _check_size(body: ReducedBody, film: Film) -> None:
        grid = film.parameters.grid
        for name, of_film, of_bore in (
            ("radius", grid.radius, body.bore.radius),
            ("width", grid.width, body.bore.width),
        ):
            if not abs(of_film - of_bore) <= 1e-6 * of_bore:
                raise InterfaceMismatchError(
                    f"the film's {name} of {of_film:g} m must be that of the bore, {of_bore:g} m"
                )

    def _mortar_of(self, body: ReducedBody, grid: FilmGrid) -> Mortar:
        structure = bore_surface(
            body.pressure_nodes, body.bore.pressure_cells, body.bore.pressure_family
        )
        film = SurfaceMesh(grid.node_positions, grid.cell_nodes, grid.family)
        return Mortar(structure, film, grid.radius)

    def structure_pressure(self, pressure: np.ndarray) -> np.ndarray:
        """Pressures at the body's k pressure nodes from those at the film's nodes, (k,) [Pa].

        Between meshes that do not match, pressures are projected by the mortar, equation (14).
        """
        if self._mortar is not None:
            return self._mortar.to_structure(pressure)
        return pressure[self._order]

    def _check_load(self, body: ReducedBody, film: Film) -> None:
        """Refuse a body's load matrix whose force for a smooth pressure differs from the film's."""
        grid = film.parameters.grid
        for angle_of, component in ((np.cos, 1), (np.sin, 2)):
            pressure = 1.0 + angle_of(grid.node_positions[:, 0])
            of_film = self.force @ pressure
            expected = body.load_projection[TRANSLATIONS] @ self.structure_pressure(pressure)
            defect = np.abs(of_film - expected).max() / np.abs(expected).max()
            if not defect <= LOAD_TOLERANCE:
                raise InterfaceMismatchError(
                    "the film's matrix and the body's load matrix give different forces for the "
                    f"same smooth pressure: relative difference {defect:.1e} (test pressure "
                    f"{component} of 2), above {LOAD_TOLERANCE:.0e}: the load matrix does not "
                    "belong to the bore"
                )


def _mean_translation(film: Film, outward: np.ndarray, tangential: np.ndarray) -> np.ndarray:
    """Tangential component of the bore's mean translation in every mode, shape (g, n).

    Components are those at the g Gauss points. `outward` and `tangential` are the components of the
    n modes there, shape (g, n) each.
    """
    cosine, sine = (x.ravel()[:, None] for x in film.points.normal)
    area = film.assembly.area.ravel() / film.assembly.area.sum()
    x = area @ (cosine * outward - sine * tangential)
    y = area @ (sine * outward + cosine * tangential)
    return cosine * y - sine * x


class ElasticBore(Surface):
    """Bore of a reduced body, with the body's elastic modes and residual patterns.

    Parameters
    ----------
    body, point
        Reduced body, and name of its bore.
    side
        Side of the film.
    damping_time
        Structural damping zeta of the body [s].

    Attributes
    ----------
    body, point, damping_time
        Arguments of the constructor.
    centre
        Centre of the undeformed bore in the frame of the part, shape (3,) [m].
    part
        Reduced body with this bore only.
    maps
        Linear maps between the film and the elastic modes of the body.
    """

    elastic = True

    def __init__(self, body: ReducedBody, point: str, side: Side, damping_time: float = 0.0):
        super().__init__(side, body.modes)
        self.body = body
        self.point = point
        self.part = body.at_bore(point)
        self.centre = self.part.bore.centre
        self.damping_time = damping_time
        self.maps = BoreFilm(self.part, side.film, side.transfer)

    @property
    def mortar(self) -> bool:  # type: ignore[override]
        """Whether a mortar transfers pressures, because bore and film meshes do not match."""
        return self.maps.projected is not None

    @property
    def rows(self) -> SurfaceRows:
        """Constant linear maps between the film and the amplitudes of the elastic modes.

        The film moves with the mean translation of the bore. The mean velocity of the surfaces is
        relative to the film: the mean translation in every mode is subtracted from it.
        """
        maps = self.maps
        carried = _mean_translation(self.side.film, maps.outward, maps.tangential)
        mean = 0.5 * maps.tangential - carried
        return SurfaceRows(maps.observed, mean, -maps.tangential, maps.load, maps.force)

    @property
    def compliance(self) -> Compliance | None:
        """Residual patterns of the part at this bore (M4); None if the part has none."""
        residual = self.part.residual
        if residual is None or not residual.rank:
            return None
        maps = self.maps
        m = len(residual.displacement)
        shapes = residual.displacement[:, :2].reshape(2 * m, -1)
        plane = (3 * np.arange(m)[:, None] + np.arange(2)).ravel()
        to_gap = maps.normal[:, plane].tocsr()
        to_observed = maps.observed_normal[:, plane].tocsr()
        if maps.projected is not None:
            # Pressures that the mortar transfers load the bore by the body's own load matrix.
            from_pressure = sparse.csr_matrix(maps.projected)
            from_forces = sparse.csr_matrix((from_pressure.shape[0], to_gap.shape[0]))
            amplitudes = residual.patterns
        else:
            amplitudes = np.ascontiguousarray(shapes.T / residual.stiffness[:, None])
            area = sparse.csr_matrix(self.side.film.pressure_areas)
            if maps.solid is not None:
                area = sparse.diags(maps.solid.ravel()) @ area
            from_forces = to_gap.T.tocsr()
            from_pressure = (from_forces @ area).tocsr()
        return Compliance(
            shapes,
            amplitudes,
            to_gap,
            to_observed,
            from_pressure,
            from_forces,
            residual.stiffness,
            self.damping_time,
        )

    def missing_flexibility(self, component: str) -> MissingFlexibility:
        """Flexibility that is missing in the basis or in the mesh of the body.

        See `Surface.missing_flexibility`.
        """
        return self._missing_in_basis if component == "basis" else self._missing_in_mesh

    @property
    def _missing_in_basis(self) -> MissingFlexibility:
        """Flexibility that the basis of the body lacks at this bore.

        With M4 it includes the effect of the neglected inertia of residual patterns.
        """
        missing = self.body.missing_flexibility_at(self.point)
        # Matrix from outward displacements of the bore's nodes to their x, y and z components.
        radial = self.part.bore_nodes * [1.0, 1.0, 0.0]
        radial /= np.linalg.norm(radial, axis=1)[:, None]
        nodes = np.repeat(np.arange(len(radial)), 3)
        outward = sparse.csr_matrix((radial.ravel(), (np.arange(radial.size), nodes)))
        to_observed = self.maps.observed_normal @ outward
        residual = self.part.residual
        if residual is None or not residual.mass.size:
            return MissingFlexibility(missing, to_observed, self.damping_time)
        inertia = neglected_inertia(self.part, residual)
        slowest = slowest_pattern(residual)
        return MissingFlexibility(missing, to_observed, self.damping_time, inertia, slowest)

    @property
    def _missing_in_mesh(self) -> MissingFlexibility:
        """Flexibility that the mesh of the part lacks at this bore.

        Loads are pressures on the bores of the part, and forces on its points.
        """
        missing = self.body.mesh_flexibility
        if not missing.size:
            return MissingFlexibility(missing, sparse.csr_matrix((0, 0)), self.damping_time)
        bores = self.body.bores
        error = np.vsplit(missing, len(bores))[[*bores].index(self.point)]
        smooth = smooth_part(bores)
        pressed, forced = np.split(error, [len(smooth)], axis=1)
        error = np.hstack([pressed @ smooth, forced])
        grid = sampling_grid(bores[self.point])
        surface = bore_surface(grid.nodes, grid.cell_nodes, grid.family)
        to_observed = interpolation_matrix(surface, *observed_positions(self.side.film))
        return MissingFlexibility(error, to_observed, self.damping_time)

    def displacement(self, angle: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Displacement of the bore in elastic modes and residual patterns.

        See `Surface.displacement`.
        """
        bore = self.part.bore
        surface = bore_surface(bore.coordinates, bore.cells, bore.family)
        fields = bore_fields(self.part)
        moved = interpolation_matrix(surface, angle, height) @ fields.reshape(len(fields), -1)
        return moved.reshape(len(angle), 3, -1)

    def nodal_forces(
        self, pressure: np.ndarray, contact: np.ndarray | float, angles: np.ndarray
    ) -> np.ndarray:
        """Forces of a film on the nodes of the bore, see `Surface.nodal_forces`."""
        forces = self.side.film.pressure_areas @ pressure
        if self.maps.solid is not None:
            forces *= self.maps.solid.reshape(-1, 1)
        forces += contact
        return (self.maps.normal.T @ forces).T.reshape(len(angles), -1, 3)

    def loads(self, pressure: np.ndarray, angle: float) -> np.ndarray:
        """Pressures at the pressure nodes of all bores of the part, see `Surface.loads`."""
        loads = np.zeros(self.body.load_projection.shape[1])
        loads[self.body.rows_of(self.point).pressures] = self.maps.structure_pressure(pressure)
        return loads


def neglected_inertia(body: ReducedBody, residual: ResidualFlexibility) -> np.ndarray:
    """Gap error due to the neglected inertia of r residual patterns, per acceleration, (m, r).

    It is the outward displacement of the bore's m nodes in the static response of the residual
    patterns to their inertia force ``-M_rr y''``, with the accelerations ``y''`` of their
    amplitudes.
    """
    shape = body.outward(residual.displacement)
    return (shape / residual.stiffness) @ residual.mass


def slowest_pattern(residual: ResidualFlexibility) -> float:
    """Time constant ``1 / omega`` of the slowest residual pattern, from stiffness and mass [s]."""
    root = 1.0 / np.sqrt(residual.stiffness)
    return float(np.sqrt(np.linalg.norm(root[:, None] * residual.mass * root, 2)))
