"""Loads from tables whose rows no step of an integration may jump over.

Nobody asks for a load between two steps: the rows that lie there count only as far as the values
at the steps foretell them. An estimate of the solution's error cannot tell, as a solution that
never met a load is as smooth as one without it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_ehd.multibody.differentiation import extrapolation_weights

#: A row is missed if its value is further than this, of the largest one, from the polynomial. The
#: gas of an engine in rows of two degrees stays below a third of it at the default tolerances.
MISSED = 0.01

#: Past points of the polynomial, which is cubic as the curves through tables are.
POINTS = 3

#: A step over more than so many periods is no step that a table allows.
PERIODS = 10


@dataclass(frozen=True, eq=False)
class TabulatedLoad:
    """A periodic table over the time, or over an angle that the state of a mechanism knows.

    Attributes
    ----------
    rows
        Places of its values, ascending over one period, both ends included, shape (n,).
    values
        There, the last one that of the first, shape (n,) or (n, c).
    at
        The curve through them.
    place
        Where a table is read at a time [s] and a state.
    """

    rows: np.ndarray
    values: np.ndarray
    at: Callable[[float], float | np.ndarray]
    place: Callable[[float, np.ndarray], float]

    def missed(self, times: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much a step misses the rows within it.

        Parameters
        ----------
        times, states
            Points of the integration, newest first: the end of the step, its beginning, and those
            before [s].

        Returns
        -------
        when, amount : numpy.ndarray
            Times of the rows strictly within the step [s], and how far their values lie from the
            polynomial through those at the points, over the largest of the table. Half the step
            and infinity, if it leads across more than `PERIODS` or to no place at all.
        """
        places = np.array([self.place(t, x) for t, x in zip(times, states, strict=True)])
        end, start = places[:2]
        period = self.rows[-1] - self.rows[0]
        if not abs(end - start) <= PERIODS * period:
            return 0.5 * (times[:1] + times[1:2]), np.array([np.inf])
        first, last = np.floor((np.sort(places[:2]) - self.rows[0]) / period)
        rows = np.add.outer(period * np.arange(first, last + 1), self.rows[:-1]).ravel()
        within = np.flatnonzero((rows - start) * (rows - end) < 0)
        when = times[1] + (rows[within] - start) / (end - start) * (times[0] - times[1])
        known = np.array([np.atleast_1d(self.at(place)) for place in places])
        foretold = extrapolation_weights(times, when[:, None]).T @ known
        values = self.values.reshape(len(self.values), -1)
        distance = np.abs(foretold - values[within % (len(values) - 1)]).max(axis=1)
        return when, distance / max(np.abs(values).max(), np.finfo(float).tiny)


def rows_missed(
    loads: Sequence[TabulatedLoad], times: np.ndarray, states: np.ndarray, nearest: float
) -> tuple[np.ndarray, bool]:
    """Rows within a step, and whether it misses one of them.

    Parameters
    ----------
    loads, times, states
        See `TabulatedLoad.missed`.
    nearest
        Rows nearer than this to the beginning of the step belong to a jump and are left out [s].

    Returns
    -------
    when : numpy.ndarray
        Ascending [s].
    missed : bool
    """
    found = [load.missed(times, states) for load in loads]
    when, amount = (np.concatenate(parts) for parts in zip(*found, strict=True))
    late = when > times[1] + nearest
    return np.sort(when[late]), bool((amount[late] > MISSED).any())
