"""Film meshes and step tolerance that meet an accuracy in the least time, from a run's errors.

Errors of a run are known by their components (`fenics_ehd.multibody.error_budget`), and how they go
down with what they cost: that of a film's mesh with its cells, ``cells^-order`` either way, but
``cells^-2`` for what a peak between its nodes has more, that of the steps with their length,
``tolerance^(k / (k + 1))``. Of every figure, the peak pressure or the thinnest film of a joint, the
components must not exceed the accuracy together,

    rest + step x + mesh c_j^-order + between c_j^-2 <= accuracy,

x the share that is left of the errors of the steps, c_j times as many cells either way of the film
of the joint j. A run of ``forced + (1 - forced) x^(-1/k)`` times as many steps, whose Newton
iterations take a time that is linear in the nodes, takes the time

    (forced + (1 - forced) x^(-1/k)) (OVERHEAD + sum_j weight_j nodes_j c_j^2).

For given x the least c_j follow, and the logarithm of the time is convex in that of x: one search
along a line finds the cheapest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, inf, log10, prod, sqrt

import numpy as np

#: Time of a Newton iteration without its films, in nodes of a rigid bore's film: 1.5 ms and 2.1 us
#: a node of a four-bar with one of them (cells 16 x 3 to 48 x 8). A node of an elastic bore's film
#: takes five times as long: 10 us (slider-crank by M4, 20 x 5 and 28 x 7).
OVERHEAD, ELASTIC = 700.0, 5.0

#: Nodes for each cell, by element.
NODES = {"lagrange": 4, "serendipity": 3, "bilinear": 1}

#: Largest and least tolerances of a step; most film cells, and fewest around and along that a
#: choice makes of more.
LOOSEST, TIGHTEST = 1e-2, 1e-8
MOST_CELLS, FEWEST = 6400, (16, 3)

#: Where an accuracy cannot be met, that in its place over what can be: the last bit costs most.
OUT_OF_REACH = 1.2

#: Rounding that makes no cell more, and what a search along the line leaves open.
ROUNDING, SHORTER = 1e-6, 1e-4


@dataclass(frozen=True)
class Figure:
    """Relative errors of a peak pressure or a thinnest film.

    Attributes
    ----------
    joint
        Whose it is.
    film_mesh, between_nodes, step_size
        Of the film's solution, of what its nodes may miss of that, of the steps.
    rest
        Of all others together, as they will be.
    """

    joint: str
    film_mesh: float
    between_nodes: float
    step_size: float
    rest: float


@dataclass(frozen=True)
class FilmMesh:
    """A film's mesh in a run.

    Attributes
    ----------
    cells
        Around and along.
    order
        Of its solution's error, 4 or 2.
    nodes
        For each cell, those of an elastic bore's film times `ELASTIC`.
    kept
        Whether it stays as it is.
    """

    cells: tuple[int, int]
    order: float
    nodes: float
    kept: bool = False

    @property
    def finest(self) -> float:
        """Cells of the finest mesh in one of this, either way."""
        return 1.0 if self.kept else max(1.0, sqrt(MOST_CELLS / prod(self.cells)))

    @property
    def coarsest(self) -> float:
        """Cells of the coarsest one in one of this."""
        shares = [least / cells for least, cells in zip(FEWEST, self.cells, strict=True)]
        return 1.0 if self.kept else min(1.0, max(shares))

    def error(self, figure: Figure, factor: float) -> float:
        """Of a figure, on so many times the cells either way."""
        return figure.film_mesh * factor**-self.order + figure.between_nodes * factor**-2.0

    def factor(self, figure: Figure, error: float) -> float:
        """Cells that leave this error of a figure, over its own either way."""
        once, twice = figure.between_nodes, figure.film_mesh
        if self.order == 2.0:
            once, twice = once + twice, 0.0
        # In the square of the cells, of which an error of order 4 takes the square.
        return sqrt((once + sqrt(once**2 + 4.0 * twice * error)) / (2.0 * error))

    def times(self, factor: float) -> tuple[int, int]:
        """So many times the cells, either way."""
        around, along = (ceil(factor * cells - ROUNDING) for cells in self.cells)
        return around, along


@dataclass(frozen=True)
class JudgedRun:
    """A run's errors, and what they came from.

    Attributes
    ----------
    figures
        Of all joints.
    films
        By joint.
    tolerance, order
        Of its steps.
    forced
        Share of its steps that it would take with any tolerance.
    kept
        Whether the tolerance stays as it is.
    longest, coarsest
        What else the run must have: largest share of the steps' error, and least cells over its
        own either way.
    """

    figures: tuple[Figure, ...]
    films: Mapping[str, FilmMesh]
    tolerance: float
    order: int
    forced: float = 0.0
    kept: bool = False
    longest: float = inf
    coarsest: float = 0.0

    def shares(self, tolerance: float) -> float:
        """What another tolerance leaves of the error of the steps."""
        return float((tolerance / self.tolerance) ** (self.order / (self.order + 1.0)))

    def errors(self, step: float, factors: Mapping[str, float]) -> np.ndarray:
        """Sums of all figures' components, as in `time`, shape (figures,)."""
        return np.array(
            [
                f.rest + step * f.step_size + self.films[f.joint].error(f, factors[f.joint])
                for f in self.figures
            ]
        )

    def time(self, step: float, factors: Mapping[str, float]) -> float:
        """Of a run that leaves this share of the steps' error, on so many times the cells."""
        steps = self.forced + (1.0 - self.forced) * step ** (-1.0 / self.order)
        nodes = [
            film.nodes * prod(film.cells) * factors[name] ** 2 for name, film in self.films.items()
        ]
        return float(steps * (OVERHEAD + sum(nodes)))


@dataclass(frozen=True)
class Choice:
    """Of film meshes and tolerance.

    Attributes
    ----------
    tolerance, cells
        Of the steps, and of the films by joint.
    expected
        Largest error of a figure, by the laws.
    """

    tolerance: float
    cells: dict[str, tuple[int, int]]
    expected: float


def cheapest(run: JudgedRun, accuracy: float) -> Choice:
    """What meets an accuracy in the least time, or nearly so where limits do not allow it."""
    least, most = (run.shares(tolerance) for tolerance in (TIGHTEST, max(LOOSEST, run.tolerance)))
    if run.kept:
        least = most = 1.0
    finest = {name: film.finest for name, film in run.films.items()}
    reach = float(run.errors(least, finest).max())
    if reach >= accuracy:
        accuracy = OUT_OF_REACH * reach

    def factors(step: float) -> dict[str, float]:
        found = {
            name: min(film.finest, max(film.coarsest, run.coarsest))
            for name, film in run.films.items()
        }
        for figure in run.figures:
            film = run.films[figure.joint]
            left = accuracy - figure.rest - step * figure.step_size
            within_reach = left > film.error(figure, film.finest)
            needed = film.factor(figure, left) if within_reach else film.finest
            found[figure.joint] = max(found[figure.joint], needed)
        return found

    # Beyond that not even the finest films leave enough.
    longest = [
        (accuracy - f.rest - run.films[f.joint].error(f, finest[f.joint])) / f.step_size
        for f in run.figures
        if f.step_size
    ]
    most = max(least, min([most, run.longest, *longest]))
    step = most
    if least < most:
        from scipy.optimize import minimize_scalar  # slow to import, for runs that miss alone

        found = minimize_scalar(
            lambda x: np.log(run.time(np.exp(x), factors(np.exp(x)))),
            bounds=(np.log(least), np.log(most)),
            method="bounded",
            options={"xatol": 1e-6},
        )
        # Hardly shorter, so that a film at its coarsest gets no cell more by rounding.
        step = (1.0 - SHORTER) * float(np.exp(found.x))
        if run.time(most, factors(most)) <= np.exp(found.fun):
            step = most
    meshes = factors(step)
    tolerance = run.tolerance * step ** ((run.order + 1.0) / run.order)
    return Choice(
        run.tolerance if run.kept else rounded(tolerance),
        {name: film.times(meshes[name]) for name, film in run.films.items()},
        float(run.errors(step, meshes).max()),
    )


def rounded(value: float) -> float:
    """Down to two digits, as people write numbers."""
    digits = 10.0 ** (int(np.floor(log10(value))) - 1)
    return float(f"{np.floor(value / digits * (1 + ROUNDING)) * digits:.1e}")
