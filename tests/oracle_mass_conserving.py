"""Mass-conserving cavitation in one dimension without fenics_ehd, by its free boundaries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq


def _trapezoid(y: np.ndarray, x: np.ndarray) -> float:
    """Of both versions of NumPy."""
    return float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x)))


@dataclass(frozen=True)
class JournalFilm:
    """Infinitely wide journal bearing, supplied by a line at the largest gap, steady.

    Dimensionless: flow ``V H theta - H^3 dP/dx``, gap ``H = 1 + e cos x``. The film is
    full from the supply at x = 0 to the rupture, where P and its slope vanish, empty
    but for what leaks through there, ``theta H = H(rupture)``, and full again from
    the reformation, where the flows on both sides agree, to the supply at 2 pi.
    """

    eccentricity: float
    velocity: float
    supply: float

    def gap(self, x: np.ndarray) -> np.ndarray:
        return 1 + self.eccentricity * np.cos(x)

    def _rise(self, start: float, end: float, leak: float) -> float:
        """Pressure at `end` less that at `start` for the flow ``V leak``."""
        slope = lambda x: self.velocity * (self.gap(x) - leak) / self.gap(x) ** 3  # noqa: E731
        return quad(slope, start, end, epsabs=1e-13, epsrel=1e-13, limit=400)[0]

    @property
    def rupture(self) -> float:
        def excess(x: float) -> float:
            return self._rise(0.0, x, self.gap(x)) + self.supply

        return brentq(excess, np.pi + 1e-6, 2 * np.pi - 1e-6, xtol=1e-13)

    @property
    def reformation(self) -> float:
        leak = self.gap(self.rupture)
        mirrored = 2 * np.pi - self.rupture  # where the gap equals that at the rupture

        def excess(x: float) -> float:
            return self._rise(x, 2 * np.pi, leak) - self.supply

        return brentq(excess, max(self.rupture, mirrored), 2 * np.pi, xtol=1e-13)

    @property
    def largest_pressure(self) -> float:
        return self.supply + self._rise(0.0, 2 * np.pi - self.rupture, self.gap(self.rupture))

    @property
    def void(self) -> float:
        """``int (1 - theta) H dx``."""
        start, end = self.rupture, self.reformation
        return quad(lambda x: self.gap(x) - self.gap(start), start, end)[0]


@dataclass(frozen=True)
class SqueezedPlates:
    """Parallel plates of width 2 a, pressure p_a at both ends, gap ``h(t)`` given.

    The middle ``|z| < S(t)`` is empty. While it grows, the pressure and its slope vanish
    at its edge: ``S = a - sqrt(2 p_a / K)``, ``K = 12 eta h' / h^3``. While it shrinks, the
    oil flowing in fills up what the oil left there lacks: ``(h - h_S) S' = -q``, with
    ``h_S(z)`` the gap when z became empty.
    """

    half_width: float
    viscosity: float
    ambient: float
    gap: Callable[[float], float]
    rate: Callable[[float], float]

    def _curvature(self, t: float) -> float:
        return 12 * self.viscosity * self.rate(t) / self.gap(t) ** 3

    def _growing(self, t: float) -> float:
        return self.half_width - np.sqrt(2 * self.ambient / self._curvature(t))

    def edges(self, before: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """S [m] and empty volume per length of the plates [m^2] at times after the onset.

        `before` is a time after which K first rises and then falls.
        """
        fine = np.linspace(before, times[-1], 40001)
        curvature = np.array([self._curvature(t) for t in fine])
        peak = fine[np.argmax(curvature)]
        onset = brentq(
            lambda t: self._curvature(t) - 2 * self.ambient / self.half_width**2, before, peak
        )

        growth = np.linspace(onset, peak, 4001)
        became_empty = [max(self._growing(t), 0.0) for t in growth]
        gap_then = [self.gap(t) for t in growth]

        def gap_left(z: np.ndarray) -> np.ndarray:
            return np.interp(z, became_empty, gap_then)

        def shrink(t: float, s: np.ndarray) -> list[float]:
            film = self.half_width - s[0]
            slope = self.ambient / film - self._curvature(t) * film / 2
            flow = self.gap(t) ** 3 / (12 * self.viscosity) * slope
            return [-max(flow, 0.0) / max(self.gap(t) - gap_left(s[0]), 1e-4 * self.gap(t))]

        closed = lambda t, s: s[0] - 1e-3 * self.half_width  # noqa: E731
        closed.terminal = True
        run = solve_ivp(
            shrink, (peak, times[-1]), [self._growing(peak)], method="LSODA", rtol=1e-8,
            atol=1e-10 * self.half_width, dense_output=True, events=closed,
        )  # fmt: skip
        edges = np.zeros(len(times))
        voids = np.zeros(len(times))
        for i, t in enumerate(times):
            if onset < t <= peak:
                edges[i] = self._growing(t)
            elif peak < t <= run.t[-1]:
                edges[i] = run.sol(t)[0]
            z = np.linspace(0.0, edges[i], 201)
            empty = self.gap(t) - gap_left(z)
            voids[i] = 2 * np.sum(0.5 * (empty[1:] + empty[:-1]) * np.diff(z))
        return edges, voids


@dataclass(frozen=True)
class ClosedJournalFilm:
    """Infinitely wide journal bearing without supply that holds a share of its oil, steady.

    Dimensionless as `JournalFilm`, in the frame of the line of centres, which may whirl:
    ``H = 1 + e cos x``. The film is full from the reformation to the rupture, where pressure and
    slope vanish; all along flows what the rupture lets through, ``H(rupture)`` over the velocity.
    The rupture is where the content is the given share of the gap.
    """

    eccentricity: float
    filling: float

    def gap(self, x: np.ndarray) -> np.ndarray:
        """What holds oil."""
        return 1 + self.eccentricity * np.cos(x)

    def carried(self, x: np.ndarray) -> np.ndarray:
        """Flow of a full gap without pressure, over the velocity."""
        return self.gap(x)

    def mobility(self, x: np.ndarray) -> np.ndarray:
        return self.gap(x) ** 3

    def rise(self, start: float, end: float, rupture: float) -> float:
        """Pressure at `end` less that at `start` for unit velocity."""
        slope = lambda x: (self.carried(x) - self.carried(rupture)) / self.mobility(x)  # noqa: E731
        return quad(slope, start, end, epsabs=1e-13, epsrel=1e-13, limit=400)[0]

    def _reformation(self, rupture: float) -> float:
        mirrored = 2 * np.pi - rupture
        return brentq(lambda x: self.rise(x, rupture, rupture), rupture - 2 * np.pi, mirrored)

    def _content(self, rupture: float) -> float:
        start = self._reformation(rupture)
        full = quad(self.gap, start, rupture)[0]
        left = quad(lambda x: self.gap(x) / self.carried(x), rupture, 2 * np.pi + start)[0]
        return full + left * self.carried(rupture)

    @cached_property
    def boundaries(self) -> tuple[float, float]:
        """Reformation and rupture, from the largest gap, the first may be negative."""
        wanted = self.filling * quad(self.gap, 0.0, 2 * np.pi)[0]
        # A rupture farther on needs more oil than the gap holds: the film would be full.
        last = np.pi + 1e-6
        while self.rise(last - 2 * np.pi, last, last) > 0 and last < 2 * np.pi:
            last += 1e-3
        rupture = brentq(lambda x: self._content(x) - wanted, np.pi + 1e-3, last - 1e-3)
        return self._reformation(rupture), rupture

    @property
    def largest_pressure(self) -> float:
        start, rupture = self.boundaries
        return self.rise(start, 2 * np.pi - rupture, rupture)


@dataclass(frozen=True)
class RoughClosedJournalFilm(ClosedJournalFilm):
    """The same between rough surfaces, by quadrature over Gaussian heights.

    Oil is held by the mean of the gaps that are open; the pressure's flow is ``h^3 phi_p``, that of
    the velocity V has ``drag phi_s`` and that mean, ``drag = sigma w (U / 2) / V``: both as
    Patir and Cheng have them for H = h / sigma from 0.5 to 5.
    """

    roughness: float
    drag: float = 0.0

    def _ratio(self, x: np.ndarray) -> np.ndarray:
        return (1 + self.eccentricity * np.cos(x)) / self.roughness

    def gap(self, x: np.ndarray) -> np.ndarray:
        return self.roughness * self._means(self._ratio(x))

    @cached_property
    def _means(self) -> CubicSpline:
        """Mean of the open gaps over the roughness by H, at places close enough for 1e-9."""
        ratio = np.linspace(0.0, 2 / self.roughness, 801)
        nodes, weights = np.polynomial.legendre.leggauss(80)
        low = -ratio[:, None]
        height = low + (9.0 - low) * (nodes + 1) / 2
        density = np.exp(-(height**2) / 2) / np.sqrt(2 * np.pi)
        return CubicSpline(ratio, np.sum(weights * (height - low) * density * (9.0 - low) / 2, -1))

    def carried(self, x: np.ndarray) -> np.ndarray:
        ratio = self._ratio(x)
        shear = 1.899 * ratio**0.98 * np.exp(-0.92 * ratio + 0.05 * ratio**2)
        return self.gap(x) + self.drag * shear

    def mobility(self, x: np.ndarray) -> np.ndarray:
        ratio = self._ratio(x)
        return (self.roughness * ratio) ** 3 * (1 - 0.9 * np.exp(-0.56 * ratio))


@dataclass(frozen=True)
class SqueezedJournal:
    """Infinitely wide journal that moves along x without turning, ``H = 1 - e(t) cos phi``.

    Lines of supply at a pressure ``P_s`` at ``phi = +-pi/2``; dimensionless, the flow along phi is
    ``-H^3 dP/dphi``, so that ``H^3 dP/dphi`` grows by dH/dt. Next to the largest distance, phi = 0,
    the half that opens may become empty for ``|phi| < S(t)``. While that grows, pressure and slope
    vanish at its edge; what is empty keeps the oil that it had, and while it shrinks the flow fills
    what lacks: ``(H - H_S) S' = -Q`` with ``H_S(phi)`` the gap when phi became empty.
    """

    eccentricity: Callable[[float], float]
    rate: Callable[[float], float]
    supply: float

    def gap(self, t: float, x: np.ndarray) -> np.ndarray:
        return 1 - self.eccentricity(t) * np.cos(x)

    def _integrals(self, t: float, edge: float) -> tuple[float, float]:
        """Pressure over the full part for no flow at its edge, and of unit flow."""
        x = np.linspace(edge, np.pi / 2, 2001)
        cubed = self.gap(t, x) ** 3
        squeezed = -self.rate(t) * (np.sin(x) - np.sin(edge))
        return _trapezoid(squeezed / cubed, x), _trapezoid(1 / cubed, x)

    def _flow(self, t: float, edge: float) -> float:
        """``H^3 dP/dphi`` at the edge: oil that comes there."""
        squeezed, unit = self._integrals(t, edge)
        return (self.supply - squeezed) / unit

    def edges(self, start: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """S [rad] and the empty area of the half, of both sides, at times."""
        fine = np.linspace(start, times[-1], 2001)
        growing = [0.0]
        for t in fine[1:]:
            flow = self._flow(t, 0.0)
            found = brentq(lambda s, t=t: self._flow(t, s), 0.0, 1.57) if flow < 0 else 0.0
            growing.append(found)
        peak = int(np.argmax(growing))
        when = fine[: peak + 1]
        first = np.flatnonzero(growing)[0] - 1
        places, then = np.array(growing[first : peak + 1]), when[first:]

        def gap_left(x: np.ndarray) -> np.ndarray:
            return np.array([self.gap(float(np.interp(y, places, then)), y) for y in np.ravel(x)])

        def shrink(t: float, s: np.ndarray) -> list[float]:
            edge = max(s[0], 0.0)
            lacks = float(self.gap(t, edge) - gap_left(np.array([edge]))[0])
            return [-max(self._flow(t, edge), 0.0) / max(lacks, 1e-5)]

        closed = lambda t, s: s[0] - 1e-3  # noqa: E731
        closed.terminal = True
        run = solve_ivp(
            shrink, (when[-1], times[-1]), [growing[peak]], method="LSODA", rtol=1e-7, atol=1e-9,
            dense_output=True, events=closed,
        )  # fmt: skip
        edges = np.interp(times, fine, growing)
        late = times > when[-1]
        found = run.sol(np.minimum(times[late], run.t[-1]))[0]
        edges[late] = np.where(times[late] <= run.t[-1], found, 0.0)
        voids = []
        for t, edge in zip(times, edges, strict=True):
            x = np.linspace(0.0, edge, 401)
            voids.append(2 * _trapezoid(self.gap(t, x) - gap_left(x), x) if edge else 0.0)
        return edges, np.array(voids)
