"""Static solutions of a whole free rod under the loads that its machine put on it.

d'Alembert: at one instant the pressures on the bore, the force of the pin and the inertia forces of
every node, rigid and elastic, balance each other; the full stiffness matrix, held at six degrees of
freedom, answers them. None of the package's reductions and static solvers takes part.
"""

import numpy as np
from scipy import linalg, sparse

ROD = "rod"


def csr(matrix):
    """A PETSc matrix of one rank in SciPy's format."""
    pointers, columns, values = matrix.getValuesCSR()
    return sparse.csr_matrix((values, columns, pointers), shape=matrix.size)


def factors(matrix):
    """Of a symmetric matrix, to solve with."""
    return sparse.linalg.splu(
        matrix.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def rigid_motions(x):
    moves = [np.tile(axis, (len(x), 1)) for axis in np.eye(3)]
    return np.stack([*moves, *np.cross(np.eye(3)[:, None], x)], axis=2).reshape(-1, 6)


class StaticRod:
    """Solutions of ``K u = f`` for loads in balance."""

    def __init__(self, structure):
        self.structure = structure
        self.mass, stiffness = csr(structure.mass), csr(structure.stiffness)
        self.rigid = rigid_motions(structure.coordinates)
        held = linalg.qr(self.rigid.T, mode="r", pivoting=True)[1][:6]
        self.free = np.setdiff1d(np.arange(structure.size), held)
        self.factors = factors(stiffness[self.free][:, self.free])

    def unbalanced(self, load):
        """Net force and moment over the sum of what makes them up."""
        return np.abs(self.rigid.T @ load) / (np.abs(self.rigid).T @ np.abs(load))

    def __call__(self, load):
        """Displacement, shape (dofs, 1); what is left unbalanced accelerates the rod."""
        inertia = self.mass @ self.rigid
        share = np.linalg.solve(self.rigid.T @ inertia, self.rigid.T @ load)
        displacement = np.zeros((self.structure.size, 1))
        displacement[self.free, 0] = self.factors.solve((load - inertia @ share)[self.free])
        return displacement

    def loads(self, columns, run, step, on_bore=None):
        """All forces on the rod's nodes in its own frame, at an accepted step of a run.

        Those on its bore's nodes, shape (m, 3), are the film's unless given.
        """
        system, structure = run.equations.system, self.structure
        (film,) = system.films
        own = system.bodies[ROD]
        z, v, a = (values[: system.n][own] for values in (step.x, step.rate, step.acceleration))
        c, s = np.cos(z[2]), np.sin(z[2])
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        if on_bore is None:
            # Where the film's integrals have the pressure push, on any mesh.
            area = sparse.csr_matrix(film.film.film.pressure_areas)
            pressing = area @ step.solution.films[0].pressure
            on_bore = (film.film.surfaces[0].maps.normal.T @ pressing).reshape(-1, 3)
        load = np.zeros((len(structure.coordinates), 3))
        load[structure.bore.nodes] = on_bore
        load = load.ravel()
        # The pin's force is what its constraint does to the rod's position.
        motion = step.solution.motion
        (gudgeon,) = (place for place in system.constraints if place.name == "gudgeon")
        jacobian = motion.instant.jacobian[gudgeon.rows, own]
        force = turn.T @ [*(-motion.multipliers[gudgeon.rows] @ jacobian[:, :2]), 0.0]
        load += sum(f * v.array for f, v in zip(force, structure.attachments["pin"], strict=True))
        place, rate, acceleration = ((columns @ values[3:]).reshape(-1, 3) for values in (z, v, a))
        place = place + structure.coordinates
        spin, swing = np.array([0, 0, v[2]]), np.array([0, 0, a[2]])
        acceleration = acceleration + turn.T @ [*a[:2], 0.0] + 2 * np.cross(spin, rate)
        acceleration += np.cross(swing, place) + np.cross(spin, np.cross(spin, place))
        return load - self.mass @ acceleration.ravel()
