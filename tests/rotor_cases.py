"""Rotors in bearings written down by hand, for the tests: no mesh of a part is needed."""

import numpy as np

from fenics_ehd.film import Film, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.film.kinematics import GapSlopes
from fenics_ehd.multibody.bdf import integrate
from fenics_ehd.multibody.coupled import CoupledSteps
from fenics_ehd.multibody.dry_system import DrySystem
from fenics_ehd.multibody.shaft_journal import ShaftJournal
from fenics_ehd.reduction.body import InertiaIntegrals, ReducedBody
from fenics_ehd.scenes.rotor import Rotor

R, WIDTH, C, ETA, SPEED = 0.0225, 0.022, 17e-6, 0.01, 600.0

#: (e_x, e_y, psi_x, psi_y) of a shaft that has these four coordinates, or the first two.
FREE_SHAFT = np.eye(4)
PARALLEL_SHAFT = np.eye(4)[:, :2]


def make_film(cells=(12, 3), *, width=WIDTH, clearance=C, speed=SPEED, family="lagrange"):
    grid = uniform_grid(R, width, cells, family)
    return Film(FilmParameters(grid, clearance, Lubricant(ETA), speed))


def held_body(film, modes=(), frequencies=()):
    """Body of displacement fields given as functions of position (m, 3), of unit modal masses."""
    grid, n = film.parameters.grid, len(modes)
    basis = np.zeros((len(grid.nodes), 3, n))
    for i, mode in enumerate(modes):
        basis[:, :, i] = mode(grid.nodes)
    cosine, sine = film.points.normal
    rigid = film.load(np.stack([R + 0 * cosine, cosine, sine], axis=-1))
    nothing = np.zeros((3 + n, 3 + n))
    frequencies = np.array(frequencies, dtype=float)
    return ReducedBody(
        method="by hand",
        frame="clamped",
        stiffness=np.diag((2 * np.pi * frequencies) ** 2),
        mass=np.eye(n),
        frequencies=frequencies,
        kinds=("vibration",) * n,
        bore_radius=R,
        bore_width=grid.width,
        bore_nodes=grid.nodes,
        bore_basis=basis,
        pressure_nodes=grid.nodes,
        # Of the modes' rows nobody asks where film and bore have the same nodes.
        load_projection=np.vstack([rigid, np.zeros((n, rigid.shape[1]))]),
        spin_load_projection=np.zeros((3 + n, rigid.shape[1])),
        inertia=InertiaIntegrals(nothing, nothing, nothing),
        points={},
        missing_flexibility=np.zeros((0, 0)),
    )


def oval(x):
    return np.column_stack([x[:, 0], -x[:, 1], 0 * x[:, 0]]) / R


def skewed(x):
    return np.column_stack([x[:, 1] + 30 * x[:, 1] * x[:, 2], x[:, 0], 0 * x[:, 0]]) / R


def shifted(x):
    return np.tile([1.0, 0.5, 0.0], (len(x), 1))


def wide(x):
    """Three waves around, growing along the axis."""
    angle = np.arctan2(x[:, 1], x[:, 0])
    size = np.cos(3 * angle) * (1 + 20 * x[:, 2])
    return np.column_stack([size * np.cos(angle), size * np.sin(angle), 0 * angle])


MODES = (oval, skewed, shifted, wide)


def flexible(film):
    """Body whose modes, of some kilograms, answer pressures by micrometres."""
    scaled = [lambda x, mode=mode: 0.5 * mode(x) for mode in MODES]
    return held_body(film, scaled, (1500.0, 2200.0, 3000.0, 6000.0))


def rigid_rotor(film, mass, load, speed):
    """Rigid rotor that does not tilt, in a rigid bearing under a constant load (2,) [N]."""
    journal = ShaftJournal(held_body(film), film, PARALLEL_SHAFT)
    nothing = np.zeros((2, 2))
    load = np.asarray(load, dtype=float)
    return Rotor(DrySystem(mass * np.eye(2), nothing, nothing, lambda time: load), journal, speed)


def linearise(rotor, time, x, rate, acceleration, shifts, guess=None):
    """Residual of the motion with the film solved by itself, its total derivative and the film."""
    journal = rotor.journal
    shape = (*journal.film.points.angle.shape, -1)
    state = journal.film.solve(journal.film_gap(x, rate, rotor.speed), guess)
    slopes = GapSlopes(
        journal.thickness.reshape(shape),
        shifts[0] * journal.thickness.reshape(shape),
        shifts[0] * journal.mean_velocity.reshape(shape),
    )
    slope = journal.film.sensitivity(state, slopes)
    load = journal.load[1:]
    residual = rotor.dry.residual(time, x, rate, acceleration) - load @ state.pressure
    return residual, rotor.dry.derivative(shifts) - load @ slope, state


def steps_of(rotor, end, x, rate, control):
    return integrate(rotor, (0.0, end), x, rate, control, CoupledSteps(rotor))
