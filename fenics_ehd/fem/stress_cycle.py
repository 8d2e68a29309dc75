"""What a cycle of stress tensors says of fatigue: largest half-range, its mean, principal stress.

The half-range of a pair of instants i, j is the tensor ``(s_i - s_j) / 2``; of all pairs that one
counts whose half-range has the largest von Mises stress. Code_Aster's R7.04.04 has the same
maximum over pairs of instants (DEPSPE, of plastic strains,
docaster-en-codeaster-doc-4113bb35b8213385c636b94f1536856d7f617.gitlab.io,
man_r/r7/r7.04.04/Crit_res_en_formule). Directions that turn are followed, which a difference of two
von Mises stresses does not do.

The mean is ``(s_i + s_j) / 2`` of the same pair, so that both belong to one cycle between two
states that were there, as in a Haigh diagram; a mean over time would depend on how long the load
lingers where.

In the five coordinates of `deviatoric` a von Mises stress is a length, and the largest range the
diameter of a set of points. It is found exactly, not by trying all pairs: two sweeps to the
farthest point give a pair at distance L; about its middle, another pair can only be farther apart
if one point's distance and the largest of any exceed L together. Where stress swings along a line
that leaves a few points near its ends; where it turns on a circle all, and all pairs are tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Numbers in memory at a time while pairs are tried.
_PAIRS = 1 << 22

_ROOT3 = np.sqrt(3.0)

#: Places of the Voigt stresses xx, yy, zz, yz, xz, xy in the tensor.
_TENSOR = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def deviatoric(stress: np.ndarray) -> np.ndarray:
    """Coordinates in which the von Mises stress is the Euclidean norm.

    Parameters
    ----------
    stress
        Voigt stresses xx, yy, zz, yz, xz, xy, shape (..., 6) [Pa].

    Returns
    -------
    numpy.ndarray
        Linear in the stress, shape (..., 5) [Pa].
    """
    xx, yy, zz = (stress[..., i] for i in range(3))
    plane = [xx - 0.5 * (yy + zz), 0.5 * _ROOT3 * (yy - zz)]
    return np.stack([*plane, *(_ROOT3 * stress[..., i] for i in range(3, 6))], axis=-1)


@dataclass(frozen=True, eq=False)
class HalfRange:
    """Largest half-range of points [Pa].

    Attributes
    ----------
    instants
        The pair, ascending, shape (points, 2).
    von_mises
        Of the half-range, shape (points,) [Pa].
    half_range, mean
        Half the later stress less the earlier one, and half their sum, shape (points, 6) [Pa].
    """

    instants: np.ndarray
    von_mises: np.ndarray
    half_range: np.ndarray
    mean: np.ndarray


def largest_half_range(stress: np.ndarray) -> HalfRange:
    """Largest half-range over all pairs of instants, exact to round-off.

    Parameters
    ----------
    stress
        Histories, shape (points, 6, instants) [Pa].
    """
    points = deviatoric(np.moveaxis(stress, 1, 2))
    pair = _farthest(points)
    pair.sort(axis=1)
    first, last = (np.take_along_axis(stress, pair[:, None, i : i + 1], 2)[..., 0] for i in (0, 1))
    half = 0.5 * (last - first)
    return HalfRange(pair, np.linalg.norm(deviatoric(half), axis=1), half, 0.5 * (first + last))


def _farthest(points: np.ndarray) -> np.ndarray:
    """The pair of instants farthest apart, of every set of points (sets, instants, 5)."""
    pair = np.zeros((len(points), 2), dtype=np.int64)
    reach = np.zeros(len(points))
    for end in (0, 1, 0):
        distances = _distances(points, _at(points, pair[:, 1 - end]))
        pair[:, end] = distances.argmax(axis=1)
        reach = distances.max(axis=1)
    centred = points - 0.5 * (_at(points, pair[:, 0]) + _at(points, pair[:, 1]))[:, None]
    radii = np.linalg.norm(centred, axis=2)
    candidate = radii + radii.max(axis=1)[:, None] > reach[:, None]
    counts = candidate.sum(axis=1)
    # Sets of about as many candidates together, these first.
    order = np.argsort(~candidate, axis=1, kind="stable")
    sets = np.argsort(counts, kind="stable")
    sets = sets[counts[sets] > 1]
    while len(sets):
        ahead = np.arange(1, len(sets) + 1) * counts[sets] ** 2
        block, sets = np.split(sets, [max(1, int(np.searchsorted(ahead, _PAIRS)))])
        chosen = order[block, : counts[block[-1]]]
        _try_all(
            block, chosen, np.take_along_axis(centred[block], chosen[..., None], 1), pair, reach
        )
    return pair


def _try_all(
    sets: np.ndarray, chosen: np.ndarray, points: np.ndarray, pair: np.ndarray, reach: np.ndarray
) -> None:
    """Take the farthest pair of some instants of some sets where it beats the one known."""
    squares = np.einsum("pic,pic->pi", points, points)
    apart = squares[:, :, None] + squares[:, None] - 2 * points @ points.swapaxes(1, 2)
    best = apart.reshape(len(sets), -1).argmax(axis=1)
    first, last = np.divmod(best, apart.shape[2])
    row = np.arange(len(sets))
    better = np.linalg.norm(points[row, first] - points[row, last], axis=1) > reach[sets]
    found = np.column_stack([chosen[row, first], chosen[row, last]])
    pair[sets[better]] = found[better]


def _at(points: np.ndarray, instants: np.ndarray) -> np.ndarray:
    return points[np.arange(len(points)), instants]


def _distances(points: np.ndarray, origins: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - origins[:, None], axis=2)


def largest_principal(stress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest principal stress over the cycle.

    Parameters
    ----------
    stress
        Histories, shape (points, 6, instants) [Pa].

    Returns
    -------
    values, instants : numpy.ndarray
        shape (points,) each [Pa].
    """
    mean = stress[:, :3].mean(axis=1)
    equivalent = np.linalg.norm(deviatoric(np.moveaxis(stress, 1, 2)), axis=2)
    # With von Mises stress q and mean stress m it lies from m + q / 3 to m + 2 q / 3, so that few
    # instants can have it; of the others the bound below stands for it.
    values = mean + equivalent / 3
    possible = mean + 2 * equivalent / 3 >= values.max(axis=1)[:, None]
    tensors = np.moveaxis(stress, 1, 2)[possible][:, _TENSOR]
    values[possible] = np.linalg.eigvalsh(tensors)[:, 2]
    instants = values.argmax(axis=1)
    return _at(values, instants), instants
