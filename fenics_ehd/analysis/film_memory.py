"""Dynamic stiffness of machines whose films have memory, interpolated from real shifts.

If a bore has quasi-static residual patterns, its flexibility is in series with the damping of the
film, and with stiffness-proportional damping D = zeta K each pattern also has the lag
``1 / (1 + zeta s)``. The dynamic stiffness

    H(s) = s^2 M + G(s)

then has poles, and G is not ``s D + K``. G is real at real shifts s, and is sampled there at the
shifts s_0 = 0, s_1, ..., by the real equations of a time step. With a scale S it is interpolated by
a rational function in barycentric form,

    G(s) = (1 + s / S) sum_j w_j g_j / (s - s_j) / sum_j w_j / (s - s_j),
    g_j = G(s_j) / (1 + s_j / S),

whose support s_j, j < m, is a part of the sampled shifts. The support grows by the shift with the
largest error, and the weights w minimise the linearised error at the sampled shifts that are not
part of the support (adaptive Antoulas-Anderson algorithm, AAA, of Nakatsukasa, Sete and Trefethen).
The error at these shifts is the reported error. With too large a support, round-off of the samples
causes poles near the sampled shifts, and unstable roots at these poles. The oil in a bore at rest
is stable, so that supports with a pole in the right half plane are rejected. Of the others, the
support with the smallest error is used. G is analytic but for its poles, so that the interpolant
holds for complex s. The shares of the films in G have the same poles and the same
weights.

With ``y_j = x / (s - s_j)`` the equation ``H(s) x = 0`` is linear in s:

    s (sum w_j) M x + sum w_j (s_j M + g_j / S) x + sum w_j H(s_j) y_j = 0,
    s y_j = x + s_j y_j.

Its roots s are those of the motions, and of oil that flows out of the elastic bore. Roots of such
flows are real, or have a damping ratio near 1, and the interpolant does not resolve each of them.
Roots with a damping ratio above `RELAXATION` are omitted, except the least stable root.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg

from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SolverError

#: Smallest and largest shift that is sampled besides 0, over the rate of the films. Modes of shafts
#: have frequencies up to some hundred times the speed.
RANGE = 0.05, 100.0

#: Number of sampled shifts, 0 included.
SHIFTS = 22

#: Largest number of shifts in the support; the others verify the interpolant.
LARGEST_SUPPORT = 13

#: Relative error at the other shifts at which the support is large enough. The error on the
#: imaginary axis at the speed of a rotor is of the same order.
SMALL_ERROR = 1e-8

#: Relative error at the other shifts above which the interpolant is refused.
LARGEST_ERROR = 1e-5

#: Damping ratio above which a root is not that of a vibration.
RELAXATION = 0.95

#: Relative step of a derivative in s, and of a damping matrix, which is a derivative at 0.
STEP = 1e-6

#: Ratio of a homogeneous eigenvalue's denominator to its numerator, in a scale of time at which the
#: matrices of the pencil have the same size, below which a root is infinite.
INFINITE = 1e-10

#: Real parts that differ by less than this share of a root belong to the same pair of roots.
EQUAL = 1e-9


def finite_roots(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Indices of the finite eigenvalues among the r ratios of `above` and `below`, shape (r,)."""
    return np.flatnonzero(np.abs(below) > INFINITE * np.abs(above))


def sampled_shifts(rate: float) -> np.ndarray:
    """Shifts at which the dynamic stiffness is sampled [1/s], for the rate of the films."""
    return np.concatenate([[0.0], rate * np.geomspace(*RANGE, SHIFTS - 1)])


class Support(NamedTuple):
    """Support of the interpolant.

    Attributes
    ----------
    indices
        Indices of the m shifts of the support among the sampled shifts.
    weights
        Weights w, shape (m,).
    error
        Largest relative error at the other sampled shifts.
    """

    indices: np.ndarray
    weights: np.ndarray
    error: float


@dataclass(frozen=True, eq=False)
class SampledStiffness(Described):
    """Dynamic stiffness without its mass part, ``G(s) = H(s) - s^2 M``, at real shifts.

    Attributes
    ----------
    shifts
        Shifts s, ascending from 0, shape (n,) [1/s].
    values
        Matrices G at the shifts, shape (n, k, k).
    films
        Shares of the films by name of the joint, shape (n, 2, k): the force on the journal is
        ``-share q`` for ``q exp(s t)``.
    """

    shifts: np.ndarray
    values: np.ndarray
    films: Mapping[str, np.ndarray]

    def with_coordinates(self, turn: np.ndarray) -> SampledStiffness:
        """The same samples in other coordinates p, ``q = turn p``, shape (k, k)."""
        films = {name: film @ turn for name, film in self.films.items()}
        return SampledStiffness(self.shifts, turn.T @ self.values @ turn, films)

    @staticmethod
    def combined(parts: Sequence[SampledStiffness], weights: Sequence[float]) -> SampledStiffness:
        """Weighted sum of samples in the same coordinates; the weights have the sum 1."""

        def total(arrays: Sequence[np.ndarray]) -> np.ndarray:
            return np.asarray(sum(w * array for w, array in zip(weights, arrays, strict=True)))

        return SampledStiffness(
            total([part.shifts for part in parts]),
            total([part.values for part in parts]),
            {name: total([part.films[name] for part in parts]) for name in parts[0].films},
        )

    @property
    def scale(self) -> float:
        """Scale S, the middle one of the shifts [1/s]."""
        return float(self.shifts[len(self.shifts) // 2])

    @cached_property
    def support(self) -> Support:
        """Support of the interpolant.

        Raises
        ------
        SolverError
            The error of the interpolant is too large.
        """
        growth = 1.0 + self.shifts / self.scale
        columns = []
        for values in (self.values, *self.films.values()):
            flat = values.reshape(len(values), -1) / growth[:, None]
            size = np.linalg.norm(flat, axis=1, keepdims=True).max()
            columns.append(flat / (size or 1.0))
        support = _support(self.shifts, np.hstack(columns))
        if support.error > LARGEST_ERROR:
            raise SolverError(
                f"the dynamic stiffness of the elastic bore is interpolated with an error of "
                f"{support.error:.2g}, above {LARGEST_ERROR:g}: reduce the bore with method = 'm3'"
            )
        return support

    def _at(self, values: np.ndarray, s: complex) -> np.ndarray:
        """Interpolated values at a complex s; `values` are samples, shape (n, ...)."""
        indices, weights, _ = self.support
        shifts = self.shifts[indices]
        equal = np.flatnonzero(shifts == s)
        if len(equal):
            return np.asarray(values[indices[equal[0]]], dtype=complex)
        factors = weights / (s - shifts)
        factors = factors * (self.scale + s) / (factors.sum() * (self.scale + shifts))
        return np.tensordot(factors, values[indices], 1)

    def at(self, s: complex) -> np.ndarray:
        """Matrix G at a complex s, shape (k, k)."""
        return self._at(self.values, s)

    def film(self, name: str, s: complex) -> np.ndarray:
        """Share of a film at a complex s, shape (2, k)."""
        return self._at(self.films[name], s)

    def _at_rest(self, values: np.ndarray) -> np.ndarray:
        """Derivative of interpolated values with respect to s at s = 0."""
        step = STEP * self.scale
        return np.asarray(self._at(values, 1j * step).imag / step)

    @property
    def damping(self) -> np.ndarray:
        """Damping matrix D of slow motions: derivative of G at s = 0, shape (k, k)."""
        return self._at_rest(self.values)

    @property
    def film_coefficients(self) -> dict[str, np.ndarray]:
        """Stiffness and damping of every film for slow motions, shape (2, 2, k)."""
        return {name: np.stack([film[0], self._at_rest(film)]) for name, film in self.films.items()}

    def derivative(self, mass: np.ndarray, s: complex) -> np.ndarray:
        """Derivative of H with respect to s at a complex s, shape (k, k)."""
        step = STEP * (abs(s) + self.scale)
        slope = (self.at(s + step) - self.at(s - step)) / (2.0 * step)
        return np.asarray(2.0 * s * mass + slope)

    def modes(self, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Roots of ``det H``, and right and left null vectors of H at these roots.

        Parameters
        ----------
        mass
            Mass matrix M, shape (k, k).

        Returns
        -------
        roots, right, left : numpy.ndarray
            Roots, shape (r,) [1/s]; null vectors x and y, ``H x = 0`` and ``y^H H = 0``, as
            columns, shape (k, r).
        """
        size = len(mass)
        motion, inertia = self._pencil(mass)
        (above, below), y, x = linalg.eig(
            motion, inertia, left=True, right=True, homogeneous_eigvals=True
        )
        finite = finite_roots(above, below)
        roots = self.scale * above[finite] / below[finite]
        slowest = roots.real.max() - EQUAL * np.abs(roots)
        kept = (-roots.real < RELAXATION * np.abs(roots)) | (roots.real >= slowest)
        return roots[kept], x[:size, finite[kept]], y[:size, finite[kept]]

    def _pencil(self, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Matrices A and B of the eigenvalue problem ``A v = (s / S) B v``, v = (x, y_1, ...)."""
        indices, weights, _ = self.support
        size = len(mass)
        count = len(indices)
        shifts = self.shifts[indices] / self.scale
        values = self.values[indices]
        unit = np.linalg.norm(self.values[0])
        inertia = self.scale**2 * mass
        terms = shifts[:, None, None] * inertia + values / (1.0 + shifts)[:, None, None]
        dynamic = shifts[:, None, None] ** 2 * inertia + values
        motion = np.zeros(((count + 1) * size,) * 2)
        motion[:size, :size] = -np.tensordot(weights, terms, 1) / unit
        motion[:size, size:] = -np.hstack(list(weights[:, None, None] * dynamic)) / unit
        motion[size:, :size] = np.tile(np.eye(size), (count, 1))
        motion[size:, size:] = np.kron(np.diag(shifts), np.eye(size))
        return motion, linalg.block_diag(weights.sum() * inertia / unit, np.eye(count * size))


def _support(shifts: np.ndarray, values: np.ndarray) -> Support:
    """Support with the weights that interpolate values at all shifts best, shape (n, c)."""
    sizes = np.linalg.norm(values, axis=1)
    best = Support(np.zeros(1, dtype=int), np.ones(1), np.inf)
    support = [0]
    while True:
        others = np.setdiff1d(np.arange(len(shifts)), support)
        cauchy = 1.0 / (shifts[others, None] - shifts[support])
        # Rows of all values at the other shifts, one column for each shift of the support.
        loewner = (values[others, None] - values[support]) * cauchy[:, :, None]
        loewner = (loewner / sizes[others, None, None]).transpose(0, 2, 1).reshape(-1, len(support))
        weights = np.linalg.svd(np.linalg.qr(loewner, mode="r"))[2][-1]
        factors = weights * cauchy
        factors /= factors.sum(axis=1, keepdims=True)
        errors = np.linalg.norm(factors @ values[support] - values[others], axis=1) / sizes[others]
        if errors.max() < best.error and not _unstable(shifts[support] / shifts[-1], weights):
            best = Support(np.array(support), weights, float(errors.max()))
        if best.error <= SMALL_ERROR or len(support) == LARGEST_SUPPORT:
            return best
        support.append(int(others[np.argmax(errors)]))


def _unstable(shifts: np.ndarray, weights: np.ndarray) -> bool:
    """True if ``sum w_j / (s - s_j)`` has a zero, a pole of the interpolant, with Re s > 0."""
    count = len(shifts)
    matrix = np.diag(np.append(0.0, shifts))
    matrix[0, 1:] = weights
    matrix[1:, 0] = 1.0
    unit = np.diag(np.append(0.0, np.ones(count)))
    above, below = linalg.eig(matrix, unit, right=False, homogeneous_eigvals=True)
    finite = finite_roots(above, below)
    return bool((above[finite] / below[finite]).real.max(initial=-1.0) > 0.0)
