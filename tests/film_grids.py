"""Film meshes of tests."""

import numpy as np

import fenics_ehd as ehd


def graded_grid(
    radius: float,
    width: float,
    cells: tuple[int, int],
    family: str = "lagrange",
    *,
    focus: float,
    ratio: float,
) -> ehd.FilmGrid:
    """Grid with cells that shrink smoothly along the circumference towards an angle.

    The density of cells is ``1 + a cos(phi - focus)``; a cell boundary lies at
    `focus` and one opposite, when the number of cells is even.

    Parameters
    ----------
    radius, width, cells, family
        As for `uniform_grid`.
    focus
        Angle of the smallest cells [rad].
    ratio
        Largest cell over the smallest, at least 1.

    """
    amplitude = (ratio - 1) / (ratio + 1)
    share = np.linspace(0.0, 2 * np.pi, cells[0] + 1)
    # Invert phi + a sin(phi) = share by Newton; monotonic as a < 1.
    angle = share.copy()
    for _ in range(100):
        angle -= (angle + amplitude * np.sin(angle) - share) / (1 + amplitude * np.cos(angle))
        angle = np.clip(angle, 0.0, 2 * np.pi)
    angle[0], angle[-1] = 0.0, 2 * np.pi
    heights = np.linspace(-width / 2, width / 2, cells[1] + 1)
    return ehd.FilmGrid(radius, focus + angle, heights, family)
