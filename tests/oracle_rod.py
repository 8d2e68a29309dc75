"""The connecting rod a second time, from Gmsh's nodes and cells, numpy and scipy alone.

Textbook 20-node hexahedra, the saddle-point system of the static responses as
printed in (29) of Krinner and Rixen, dense algebra after that: short, serial,
and sharing nothing with the package but the record that a simulation reads.

Matrices are sums over all quadrature points at once, ``D^T W D`` with sparse
``D`` that samples nodal values or their derivatives at the points. Displacements
are numbered ``3 * node + component``; n nodes, m of them on the bore, k pressure
nodes. SI units.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import gmsh
import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, eigsh, splu

import fenics_ehd as ehd
from fenics_ehd.reduction.body import InertiaIntegrals
from fenics_ehd.reduction.bore import BoreSurface

MODEL = Path(__file__).resolve().parents[1] / "meshes" / "conrod.geo"
GEOMETRY = {"bore_radius": 0.0225, "rod_length": 0.16, "pin_radius": 0.012}
MATERIAL = {"youngs_modulus": 210e9, "poissons_ratio": 0.3, "density": 7850.0}
QUADRILATERAL_9, HEXAHEDRON_27 = 10, 12  # Gmsh's numbers
STIFFNESS_POINTS, MASS_POINTS, SURFACE_POINTS = 3, 4, 5  # Gauss points a direction
AXES = np.eye(3)
SHIFT = -1e7  # [rad^2/s^2], below the zero of the rigid motions
N_VIBRATION = 6


def serendipity(nodes: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of the 8- or 20-node element on (-1, 1)^d, and their gradients.

    `nodes` (a, d) are the reference coordinates -1, 0, 1 of corners and edge
    midpoints in any order; returns arrays (points, a) and (points, a, d).
    """
    d = nodes.shape[1]
    x, corner = points[:, None, :], np.all(nodes != 0, axis=1)
    factor = np.where(nodes != 0, 1 + nodes * x, 1 - x**2)
    slope = np.where(nodes != 0, nodes, -2 * x)
    last = np.where(corner, (nodes * x).sum(axis=2) - (d - 1), 2.0) / 2**d
    last_slope = np.where(corner[:, None], nodes, 0.0) / 2**d
    product = factor.prod(axis=2)
    others = np.stack([np.delete(factor, i, axis=2).prod(axis=2) for i in range(d)], axis=2)
    return product * last, others * slope * last[..., None] + product[..., None] * last_slope


def biquadratic(nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """9-node Lagrange shape functions on (-1, 1)^2, (points, 9), for `nodes` as above."""
    x = points[:, None, :]
    return np.where(nodes != 0, x * (x + nodes) / 2, 1 - x**2).prod(axis=2)


def gauss(count: int, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (q, d) and weights (q,) of the product Gauss rule on (-1, 1)^d."""
    x, w = np.polynomial.legendre.leggauss(count)
    points = np.stack(np.meshgrid(*[x] * d, indexing="ij"), axis=-1).reshape(-1, d)
    return points, np.prod(np.meshgrid(*[w] * d, indexing="ij"), axis=0).ravel()


def _elements(kind: int) -> tuple[np.ndarray, np.ndarray]:
    """Gmsh's node tags (elements, a) and reference coordinates (a, d) of corners and edges."""
    _, d, _, count, local, _ = gmsh.model.mesh.getElementProperties(kind)
    local = np.reshape(local, (count, -1))[:, :d]
    kept = np.sum(local == 0, axis=1) <= 1
    tags = gmsh.model.mesh.getElementsByType(kind)[1].reshape(-1, count)
    return tags[:, kept].astype(int), local[kept]


def mesh_rod(parameters: dict[str, float]):
    """Nodes (n, 3) [m], then (cells, reference nodes) and (faces, reference nodes)."""
    gmsh.initialize([""])
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.onelab.clear()
        for name, value in parameters.items():
            gmsh.onelab.setNumber(f"Rod/{name}", [value])
        gmsh.open(str(MODEL))
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        tags, x, _ = gmsh.model.mesh.getNodes()
        (cells, cell_nodes), (faces, face_nodes) = map(_elements, (HEXAHEDRON_27, QUADRILATERAL_9))
        gmsh.onelab.clear()  # its values outlive the session
    finally:
        gmsh.finalize()
    used = np.unique(cells)
    nodes = x.reshape(-1, 3)[np.argsort(tags)][np.searchsorted(np.sort(tags), used)]
    cells, faces = np.searchsorted(used, cells), np.searchsorted(used, faces)
    return nodes, (cells, cell_nodes), (faces, face_nodes)


def sampling(elements: np.ndarray, values: np.ndarray, size: int) -> sparse.csr_matrix:
    """Matrix (elements * q, size) of shape functions (q, a) or (elements, q, a)."""
    values = np.broadcast_to(values, (len(elements), *values.shape[-2:]))
    columns = np.broadcast_to(elements[:, None], values.shape)
    starts = np.arange(0, values.size + 1, values.shape[-1])
    return sparse.csr_matrix(
        (values.ravel(), columns.ravel(), starts), shape=(len(starts) - 1, size)
    )


def _at_points(nodes, cells, local, count):
    """Sampling of values, of the three derivatives [1/m], and diagonal weights [m^3]."""
    points, weights = gauss(count, 3)
    values, slopes = serendipity(local, points)
    jacobian = np.einsum("eai,qad->eqid", nodes[cells], slopes)
    volumes = np.linalg.det(jacobian) * weights
    assert volumes.min() > 0, "inverted cell"
    gradients = np.einsum("qad,eqdi->ieqa", slopes, np.linalg.inv(jacobian))
    return (
        sampling(cells, values, len(nodes)),
        [sampling(cells, g, len(nodes)) for g in gradients],
        sparse.diags(volumes.ravel()),
    )


def elastic_matrices(nodes, cells, local, youngs_modulus, poissons_ratio, density):
    """K [N/m] and M [kg] of (16), isotropic material."""
    mu = youngs_modulus / (2 * (1 + poissons_ratio))
    lame = 2 * mu * poissons_ratio / (1 - 2 * poissons_ratio)
    _, d, volumes = _at_points(nodes, cells, local, STIFFNESS_POINTS)
    h = [[a.T @ volumes @ b for b in d] for a in d]
    shear = mu * (h[0][0] + h[1][1] + h[2][2])
    stiffness = sum(
        sparse.kron(lame * h[i][j] + mu * h[j][i] + (i == j) * shear, np.outer(AXES[i], AXES[j]))
        for i, j in np.ndindex(3, 3)
    )
    values, _, volumes = _at_points(nodes, cells, local, MASS_POINTS)
    mass = sparse.kron(density * values.T @ volumes @ values, AXES)
    return stiffness.tocsc(), mass.tocsc()


def cylinder(nodes, faces, local, radius, centre=0.0):
    """Faces on the cylinder about (centre, 0) and their quadrature.

    Returns faces (f, 8), points (q, 2), shape functions (q, 8) and area vectors
    (f, q, 3) [m^2] that point away from the axis.
    """
    distance = np.hypot(nodes[:, 0] - centre, nodes[:, 1])
    faces = faces[np.all(np.abs(distance[faces] - radius) < 1e-6 * radius, axis=1)]
    points, weights = gauss(SURFACE_POINTS, 2)
    values, slopes = serendipity(local, points)
    areas = np.cross(*np.einsum("fai,qad->dfqi", nodes[faces], slopes)) * weights[:, None]
    radial = np.einsum("fai,qa->fqi", nodes[faces] - [centre, 0.0, 0.0], values)
    inward = np.sum((radial * areas)[..., :2], axis=2) < 0
    return faces, points, values, np.where(inward[..., None], -areas, areas)


def degrees(x: np.ndarray) -> np.ndarray:
    """Angle of points (m, 3) in [0, 360), free of round-off."""
    return np.round(np.degrees(np.arctan2(x[:, 1], x[:, 0])), 4) % 360.0


def bore_load(nodes, faces, local, radius):
    """Load matrix J (15), (3 n, k) [m^2], bore node numbers (m,), pressure nodes (k, 3)."""
    faces, points, values, areas = cylinder(nodes, faces, local, radius)
    share = np.where(np.all(local != 0, axis=1), -0.25, 0.5)
    everywhere = np.vstack([nodes, np.einsum("a,fai->fi", share, nodes[faces])])
    nine = np.column_stack([faces, len(nodes) + np.arange(len(faces))])
    pressures = biquadratic(np.vstack([local, [0.0, 0.0]]), points)
    onto, pressure = sampling(faces, values, len(nodes)), sampling(nine, pressures, len(everywhere))
    load = sum(
        sparse.kron(onto.T @ sparse.diags(areas[..., i].ravel()) @ pressure, AXES[i][:, None])
        for i in range(3)
    )
    order = np.lexsort((degrees(everywhere), np.round(everywhere[:, 2], 9)))
    bore, carriers = order[np.isin(order, faces)], order[np.isin(order, nine)]
    return load.tocsc()[:, carriers], bore, everywhere[carriers]


def mean_displacement(nodes, faces, local, radius, centre) -> np.ndarray:
    """Rows (3, 3 n) of the area-weighted mean displacement of a cylinder."""
    faces, _, values, areas = cylinder(nodes, faces, local, radius, centre)
    areas = np.linalg.norm(areas, axis=2).ravel()
    return np.kron(areas / areas.sum() @ sampling(faces, values, len(nodes)), AXES)


@dataclass(frozen=True, eq=False)
class OracleRod:
    """Free rod: K, M (3 n, 3 n), J (3 n, k), bore node numbers (m,), pin mean (3, 3 n)."""

    nodes: np.ndarray
    stiffness: sparse.csc_matrix
    mass: sparse.csc_matrix
    load: sparse.csc_matrix
    bore: np.ndarray
    pressure_nodes: np.ndarray
    pin: np.ndarray

    @cached_property
    def rigid_fields(self) -> np.ndarray:
        """Unit translations and rotations about the origin, (3 n, 6)."""
        fields = [np.broadcast_to(axis, self.nodes.shape) for axis in AXES]
        fields += [np.cross(axis, self.nodes) for axis in AXES]
        return np.column_stack([field.ravel() for field in fields])

    @cached_property
    def _shifted(self):
        """Factors of ``K - shift M``."""
        return splu(
            (self.stiffness - SHIFT * self.mass).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    @cached_property
    def _saddle_point(self):
        """Order of rows and factors of (29), border scaled like K: that only scales lambda."""
        border = self.mass @ self.rigid_fields
        border *= abs(self.stiffness.diagonal()).mean() / np.linalg.norm(border, axis=0)
        matrix = sparse.bmat([[self.stiffness, border], [border.T, None]], format="csc")
        # A fill-reducing order of the whole would stumble over the dense border.
        order = np.append(np.argsort(self._shifted.perm_c), self.nodes.size + np.arange(6))
        return order, splu(matrix[order][:, order], permc_spec="NATURAL", diag_pivot_thresh=0.01)

    def static_responses(self, loads: np.ndarray) -> np.ndarray:
        """G of (29), (3 n, c) [m], for loads (3 n, c) [N]."""
        order, factors = self._saddle_point
        padded = np.vstack([loads, np.zeros((6, loads.shape[1]))])
        padded[order] = factors.solve(padded[order])
        return padded[: len(loads)]

    @cached_property
    def bore_responses(self) -> np.ndarray:
        """Static responses (3 n, k) [m/Pa] to unit nodal pressures."""
        return self.static_responses(self.load.toarray())

    def outward(self, fields: np.ndarray) -> np.ndarray:
        """Radial displacement (m, c) of the bore nodes in fields (3 n, c)."""
        x, y = self.nodes[self.bore, :2].T / np.hypot(*self.nodes[self.bore, :2].T)
        return x[:, None] * fields[3 * self.bore] + y[:, None] * fields[3 * self.bore + 1]

    @cached_property
    def vibration_modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Elastic modes (27), (28): omega (n_v,) [rad/s] and Phi (3 n, n_v)."""
        inverse = LinearOperator(self.mass.shape, self._shifted.solve, dtype=float)
        start = np.random.default_rng(0).standard_normal(self.nodes.size)
        values, modes = eigsh(
            self.stiffness, N_VIBRATION + 6, self.mass, sigma=SHIFT, OPinv=inverse, v0=start
        )
        assert np.all(np.abs(values[:6]) < 1e-4 * values[6]), "not six rigid motions"
        return np.sqrt(values[6:]), modes[:, 6:]


def build_rod(parameters: dict[str, float] | None = None, **material: float) -> OracleRod:
    """Mesh and assemble; `parameters` of the Gmsh model by name, `material` as `MATERIAL`."""
    size = {**GEOMETRY, **(parameters or {})}
    nodes, cells, faces = mesh_rod(parameters or {})
    return OracleRod(
        nodes,
        *elastic_matrices(nodes, *cells, **{**MATERIAL, **material}),
        *bore_load(nodes, *faces, size["bore_radius"]),
        mean_displacement(nodes, *faces, size["pin_radius"], size["rod_length"]),
    )


def pressure_columns(rod: OracleRod, name: str) -> np.ndarray:
    """Nodal pressures ``pc1`` (34), (k, k), or ``pc2`` (35), (k, 2 m_sy)."""
    if name == "pc1":
        return np.eye(len(rod.pressure_nodes))
    angle, z = degrees(rod.pressure_nodes)[:, None], rod.pressure_nodes[:, 2:]
    long = (angle == np.unique(angle)).astype(float)
    return np.hstack([long, 1.5 * (1 - (z / z.max()) ** 2) * long])


def select(stiffness: np.ndarray, mass: np.ndarray, selection: str) -> np.ndarray:
    """Combinations Z (c, c) of static responses, best first: (31), (32) and two other choices."""
    if selection == "lowest-frequency":
        return linalg.eigh(mass, stiffness)[1][:, ::-1]  # 1 / omega^2: K is better conditioned
    return linalg.eigh(stiffness)[1][:, :: -1 if selection == "largest-eigenvalue" else 1]


def reduce_rod(
    rod: OracleRod,
    n_residual: int = 31,
    selection: str = "lowest-frequency",
    pressure_set: str = "pc2",
) -> ehd.ReducedBody:
    """M3 of section 3.3 with unit forces at the pin along x and y."""
    omega, modes = rod.vibration_modes
    pressures, attachment = pressure_columns(rod, pressure_set), rod.pin[:2].T
    loads = np.hstack([attachment, rod.load @ pressures])
    responses = np.hstack([rod.static_responses(attachment), rod.bore_responses @ pressures])
    responses -= modes / omega**2 @ (modes.T @ loads)  # (30)
    candidates = responses[:, 2:]
    kept = select(
        candidates.T @ (rod.stiffness @ candidates),
        candidates.T @ (rod.mass @ candidates),
        selection,
    )[:, :n_residual]
    static = np.hstack([responses[:, :2], candidates @ kept])
    static /= np.linalg.norm(static, axis=0)
    inertia, energy = static.T @ (rod.mass @ static), static.T @ (rod.stiffness @ static)
    values, vectors = linalg.eigh(inertia, energy)
    basis = np.hstack([modes, static @ (vectors / np.sqrt(values))[:, ::-1]])
    return _project(rod, basis)


def _project(rod: OracleRod, basis: np.ndarray) -> ehd.ReducedBody:
    """Body of the mass-orthonormal columns (3 n, modes)."""
    stiffness = basis.T @ (rod.stiffness @ basis)
    fields = np.hstack([rod.nodes.reshape(-1, 1), rod.rigid_fields[:, :2], basis])
    spin = sparse.kron(sparse.eye(len(rod.nodes)), [[0, -1, 0], [1, 0, 0], [0, 0, 0]])
    spun, bore = spin @ fields, rod.nodes[rod.bore]
    load = (rod.load.T @ fields).T
    followed = rod.outward(basis) @ np.linalg.solve(stiffness, load[3:])
    inertia = InertiaIntegrals(
        fields.T @ (rod.mass @ fields), fields.T @ (rod.mass @ spun), spun.T @ (rod.mass @ spun)
    )
    return ehd.ReducedBody(
        method="m3",
        frame="mean-axis",
        stiffness=stiffness,
        mass=inertia.mass[3:, 3:],
        frequencies=np.sqrt(np.diag(stiffness)) / (2 * np.pi),
        kinds=("vibration",) * N_VIBRATION + ("static",) * (basis.shape[1] - N_VIBRATION),
        bores={
            "bore": BoreSurface(
                radius=float(np.hypot(*bore[:, :2].T).mean()),
                width=float(np.ptp(bore[:, 2])),
                coordinates=bore,
                pressure_coordinates=rod.pressure_nodes,
            )
        },
        bore_basis=basis.reshape(len(rod.nodes), 3, -1)[rod.bore],
        load_projection=load,
        spin_load_projection=(rod.load.T @ spun).T,
        inertia=inertia,
        points={"pin": rod.pin @ fields},
        missing_flexibility=rod.outward(rod.bore_responses) - followed,
    )
