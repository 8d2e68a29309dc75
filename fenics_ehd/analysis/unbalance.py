"""Unbalance response: steady vibration of a rotor under forces that rotate with it.

An unbalance ``m e`` at the angle phi of its body gives the force
``m e Omega^2 (cos(Omega t + phi), sin(Omega t + phi))``. With ``omega = |Omega|`` and the sense of
rotation ``s = Omega / |Omega|`` it is the real part of ``F exp(i omega t)``,

    F = m e omega^2 (1, -i s) exp(i s phi).

About an equilibrium with the motions ``z = Z q`` and ``M q'' + D q' + K q = Z^T f`` the response is

    q = H(i omega)^-1 Z^T F,    H(i omega) = K + i omega D - omega^2 M,

where H of a machine with residual patterns of elastic bores is interpolated
(`fenics_ehd.analysis.film_memory`).

A point moves on an ellipse, whose larger half axis is the amplitude of the point. A part of the
deflection rotates with the body. The phase is the angle of this part from the body's x axis,
positive from x to y like phi. The force of a film on its journal is ``-(k_f + i omega d_f) q``, or
its interpolated share of H.

The amplification factor of a resonance at the speed Omega_r is ``Omega_r / (Omega_2 - Omega_1)``
(API 617). At the speeds Omega_1 and Omega_2, on both sides of the resonance, the amplitude is lower
by 3 dB, a factor of ``sqrt(1/2)``. Resonances are located on a finer grid of speeds, for which
M, D, K and samples of H are interpolated.

A maximum is a resonance if it is prominent: higher by a share of `PROMINENCE` than the minima
between it and higher amplitudes, or the ends of the range, on both sides. Lower maxima are no
evidence of a resonance, because stiffness and damping jump by about 1 % when the end of a film
moves past a row of nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fenics_ehd.analysis.equilibrium import Linearisation
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import key_hint
from fenics_ehd.multibody.forces import Unbalance

#: Number of intervals between two neighbouring speeds in which resonances are located.
FINER = 10

#: Ratio of the amplitudes at the peak of a resonance and at the ends of its bandwidth.
BANDWIDTH = np.sqrt(2.0)

#: Least prominence of a resonance, with means over film meshes and with one mesh. Maxima due to
#: jumps of the coefficients had up to 0.5 % and 8 % (three rotors, 12 to 90 speeds); the smallest
#: resonance on which these grids and meshes agree had 2 %.
PROMINENCE = 0.01
PROMINENCE_ON_ONE_MESH = 0.1

#: Sum of forces over the sum of their magnitudes below which unbalances cancel each other.
CANCELLED = 1e-12


class Resonance(NamedTuple):
    """Prominent maximum of the amplitude of a point over the speed.

    Attributes
    ----------
    point
        Name of the point.
    speed
        Speed at the maximum [rad/s].
    amplitude
        Amplitude of the point at this speed: larger half axis of its ellipse [m].
    amplification
        Amplification factor [-]; None if the amplitude decreases by less than 3 dB on a side.
    """

    point: str
    speed: float
    amplitude: float
    amplification: float | None


class SteadyVibration(NamedTuple):
    """Vibration of the points of a rotor over the speed.

    Attributes
    ----------
    speeds, deflections, forces
        Speeds, complex amplitudes of deflections, and complex amplitudes of film forces, see the
        attributes of these names of `UnbalanceResponse`.
    journals
        Complex amplitudes of the motion of the journals in their bores, by name of the joint, shape
        (s, 2) [m].
    """

    speeds: np.ndarray
    deflections: np.ndarray
    forces: dict[str, np.ndarray]
    journals: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class UnbalanceResponse(Described):
    """Steady vibration of a rotor under its unbalances, over the speed.

    Attributes
    ----------
    unbalances
        Unbalances of the rotor.
    speeds
        Speeds Omega, shape (s,) [rad/s].
    points
        Names of the p points.
    deflections
        Deflections (u, v) of the points as complex amplitudes, shape (s, p, 2) [m].
    forces
        Forces of the films on their journals as complex amplitudes, by name of the joint, shape
        (s, 2) [N].
    resonances
        Resonances of all points, in the order of the points.
    interpolated
        The same response at more speeds, for which M, D and K are interpolated.
    excited
        Whether a force acts; False if all magnitudes are 0 or the unbalances cancel each other.
    """

    unbalances: tuple[Unbalance, ...]
    speeds: np.ndarray
    points: tuple[str, ...]
    deflections: np.ndarray
    forces: dict[str, np.ndarray]
    resonances: tuple[Resonance, ...]
    interpolated: SteadyVibration
    excited: bool = True

    def amplitude(self, point: str) -> np.ndarray:
        """Amplitude of a point over the speed: larger half axis of its ellipse, shape (s,) [m]."""
        return larger_axes(self._deflections_of(point))

    def phase(self, point: str) -> np.ndarray:
        """Phase of a point over the speed, as the module defines it, shape (s,) [rad]."""
        return phases(self._deflections_of(point), float(np.sign(self.speeds[0])))

    def bearing_force(self, joint: str) -> np.ndarray:
        """Amplitude of the film force in a joint over the speed, shape (s,) [N].

        It is the larger half axis of the ellipse that the force describes.
        """
        if joint not in tuple(self.forces):
            raise SettingsError(f"there is no film {joint!r}: {key_hint(self.forces, str(joint))}")
        return larger_axes(self.forces[joint])

    def _deflections_of(self, point: str) -> np.ndarray:
        """Complex amplitudes of the deflections of a point over the speed, shape (s, 2) [m].

        Raises
        ------
        SettingsError
            The rotor has no such point; the message suggests a similar point.
        """
        if point not in self.points:
            hint = key_hint(self.points, str(point))
            raise SettingsError(f"the rotor has no point {point!r}: {hint}")
        return self.deflections[:, self.points.index(point)]


def larger_axes(amplitudes: np.ndarray) -> np.ndarray:
    """Larger half axes of the ellipses with the complex amplitudes (u, v), shape (...).

    `amplitudes` has the shape (..., 2).
    """
    u, v = np.moveaxis(amplitudes, -1, 0)
    return np.asarray(0.5 * (np.abs(u + 1j * v) + np.abs(u - 1j * v)))


def phases(amplitudes: np.ndarray, sense: float) -> np.ndarray:
    """Phases of deflections [rad], as the module defines them, shape (...).

    `amplitudes` are complex amplitudes (u, v), shape (..., 2); `sense` is the sense of rotation, 1
    or -1.
    """
    u, v = np.moveaxis(amplitudes, -1, 0)
    return np.asarray(sense * np.angle(u + 1j * sense * v))


def unbalance_force(unbalance: Unbalance, rows: np.ndarray, speed: float) -> np.ndarray:
    """Complex amplitude of the generalised force of an unbalance, shape (n,).

    Parameters
    ----------
    unbalance
        The unbalance.
    rows
        Derivatives of the deflections (u, v) of its point with respect to the n coordinates z,
        shape (2, n).
    speed
        Speed Omega [rad/s].
    """
    sense = np.sign(speed)
    turned = np.exp(1j * sense * np.radians(unbalance.phase))
    amplitude = unbalance.magnitude * speed**2 * turned * np.array([1.0, -1j * sense])
    return np.asarray(rows.T @ amplitude)


def response(linear: Linearisation, force: np.ndarray, frequency: float) -> np.ndarray:
    """Complex amplitude of the motion q under a generalised force, shape (k,).

    `force` is the complex amplitude of the force on the coordinates z, shape (n,); `frequency` is
    its angular frequency [rad/s].
    """
    dynamic = linear.dynamic_stiffness(1j * frequency)
    return np.asarray(np.linalg.solve(dynamic, linear.basis.T @ force))


def film_force(
    linear: Linearisation, name: str, motion: np.ndarray, frequency: float
) -> np.ndarray:
    """Complex amplitude of the force of a film on its journal, shape (2,) [N].

    `name` is that of its joint, `motion` the complex amplitude of q, and `frequency` its angular
    frequency [rad/s].
    """
    return np.asarray(-linear.film_stiffness(name, 1j * frequency) @ motion)


def unbalance_response(
    unbalances: Sequence[Unbalance],
    rows: Sequence[np.ndarray],
    points: tuple[str, ...],
    point_rows: np.ndarray,
    linears: Sequence[Linearisation],
    speeds: np.ndarray,
    journal_rows: Mapping[str, np.ndarray],
    prominence: float = PROMINENCE,
) -> UnbalanceResponse:
    """Compute the steady vibration of a rotor under unbalances, at s speeds.

    Parameters
    ----------
    unbalances, rows
        Unbalances; and for each of them the derivatives of its point's deflections with respect to
        z, shape (2, n).
    points, point_rows
        Names of the p points whose deflections are reported; and derivatives of these deflections
        with respect to z, shape (p, 2, n).
    linears, speeds
        Small motions at each speed, in the same coordinates q; and the speeds, shape (s,) [rad/s].
    journal_rows
        Derivatives of the position of the journal in the bore with respect to z, by name of the
        joint, shape (2, n) each.
    prominence
        Least prominence of a resonance, see the module.
    """
    pairs = list(zip(unbalances, rows, strict=True))
    excited = _excited(pairs, float(speeds[0]))

    def vibration(each: Sequence[tuple[float, Linearisation]]) -> SteadyVibration:
        deflections = []
        forces: dict[str, list[np.ndarray]] = {name: [] for name in linears[0].films}
        journals: dict[str, list[np.ndarray]] = {name: [] for name in journal_rows}
        for speed, linear in each:
            loads = [unbalance_force(unbalance, along, speed) for unbalance, along in pairs]
            total = np.sum(loads, axis=0) if excited else 0.0 * loads[0]
            motion = response(linear, total, abs(speed))
            deflections.append(point_rows @ linear.basis @ motion)
            for name in linear.films:
                forces[name].append(film_force(linear, name, motion, abs(speed)))
            for name, along in journal_rows.items():
                journals[name].append(along @ linear.basis @ motion)
        return SteadyVibration(
            np.array([s for s, _ in each]),
            np.array(deflections),
            {name: np.array(force) for name, force in forces.items()},
            {name: np.array(journal) for name, journal in journals.items()},
        )

    computed = list(zip(speeds.tolist(), linears, strict=True))
    exact = vibration(computed)
    interpolated = vibration(_finer(computed))
    curves = larger_axes(interpolated.deflections).T
    resonances = tuple(
        resonance
        for name, curve in zip(points, curves, strict=True)
        for resonance in _resonances(name, interpolated.speeds, curve, prominence)
    )
    return UnbalanceResponse(
        tuple(unbalances),
        exact.speeds,
        points,
        exact.deflections,
        exact.forces,
        resonances,
        interpolated,
        excited,
    )


def _excited(pairs: Sequence[tuple[Unbalance, np.ndarray]], speed: float) -> bool:
    """True if the sum of the forces of unbalances is not zero up to round-off, see `CANCELLED`.

    `pairs` are the unbalances with the derivatives of their points, and `speed` is any speed.
    """
    loads = [unbalance_force(unbalance, along, speed) for unbalance, along in pairs]
    sizes = sum(float(np.abs(load).max()) for load in loads)
    return bool(np.abs(np.sum(loads, axis=0)).max() > CANCELLED * sizes)


def _finer(computed: Sequence[tuple[float, Linearisation]]) -> list[tuple[float, Linearisation]]:
    """Speeds and small motions, with interpolated ones between every two neighbours."""
    finer = []
    for (speed, linear), (following, next_linear) in pairwise(computed):
        finer.append((speed, linear))
        for share in np.arange(1, FINER) / FINER:
            between = (1 - share) * speed + share * following
            mean = Linearisation.combined((linear, next_linear), (float(1 - share), float(share)))
            finer.append((float(between), mean))
    return [*finer, computed[-1]]


def _resonances(
    point: str, speeds: np.ndarray, amplitudes: np.ndarray, prominence: float
) -> list[Resonance]:
    """Resonances of a point with their amplification factors, see `unbalance_response`."""
    resonances = []
    for i in range(1, len(speeds) - 1):
        before, here, after = amplitudes[i - 1 : i + 2]
        if not (here > before and here >= after):
            continue
        # Vertex of the parabola through three points at equal distances.
        offset = 0.5 * (before - after) / (before - 2 * here + after)
        peak = here - 0.25 * (before - after) * offset
        if not peak >= (1.0 + prominence) * _saddle(amplitudes, i):
            continue
        step = speeds[i + 1] - speeds[i] if offset > 0 else speeds[i] - speeds[i - 1]
        speed = float(speeds[i] + offset * step)
        below = _falls_below(speeds, amplitudes, i, -1, peak / BANDWIDTH)
        above = _falls_below(speeds, amplitudes, i, 1, peak / BANDWIDTH)
        factor = None
        if below is not None and above is not None:
            factor = abs(speed / (above - below))
        resonances.append(Resonance(point, speed, float(peak), factor))
    return resonances


def _saddle(amplitudes: np.ndarray, i: int) -> float:
    """Higher one of the two smallest amplitudes between maximum i and higher amplitudes.

    On a side without higher amplitudes, the smallest amplitude of this side counts.
    """
    smallest = []
    for side in (amplitudes[:i][::-1], amplitudes[i + 1 :]):
        higher = np.flatnonzero(side > amplitudes[i])
        smallest.append(float(side[: higher[0] if len(higher) else len(side)].min()))
    return max(smallest)


def _falls_below(
    speeds: np.ndarray, amplitudes: np.ndarray, start: int, side: int, level: float
) -> float | None:
    """Speed on one side of a maximum at which the amplitude has decreased to `level`.

    `start` is the index of the maximum, and `side` is -1 or 1. The result is None if there is no
    such speed before the next higher maximum.
    """
    i = start
    while 0 <= i + side < len(speeds) and amplitudes[i + side] <= amplitudes[start] * BANDWIDTH:
        j = i + side
        if amplitudes[j] <= level:
            share = (amplitudes[i] - level) / (amplitudes[i] - amplitudes[j])
            return float(speeds[i] + share * (speeds[j] - speeds[i]))
        i = j
    return None
