"""Bodies with a bore written down by hand, for the tests: no mesh of a part is needed."""

import numpy as np

import fenics_ehd as ehd
from fenics_ehd.reduction.body import InertiaIntegrals
from fenics_ehd.reduction.bore import BoreSurface

R, WIDTH, C, ETA, SPEED = 0.0225, 0.022, 17e-6, 0.01, 600.0


def make_film(cells=(12, 3)):
    grid = ehd.uniform_grid(R, WIDTH, cells, "lagrange")
    return ehd.Film(ehd.FilmParameters(grid, C, ehd.Lubricant(ETA), SPEED))


def held_body(film, modes=(), frequencies=()):
    """Body of displacement fields given as functions of position (m, 3), of unit modal masses."""
    grid, n = film.parameters.grid, len(modes)
    basis = np.zeros((len(grid.nodes), 3, n))
    for i, mode in enumerate(modes):
        basis[:, :, i] = mode(grid.nodes)
    cosine, sine = film.points.normal
    rigid = film.load(np.stack([R + 0 * cosine, cosine, sine], axis=-1))
    nothing = np.zeros((3 + n, 3 + n))
    # Four kilograms about the bore's centre; the modes leave that where it is.
    mass = np.diag([4.0 * R**2, 4.0, 4.0, *np.ones(n)])
    frequencies = np.array(frequencies, dtype=float)
    return ehd.ReducedBody(
        method="by hand",
        frame="clamped",
        stiffness=np.diag((2 * np.pi * frequencies) ** 2),
        mass=np.eye(n),
        frequencies=frequencies,
        kinds=("vibration",) * n,
        bores={
            "bore": BoreSurface(
                radius=R, width=grid.width, coordinates=grid.nodes, pressure_coordinates=grid.nodes
            )
        },
        bore_basis=basis,
        # The modes' rows are not used if film and bore have the same nodes.
        load_projection=np.vstack([rigid, np.zeros((n, rigid.shape[1]))]),
        spin_load_projection=np.zeros((3 + n, rigid.shape[1])),
        inertia=InertiaIntegrals(mass, nothing, nothing),
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
