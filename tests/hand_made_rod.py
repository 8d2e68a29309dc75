"""A rod by hand: point masses inside, pressure integrated over the nodes of its bore."""

from dataclasses import replace

import numpy as np
from mechanism_cases import slider_crank

import fenics_ehd as ehd
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.reduction.body import InertiaIntegrals, ResidualFlexibility
from fenics_ehd.reduction.bore import BoreSurface

RADIUS, WIDTH, CLEARANCE, VISCOSITY = 0.0225, 0.022, 17e-6, 0.01
CRANK, ROD, SPEED, PISTON = 0.048, 0.16, 500.0, 0.5
MASS, CENTRE, INERTIA = 0.973, 0.0677, 4e-3
PIN = np.array([[ROD, 0.0, 0.0]])
REVOLUTION = 2 * np.pi / SPEED

#: Two points with mass, centre and inertia of the paper's rod.
_ARM = np.sqrt(INERTIA / MASS)
ROD_POINTS = np.array([[CENTRE - _ARM, 0, 0], [CENTRE + _ARM, 0, 0.0]])
ROD_MASSES = np.full(2, MASS / 2)


class Joint:
    """A film, the nodes of a bore with the same cells, and a gap worked out from the latter."""

    def __init__(self, cells=(12, 3), bore_family="lagrange", clearance=CLEARANCE):
        self.cells, self.clearance = cells, clearance
        grid = ehd.uniform_grid(RADIUS, WIDTH, cells)
        self.film = ehd.Film(ehd.FilmParameters(grid, clearance, ehd.Lubricant(VISCOSITY), SPEED))
        self.pressure_nodes = grid.nodes
        self.bore_nodes = ehd.uniform_grid(RADIUS, WIDTH, cells, bore_family).nodes
        points = self.film.points
        angle, height = points.angle.ravel(), points.height.ravel()
        self._interpolation = interpolation(cells, self.bore_nodes, angle, height)
        self._normal = np.column_stack([np.cos(angle), np.sin(angle)])
        self._tangent = np.column_stack([-np.sin(angle), np.cos(angle)])

    def solve(self, displacement, rate, shaft_rate):
        """Film state for bore displacements relative to the shaft and their rates, (m, 3).

        The oil is carried by both surfaces, as seen from the bore's mean position C2.
        """
        moved, moving = (self._interpolation @ x[:, :2] for x in (displacement, rate))
        mean = area_mean(self, rate)
        shaft = (RADIUS - self.clearance) * shaft_rate - self._tangent @ mean
        bore = np.sum(self._tangent * (moving - mean), axis=1)
        gap = self.clearance + np.sum(self._normal * moved, axis=1)
        values = gap, np.sum(self._normal * moving, axis=1), 0.5 * (shaft + bore), shaft - bore
        shape = self.film.points.angle.shape
        return self.film.solve(Gap(*(x.reshape(shape) for x in values)))

    def rigid_gap(self, eccentricity):
        """Smallest gap of a rigid bore at nodes and Gauss points of the film."""
        nodes = self.pressure_nodes[:, :2] / RADIUS
        normals = np.vstack([nodes, self._normal])
        return self.clearance - (normals @ eccentricity).max()


def spun(fields):
    """``e_z x u`` of fields (N, 3, n)."""
    return np.stack([-fields[:, 1], fields[:, 0], np.zeros_like(fields[:, 2])], axis=1)


def fields_at(points, modes):
    """Position, unit translations and modes at points (N, 3), as columns (N, 3, 3 + n)."""
    fields = np.zeros((len(points), 3, 3))
    fields[:, :, 0] = points
    fields[:, 0, 1] = fields[:, 1, 2] = 1.0
    return np.concatenate([fields, *(mode(points)[:, :, None] for mode in modes)], axis=2)


def point_integrals(masses, fields):
    def total(a, b):
        return np.einsum("k,kci,kcj->ij", masses, a, b)

    turned = spun(fields)
    return InertiaIntegrals(total(fields, fields), total(fields, turned), total(turned, turned))


def quadratic_shapes(points, nodes):
    """Shape functions of 8 or 9 nodes on (-1, 1)^2."""
    powers = [(a, b) for a in range(3) for b in range(3)][: 9 if len(nodes) == 9 else 8]

    def monomials(x):
        return np.array([[s**a * t**b for a, b in powers] for s, t in x])

    return monomials(points) @ np.linalg.inv(monomials(nodes))


def grid_of(cells, nodes):
    """Numbers of bore nodes by angle and height, -1 where there is none."""
    around, along = cells
    i = np.round(np.arctan2(nodes[:, 1], nodes[:, 0]) * around / np.pi).astype(int) % (2 * around)
    j = np.round((nodes[:, 2] / WIDTH + 0.5) * 2 * along).astype(int)
    grid = np.full((2 * around, 2 * along + 1), -1)
    grid[i, j] = np.arange(len(nodes))
    return grid


def interpolation(cells, nodes, angle, height):
    """Matrix from values at nodes to values at points of the cylinder."""
    around, along = cells
    x, y = angle * around / (2 * np.pi), (height / WIDTH + 0.5) * along
    i, j = np.floor(x).astype(int), np.clip(np.floor(y).astype(int), 0, along - 1)
    places = np.array([(s, t) for s in (-1, 0, 1) for t in (-1, 0, 1)])
    if len(nodes) == 2 * around * (2 * along + 1) - around * along:
        places = np.delete(places, 4, axis=0)
    local = 2 * np.column_stack([x - i, y - j]) - 1
    a, b = (2 * k[:, None] + 1 + place for k, place in zip((i, j), places.T, strict=True))
    numbers = grid_of(cells, nodes)[a % (2 * around), b]
    matrix = np.zeros((len(angle), len(nodes)))
    np.put_along_axis(matrix, numbers, quadratic_shapes(local, places), axis=1)
    return matrix


def bore_points(cells):
    """Angle, height and area of the film's own rule, 3 x 3 Gauss points a cell.

    With any other the forces would not be conjugate to the gap.
    """
    x, w = np.polynomial.legendre.leggauss(3)
    angle, height = (((np.arange(n)[:, None] + 0.5 * (1 + x)) / n).ravel() for n in cells)
    area = np.outer(np.tile(w, cells[0]), np.tile(w, cells[1])).ravel()
    angle, height = (x.ravel() for x in np.meshgrid(angle, height, indexing="ij"))
    area *= 2 * np.pi * RADIUS * WIDTH / area.sum()
    return 2 * np.pi * angle, WIDTH * (height - 0.5), area


def area_mean(joint, field):
    """Mean x and y components over the bore of a field (m, 3) at its nodes."""
    angle, height, area = bore_points(joint.cells)
    values = interpolation(joint.cells, joint.bore_nodes, angle, height) @ field[:, :2]
    return area @ values / area.sum()


def pressure_work(joint, fields):
    """Work of unit nodal pressures on fields (m, 3, n) at the bore nodes: (n, k).

    ``int N_k n . u dA`` over the cylinder.
    """
    angle, height, area = bore_points(joint.cells)
    u = np.tensordot(interpolation(joint.cells, joint.bore_nodes, angle, height), fields, 1)
    outward = np.cos(angle)[:, None] * u[:, 0] + np.sin(angle)[:, None] * u[:, 1]
    shapes = interpolation(joint.cells, joint.pressure_nodes, angle, height)
    return (area[:, None] * outward).T @ shapes


def make_body(joint, masses=ROD_MASSES, points=ROD_POINTS, modes=(), stiffness=None):
    """Reduced body of point masses and displacement fields given as functions of position."""
    n = len(modes)
    bore = fields_at(joint.bore_nodes, modes)
    inertia = point_integrals(masses, fields_at(points, modes))
    stiffness = np.zeros((0, 0)) if stiffness is None else stiffness
    frequencies = np.sqrt(np.diag(stiffness) / np.diag(inertia.mass)[3:]) / (2 * np.pi)
    return ehd.ReducedBody(
        method="by hand",
        frame="none",
        stiffness=stiffness,
        mass=inertia.mass[3:, 3:],
        frequencies=frequencies,
        kinds=("vibration",) * n,
        bores={
            "bore": BoreSurface(
                radius=RADIUS,
                width=WIDTH,
                coordinates=joint.bore_nodes,
                pressure_coordinates=joint.pressure_nodes,
            )
        },
        bore_basis=bore[:, :, 3:],
        load_projection=pressure_work(joint, bore),
        spin_load_projection=pressure_work(joint, spun(bore)),
        inertia=inertia,
        points={"pin": fields_at(PIN, modes)[0]},
        missing_flexibility=np.zeros((0, 0)),
    )


def make_mechanism(body, joint, damping_time=1e-3, **settings):
    """The paper's machine with this rod, its crank at constant speed; settings of the joint."""
    # Velocities of the rigid mechanism, for a crank whose speed nothing imposes.
    rod = ehd.FlexibleBody(
        body, damping_time, position=(CRANK, 0.0), velocity=(0.0, CRANK * SPEED),
        speed=-CRANK * SPEED / ROD,
    )  # fmt: skip
    return slider_crank(rod, joint.film, **settings)


def torque(angle):
    """Torque on the crank of an engine of two strokes, say, and its derivative [N m]."""
    return 3 + 2 * np.cos(2 * angle), -4 * np.sin(2 * angle)


def gas(angle):
    """Gas on its piston, and its derivative [N]."""
    return 4e3 * (1 + np.cos(angle - 0.4)), -4e3 * np.sin(angle - 0.4)


def driven(mechanism, inertia, **forces):
    """The same machine with a crank that nothing but forces drives."""
    crank = ehd.RigidBody(1.0, inertia, {"pin": (CRANK, 0.0)}, speed=SPEED)
    return replace(mechanism, bodies={**mechanism.bodies, "crank": crank}, drives={}, forces=forces)


def run(mechanism, revolutions, tolerance):
    """A run with steps of a fiftieth of a revolution at most."""
    steps = {"tolerance": tolerance, "largest": 0.02 / revolutions}
    return ehd.simulate(mechanism, revolutions * REVOLUTION, **steps)


def flexible(joint, seed=0, extra=None):
    """Body of a cloud of points with four smooth fields as modes; `extra` is added to the first."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-0.03, -0.03, -0.01], [0.18, 0.03, 0.01], (40, 3))
    masses = np.full(40, MASS / 40)

    def oval(x):
        return np.column_stack([x[:, 0], -x[:, 1], 0 * x[:, 0]]) / RADIUS

    def skewed(x):
        return np.column_stack([x[:, 1], x[:, 0], 10 * x[:, 0] * x[:, 2]]) / RADIUS

    def bent(x):
        return np.column_stack([
            -np.pi * x[:, 1] / ROD * np.cos(np.pi * x[:, 0] / ROD),
            np.sin(np.pi * x[:, 0] / ROD),
            0 * x[:, 0],
        ])  # fmt: skip

    def stretched(x):
        return np.column_stack([x[:, 0] ** 2 / ROD**2, 0.3 * x[:, 0] * x[:, 1] / ROD**2, x[:, 2]])

    modes = [oval, skewed, bent, stretched]
    if extra is not None:
        modes[0] = lambda x: oval(x) + extra(x)
    mass = point_integrals(masses, fields_at(points, (oval, skewed, bent, stretched))).mass[3:, 3:]
    # Any symmetric stiffness of a few kHz will do: it need not know the modes.
    root = np.linalg.cholesky(mass) @ (np.eye(4) + 0.2 * rng.uniform(-1, 1, (4, 4)))
    stiffness = root @ np.diag((2 * np.pi * np.array([2e3, 3e3, 5e3, 8e3])) ** 2) @ root.T
    stiffness = 0.5 * (stiffness + stiffness.T)
    return make_body(joint, masses, points, modes, stiffness), masses, points, modes


def with_residual(joint, body, rank=7, seed=0):
    """A body with a residual flexibility of smooth random patterns: ``d = J sigma^-1``-like."""
    rng = np.random.default_rng(seed)
    x, y, z = joint.bore_nodes.T
    angle, height = np.arctan2(y, x), z / z.max()
    k = len(joint.pressure_nodes)
    shapes = np.stack(
        [np.cos((i + 1) * angle + i) * (1 + 0.5 * np.cos(i * height)) for i in range(rank)], axis=-1
    )
    outward = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    displacement = outward[:, :, None] * shapes[:, None, :]
    load = pressure_work(joint, displacement)
    # Unit amplitudes move the bore by a micrometre under 20 MPa.
    stiffness = 20e6 * rng.uniform(0.5, 2.0, rank) * np.abs(load).sum(axis=1) / 1e-6
    # Amplitudes in pascal: y = V p with V = load / (stiffness of y).
    factor = np.abs(load).sum(axis=1) / stiffness
    displacement = displacement * factor
    load = load * factor[:, None]
    energy = stiffness * factor**2
    residual = ResidualFlexibility(displacement, load / energy[:, None], energy, np.zeros((0, 0)))
    assert residual.patterns.shape == (rank, k)
    return replace(body, residual=residual)


def some_state(seed, modes=4):
    """Coordinates, rates and accelerations of a rod in motion, the gap open."""
    rng = np.random.default_rng(seed)
    x = np.append(rng.uniform(-5e-6, 5e-6, 2), rng.uniform(-1e-6, 1e-6, modes))
    return x, 1e3 * rng.uniform(-1e-6, 1e-6, 2 + modes), 1e7 * rng.uniform(-1e-6, 1e-6, 2 + modes)
