"""How courses differ over time, between the steps they were found at.

Steps that are long meet an extreme on either side of it, and what they change there changes its
sign: courses are compared as smooth curves. What a run says of itself is sampled, at nodes and at
steps: how far that is from its own smooth curve is part of the errors. Where a cycle was followed
beyond its end, a change is what it is the second time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.multibody.course import Course

#: Parts of a step between which curves are read.
PARTS = 5

#: What differs is followed beyond a cycle's end until this share is left of its beginning, at
#: most for a second cycle.
SETTLED = 0.3

#: Share left from cycle to cycle above which what is to come is not extrapolated further.
SLOWEST = 0.9


@dataclass(frozen=True, eq=False)
class Change:
    """Estimated error of a component over time: what the exact solution has more.

    Attributes
    ----------
    times
        shape (k,) [s].
    peaks, films
        What the run says, shape (k, joints) [Pa], [m].
    more_pressure, more_film
        shape (k, joints) [Pa], [m].
    """

    times: np.ndarray
    peaks: np.ndarray
    films: np.ndarray
    more_pressure: np.ndarray
    more_film: np.ndarray

    def and_also(self, other: Change) -> Change:
        """Both changes together."""
        more = self.more_pressure + other.more_pressure, self.more_film + other.more_film
        return Change(self.times, self.peaks, self.films, *more)


@dataclass(frozen=True, eq=False)
class ErrorCurves:
    """Of a run's course.

    Attributes
    ----------
    course
        Of its last cycle, or all of it.
    began
        Time at which it begins [s].
    period
        Of a cycle [s], None of a run that is not periodic.
    """

    course: Course
    began: float
    period: float | None = None

    @cached_property
    def times(self) -> np.ndarray:
        """All at which curves are read, those of the run's steps among them [s]."""
        times = self.course.times
        before = np.append(self.began, times[:-1])
        between = [times - share * (times - before) for share in np.arange(PARTS) / PARTS]
        return np.unique(between)

    def _at_steps(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times and values of the run; of a cycle its end is its beginning, too."""
        times = self.course.times
        if self.period is None:
            return times, values
        return np.append(times[-1] - self.period, times), np.vstack([values[-1:], values])

    @cached_property
    def own(self) -> tuple[np.ndarray, np.ndarray]:
        """What the run says of peaks and films, shape (k, joints)."""
        assert self.course.sampled is not None
        peaks, films = (_linear(self.times, *self._at_steps(own)) for own in self.course.sampled)
        return peaks, films

    @cached_property
    def sampling(self) -> Change:
        """What its values between nodes and steps have more."""
        smooth = []
        for values in (self.course.peaks, self.course.films):
            times, points = self._at_steps(values)
            found = _curve(times, points)(self.times)
            smooth.append(np.where(np.isfinite(found), found, points[0]))
        more = [curve - own for curve, own in zip(smooth, self.own, strict=True)]
        return Change(self.times, *self.own, *more)

    def change(
        self, before: Course, after: Course, factor: float | np.ndarray, left: float = 0.0
    ) -> Change:
        """From a course to a changed one, times a factor.

        Of a change over a cycle the next one leaves a share of either sign, 0: nothing is known of
        cycles beyond the second.
        """
        found = []
        for name in ("peaks", "films"):
            curves = [_curve(each.times, getattr(each, name)) for each in (before, after)]
            found.append(factor * self._between(curves, min(left, SLOWEST)))
        return Change(self.times, *self.own, *found)

    def _between(self, curves: Sequence[Callable], left: float) -> np.ndarray:
        before, after = curves
        first = after(self.times) - before(self.times)
        if self.period is None:
            return np.nan_to_num(first)
        later = self.times + self.period
        second = after(later) - before(later)
        more = second - np.where(np.isfinite(first), first, second)
        settled = second + left / (1.0 - left) * more
        return np.nan_to_num(np.where(np.isfinite(second), settled, first))

    def given(self, times: np.ndarray, more_pressure: np.ndarray, more_film: np.ndarray) -> Change:
        """Changes that are known at some times, shape (k, joints)."""
        found = [_linear(self.times, times, values) for values in (more_pressure, more_film)]
        return Change(self.times, *self.own, *found)


def _linear(wanted: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Broken lines through values, shape (k, joints)."""
    return np.column_stack([np.interp(wanted, times, own) for own in values.T])


def _curve(times: np.ndarray, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Smooth curves through values, shape (k, joints); nan where there are none."""
    if len(times) < 2:
        return lambda wanted: np.full((len(wanted), values.shape[1]), np.nan)
    from scipy.interpolate import Akima1DInterpolator  # slow to import, and for budgets alone

    curve = Akima1DInterpolator(times, values)
    return lambda wanted: np.asarray(curve(wanted, extrapolate=False))
