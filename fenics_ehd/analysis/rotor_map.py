"""Rotor maps: modes, critical speeds, stability limit and unbalance response over the speed.

At every speed the equilibrium is computed, starting from that at the nearest known speed, and small
motions about it are linearised (`fenics_ehd.analysis.equilibrium`). Modes are followed over the
speed (`fenics_ehd.analysis.modes`). Further speeds are added

- between two speeds, if a mode with little damping changes so much that the overlap is below 0.9;
- at critical speeds, ``nu(Omega) = |Omega|`` of a followed mode with a damping ratio below 0.4;
- at the limits of stability, where the largest real part of all roots is zero.

The whirl ratio is ``nu / |Omega|`` at a limit of stability; oil whirl has a ratio near 1/2.

The matrices M, D and K may be means over several film meshes of one machine, because the
coefficients of a film jump by about 1 % when its edge moves past a row of nodes. The equilibrium
and the results of the films are those of the first mesh.

Imports inside functions: `scipy.optimize` is slow to import, and figures need matplotlib.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from fenics_ehd.analysis.equilibrium import (
    Equilibrium,
    Linearisation,
    SearchStart,
    equilibrium,
    linearise,
)
from fenics_ehd.analysis.film_meshes import in_basis, mean_linearisation
from fenics_ehd.analysis.modes import (
    Modes,
    Stations,
    damping_ratio,
    damping_ratio_scatter,
    followed,
    matched,
    modes_of,
    point_rows,
    root_scatter,
    stations_of,
    whirl_direction,
    whirl_name,
)
from fenics_ehd.analysis.rotor_notices import (
    response_notices,
    turbulent_films,
    unloaded_films,
)
from fenics_ehd.analysis.unbalance import (
    PROMINENCE,
    PROMINENCE_ON_ONE_MESH,
    UnbalanceResponse,
    unbalance_response,
)
from fenics_ehd.base.arguments import require_count, require_number
from fenics_ehd.base.described import Described, Named
from fenics_ehd.base.errors import SettingsError, SolverError
from fenics_ehd.base.printed import scatter_text
from fenics_ehd.base.progress import SILENT, Progress, Stage
from fenics_ehd.base.units import RPM
from fenics_ehd.multibody.forces import Unbalance
from fenics_ehd.multibody.mechanism import Mechanism, System
from fenics_ehd.multibody.quantities import JointStep, joint_row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Overlap of a mode with its successor below which a speed is added between the two.
CLOSE = 0.9

#: Damping ratio above which a low overlap adds no speed: near it, pairs of roots become real.
OVERDAMPED = 0.7

#: Number of times that the interval between two speeds is halved at most.
HALVINGS = 3

#: Largest number of speeds by way of which a speed is approached where the search had failed.
APPROACHES = 2

#: Damping ratio above which a crossing of the 1x line is no critical speed.
CRITICAL_DAMPING = 0.4

#: Accuracy of critical speeds and limits of stability, relative to the speed. The limit changes by
#: more than that with the film mesh.
ACCURACY = 1e-4


class MakeMechanism(Protocol):
    """Function that makes the mechanism of a rotor at a given speed [rad/s]."""

    def __call__(self, speed: float, /) -> Mechanism:
        """Make the mechanism of the rotor at a speed [rad/s]."""


@dataclass(frozen=True, eq=False)
class MapPoint(Described):
    """A rotor at one speed.

    Attributes
    ----------
    speed
        Speed Omega [rad/s].
    linear
        Small motions about the equilibrium, with matrices that are means over the film meshes; the
        coordinates q are the same at all speeds of a map.
    figures
        Results of the films in equilibrium, by column, ``left.max_pressure_Pa``.
    growth
        Largest real part of the roots with each single film mesh, shape (meshes,) [1/s].
    scatter
        Scatter of the roots over the film meshes in the order of `modes`, see
        `fenics_ehd.analysis.modes.root_scatter`, shape (r,) [1/s].
    starts
        States from which the search for an equilibrium at another speed can start, one for every
        film mesh.
    """

    speed: float
    linear: Linearisation
    figures: Mapping[str, float]
    growth: np.ndarray
    scatter: np.ndarray
    starts: tuple[SearchStart, ...]

    @cached_property
    def modes(self) -> Modes:
        """Modes of the small motions about the equilibrium."""
        return modes_of(self.linear)

    @property
    def least_stable(self) -> int:
        """Index of the mode whose root has the largest real part.

        Only roots with an imaginary part of at least 0 are considered.
        """
        roots = self.modes.roots
        return int(np.argmax(np.where(roots.imag >= 0.0, roots.real, -np.inf)))

    @property
    def largest_real_part(self) -> float:
        """Largest real part of all roots, positive if the rotor is unstable [1/s]."""
        return float(self.modes.roots[self.least_stable].real)


class CriticalSpeed(NamedTuple):
    """Speed at which a mode vibrates once per revolution.

    Attributes
    ----------
    speed
        Speed [rad/s].
    mode
        Number of the mode in the map.
    damping_ratio, direction
        Damping ratio and whirl direction kappa of the mode at this speed.
    scatter
        Half the range of the speed over the film meshes [rad/s]; 0 with one mesh.
    damping_ratio_scatter
        Scatter of the damping ratio at this speed over the film meshes [-], see
        `fenics_ehd.analysis.modes.damping_ratio_scatter`; 0 with one mesh.
    """

    speed: float
    mode: int
    damping_ratio: float
    direction: float
    scatter: float = 0.0
    damping_ratio_scatter: float = 0.0


class StabilityLimit(NamedTuple):
    """Speed at which the rotor loses or regains stability.

    Attributes
    ----------
    speed
        Speed [rad/s].
    mode
        Number in the map of the mode whose real part changes its sign.
    whirl_ratio
        Angular frequency of this mode over the speed [-].
    direction
        Whirl direction kappa of the mode.
    lost
        Whether the rotor is unstable above the limit; if false, it is unstable below the limit.
    scatter
        Half the range of the limit over the film meshes [rad/s]; 0 with one mesh.
    whirl_ratio_scatter
        Half the range of the whirl ratio over the film meshes [-]; 0 with one mesh.
    """

    speed: float
    mode: int
    whirl_ratio: float
    direction: float
    lost: bool
    scatter: float
    whirl_ratio_scatter: float = 0.0


@dataclass(frozen=True, eq=False)
class RotorMap(Described):
    """Modes of a rotor over its speed, critical speeds, limits of stability, unbalance response.

    A track is a mode that is followed over the speed. Of a conjugate pair of roots, only the root
    with the positive imaginary part has a track.

    Attributes
    ----------
    points
        The rotor at s speeds, in ascending order of the absolute values of the speeds.
    stations
        Points of the rotor at which `shape` returns deflections.
    tracks
        Index of each track's mode among the modes at each speed, -1 if the track has no mode
        there, shape (tracks, s).
    overlaps
        Overlap of each track's modes at each speed and at the speed before, shape (tracks, s).
    critical_speeds
        Critical speeds in ascending order.
    limits
        Limits of stability in ascending order.
    response
        Response to unbalances; None without unbalances.
    failures
        Reasons why no equilibrium was found, by speed [rad/s].
    notices
        Notices of forces that are not included, of films without load, of films beyond the limit of
        laminar flow, and of journals with large orbits.
    """

    points: tuple[MapPoint, ...]
    stations: Stations
    tracks: np.ndarray
    overlaps: np.ndarray
    critical_speeds: tuple[CriticalSpeed, ...] = ()
    limits: tuple[StabilityLimit, ...] = ()
    response: UnbalanceResponse | None = None
    failures: Mapping[float, str] = field(default_factory=dict)
    notices: tuple[str, ...] = ()

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield speeds, stability limits and critical speeds with their scatter, and notices."""
        low = abs(self.points[0].speed)
        high = abs(self.points[-1].speed)
        span = f"{low:.5g} to {high:.5g} rad/s ({RPM * low:.0f} to {RPM * high:.0f} 1/min)"
        yield "RotorMap", f"{len(self.points)} speeds, {span}, {len(self.tracks)} modes"
        if self.failures:
            yield "failed", f"{len(self.failures)} speeds without equilibrium: see failures"
        if not self.limits:
            stable = "stable" if self.stable_at_first_speed else "unstable"
            yield "stability", f"{stable} at all these speeds"
        for limit in self.limits:
            yield (
                "stability",
                f"{'lost' if limit.lost else 'regained'} at {_speed_text(limit)}, "
                f"mode {limit.mode + 1}, whirl ratio {limit.whirl_ratio:.4g}"
                f"{scatter_text(limit.whirl_ratio_scatter or None, sign='±')}",
            )
        for critical in self.critical_speeds:
            yield (
                "critical speed",
                f"{_speed_text(critical)}, mode {critical.mode + 1}, damping ratio "
                f"{critical.damping_ratio:.3g}"
                f"{scatter_text(critical.damping_ratio_scatter or None, sign='±')}, "
                f"{whirl_name(critical.direction)}",
            )
        for peak in () if self.response is None else self.response.resonances:
            yield (
                "resonance",
                f"{peak.point}: {1e6 * peak.amplitude:.4g} um at {abs(peak.speed):.5g} rad/s",
            )
        for line in self.notices:
            yield "notice", line

    def plot(self, quantity: str = "campbell", *, speed: float | str | None = None) -> Figure:
        """Draw a diagram of the map, as ``fenics-ehd rotor`` does.

        Parameters
        ----------
        quantity
            ``"campbell"``, ``"decrement"``, ``"mode_shapes"``, or ``"unbalance"`` for the response
            to unbalances.
        speed
            Speed whose mode shapes are drawn [rad/s], or a text with a unit; the nearest of the
            map is used. By default that of the first stability limit, or in the middle of the map.
        """
        from fenics_ehd import plot

        return plot(self, quantity, speed=speed)

    @property
    def speeds(self) -> np.ndarray:
        """Speeds Omega, shape (s,) [rad/s]."""
        return np.array([point.speed for point in self.points])

    @cached_property
    def roots(self) -> np.ndarray:
        """Roots of all tracks at all speeds, shape (tracks, s) [1/s]; NaN without a mode."""
        roots = np.full(self.tracks.shape, complex(np.nan, np.nan))
        for n, point in enumerate(self.points):
            present = self.tracks[:, n] >= 0
            roots[present, n] = point.modes.roots[self.tracks[present, n]]
        return roots

    @cached_property
    def scatter(self) -> np.ndarray:
        """Scatter of the `roots` over the film meshes, shape (tracks, s) [1/s].

        Real and imaginary parts are those of real part and frequency; NaN without a mode.
        """
        scatter = np.full(self.tracks.shape, complex(np.nan, np.nan))
        for n, point in enumerate(self.points):
            present = self.tracks[:, n] >= 0
            scatter[present, n] = point.scatter[self.tracks[present, n]]
        return scatter

    @property
    def stable_below(self) -> float | None:
        """Lowest speed at which the rotor loses stability [rad/s]; None if it never does.

        It is also None if the rotor is unstable at all speeds, see `stable_at_first_speed`.
        """
        return next((limit.speed for limit in self.limits if limit.lost), None)

    @property
    def stable_at_first_speed(self) -> bool:
        """Whether the rotor is stable at the first speed of the map."""
        return self.points[0].largest_real_part <= 0.0

    def stable_at(self, speed: float) -> bool:
        """True if the rotor is stable at a speed [rad/s] by the limits of stability below it."""
        require_number("speed", speed)
        below = [limit for limit in self.limits if abs(limit.speed) <= abs(speed)]
        return not below[-1].lost if below else self.stable_at_first_speed

    def shape(self, n: int, track: int) -> np.ndarray:
        """Complex deflections (u, v) of the p stations in a track's mode, shape (p, 2).

        `n` is the index of the speed. The largest deflection is 1.

        Raises
        ------
        SettingsError
            If there is no speed or track with this index, or the track has no mode at the speed.
        """
        require_count("n", n, most=len(self.points) - 1)
        require_count("track", track, most=len(self.tracks) - 1)
        if self.tracks[track, n] < 0:
            raise SettingsError(f"track = {track} has no mode at {self.points[n].speed:.5g} rad/s")
        point = self.points[n]
        motion = point.modes.shapes[:, self.tracks[track, n]]
        return scaled_shape(self.stations.deflections(point.linear, motion))

    def direction(self, n: int, track: int) -> float:
        """Whirl direction kappa of a track's mode, see `fenics_ehd.analysis.modes`.

        `n` is the index of the speed.
        """
        shape = self.shape(n, track)
        return whirl_direction(shape, self.points[n].speed)


def _speed_text(result: CriticalSpeed | StabilityLimit) -> str:
    """Text of the speed of a critical speed or limit, with its scatter if it is not 0."""
    bound = scatter_text(result.scatter or None, sign="±")
    return f"{abs(result.speed):.5g}{bound} rad/s ({RPM * abs(result.speed):.0f} 1/min)"


def scaled_shape(deflections: np.ndarray) -> np.ndarray:
    """Complex deflections (u, v), divided by their component of largest magnitude, shape (p, 2)."""
    largest = deflections.ravel()[np.argmax(np.abs(deflections))] if deflections.size else 0.0
    return deflections / largest if largest else deflections


class MapSolver:
    """Solver of the equilibria and small motions of one rotor at any speed.

    Parameters
    ----------
    makers
        Functions that make the mechanism at a speed, one for every film mesh.
    stored
        Known points by speed [rad/s], for example those of an interrupted map; new points are
        added.
    progress
        Progress in which every new point is a stage.
    between
        Function that is called before every new point; it may raise an error, which ends the map.
    """

    def __init__(
        self,
        makers: Sequence[MakeMechanism],
        stored: MutableMapping[float, MapPoint],
        progress: Progress = SILENT,
        between: Callable[[], None] = lambda: None,
    ):
        self._makers = makers
        self.points = stored
        self._progress = progress
        self._between = between

    def at(self, speed: float) -> MapPoint:
        """Point of the map at a speed [rad/s]: a known point, or a new point that is computed.

        Raises
        ------
        SettingsError, SolverError
            The rotor has no equilibrium, no equilibrium was found, or it cannot be linearised.
        """
        if speed in self.points:
            return self.points[speed]
        nearest = min(self.points, key=lambda other: abs(other - speed), default=None)
        former = None if nearest is None else self.points[nearest]
        self._between()
        linears: list[Linearisation] = []
        starts: list[SearchStart] = []
        figures: dict[str, float] = {}
        count = len(self._makers)
        with self._progress.stage(f"{speed:.5g} rad/s", count, "film meshes") as stage:
            for n, make in enumerate(self._makers):
                rest = self._rest(make(speed), None if former is None else former.starts[n])
                linears.append(linearise(rest))
                starts.append(rest.search_start)
                figures = figures or figures_of(rest)
                stage.add()
        growth = np.array([modes_of(linear).roots[0].real for linear in linears])
        mean = mean_linearisation(linears)
        if self.points:
            mean = in_basis(mean, next(iter(self.points.values())).linear.basis)
        parts = [in_basis(linear, mean.basis) for linear in linears]
        scatter = root_scatter(modes_of(mean), mean, parts)
        point = MapPoint(speed, mean, Named(figures, "figures"), growth, scatter, tuple(starts))
        self.points[speed] = point
        return point

    @staticmethod
    def _rest(mechanism: Mechanism, start: SearchStart | None) -> Equilibrium:
        """Equilibrium of a mechanism, searched from `start` and, if that fails, from the pose."""
        try:
            return equilibrium(mechanism, start=start)
        except SolverError:
            if start is None:
                raise
        return equilibrium(mechanism)


def figures_of(rest: Equilibrium) -> dict[str, float]:
    """Results of all films in equilibrium, by column, ``JOINT.max_pressure_Pa``."""
    figures: dict[str, float] = {}
    for name, joint in rest.joints().items():
        row = joint_row(joint) | {"reynolds_number": reynolds_number(joint)}
        if name in rest.temperatures:
            row["effective_temperature_C"] = rest.temperatures[name]
        figures |= {f"{name}.{column}": float(value) for column, value in row.items()}
    return figures


def reynolds_number(joint: JointStep) -> float:
    """Reynolds number of a film, ``rho |Omega_1 - Omega_2| R c / eta`` [-].

    Omega_1 and Omega_2 are the angular speeds of journal and bore.
    """
    lubricant = joint.film.equation.lubricant
    parameters = joint.film.parameters
    journal, bore = joint.speeds
    speed = abs(journal - bore)
    length = parameters.grid.radius * parameters.clearance
    return float(lubricant.density * speed * length / lubricant.viscosity)


def rotor_map_of(
    makers: Sequence[MakeMechanism],
    speeds: Sequence[float],
    *,
    unbalances: Sequence[Unbalance] = (),
    stored: MutableMapping[float, MapPoint] | None = None,
    progress: Progress = SILENT,
    between: Callable[[], None] = lambda: None,
) -> RotorMap:
    """Compute a rotor map.

    Parameters
    ----------
    makers
        Functions that make the mechanism at a speed, one for every film mesh.
    speeds
        Speeds of one sign, none of them 0 [rad/s].
    unbalances
        Unbalances whose response is computed; they must be at points of the rotor.
    stored
        Known points by speed, for example of an interrupted map; new points are added.
    progress
        Progress in which the requested speeds, and those that are added, are stages.
    between
        Function that is called between two speeds; it may raise an error, which ends the map.

    Raises
    ------
    SettingsError
        The rotor cannot be in equilibrium, see `fenics_ehd.analysis.equilibrium`.
    SolverError
        No equilibrium was found at any speed.
    """
    solver = MapSolver(makers, {} if stored is None else stored, progress, between)
    with progress.stage("rotor map", len(speeds), "speeds") as stage:
        chosen, failures = _requested(solver, speeds, stage)
    if not chosen:
        speed, reason = next(iter(failures.items()))
        raise SolverError(f"no equilibrium at any speed; at {speed:.6g} rad/s: {reason}")
    with progress.stage("speeds between"):
        _follow_closely(solver, chosen)
    with progress.stage("stability limits and critical speeds"):
        limits = _limits(solver, chosen)
        critical = _critical_speeds(solver, chosen)
    points = _ordered(chosen)
    system = System(makers[0](points[0].speed))
    stations = stations_of(system, points[0].starts[0].x[: system.n])
    tracks, overlaps = _listed(points)
    bare = RotorMap(points, stations, tracks, overlaps, failures=failures)
    response = _response(bare, system, unbalances) if unbalances else None
    figures = {point.speed: point.figures for point in points}
    return replace(
        bare,
        critical_speeds=tuple(
            sorted(
                (_critical_speed(bare, *pair) for pair in critical),
                key=lambda each: abs(each.speed),
            )
        ),
        limits=tuple(_limit(bare, point) for point in limits),
        response=response,
        notices=(
            *unloaded_films(system, figures),
            *turbulent_films(system, figures),
            *(() if response is None else response_notices(system, response)),
        ),
    )


def _requested(
    solver: MapSolver, speeds: Sequence[float], stage: Stage
) -> tuple[dict[float, MapPoint], dict[float, str]]:
    """Points at requested speeds, and reasons why speeds have no equilibrium, both by speed."""
    failures: dict[float, str] = {}
    chosen: dict[float, MapPoint] = {}
    for speed in sorted(speeds, key=abs):
        try:
            chosen[speed] = solver.at(speed)
        except SolverError as error:
            failures[speed] = str(error)
        stage.add()
    # The pose may be too far from the equilibrium at a low speed, but that at a higher speed near.
    for speed in sorted(failures, key=abs, reverse=True) if chosen else ():
        with suppress(SolverError):
            chosen[speed] = _approached(solver, speed)
            del failures[speed]
    return chosen, failures


def _approached(solver: MapSolver, speed: float, attempts: int = APPROACHES) -> MapPoint:
    """Point at a speed [rad/s], if necessary by way of speeds between it and the nearest point.

    Raises
    ------
    SolverError
        No equilibrium was found; `attempts` is the largest number of speeds between.
    """
    try:
        return solver.at(speed)
    except SolverError:
        if not attempts:
            raise
    nearest = min(solver.points, key=lambda other: abs(other - speed))
    _approached(solver, float(np.copysign(np.sqrt(nearest * speed), speed)), attempts - 1)
    return solver.at(speed)


def _ordered(chosen: Mapping[float, MapPoint]) -> tuple[MapPoint, ...]:
    """Points of a map, sorted by the absolute values of their speeds."""
    return tuple(sorted(chosen.values(), key=lambda point: abs(point.speed)))


def _listed(points: Sequence[MapPoint]) -> tuple[np.ndarray, np.ndarray]:
    """Tracks and overlaps of a map, see `RotorMap`, sorted by frequency.

    Tracks that are overdamped at all speeds are last.
    """
    tracks, overlaps = followed([point.modes for point in points])
    for n, point in enumerate(points):
        below = point.modes.roots[tracks[:, n]].imag < 0.0
        tracks[below, n] = -1
    kept = [row for row in range(len(tracks)) if (tracks[row] >= 0).any()]

    def rank(row: int) -> tuple[bool, float, float]:
        present = np.flatnonzero(tracks[row] >= 0)
        roots = [points[n].modes.roots[tracks[row, n]] for n in present]
        overdamped = all(damping_ratio(root) > OVERDAMPED for root in roots)
        return overdamped, float(roots[0].imag), float(abs(roots[0]))

    kept.sort(key=rank)
    return tracks[kept], np.where(tracks[kept] >= 0, overlaps[kept], 0.0)


# Speeds that are added


def _follow_closely(solver: MapSolver, chosen: dict[float, MapPoint]) -> None:
    """Add points between two speeds if modes change too much between these speeds.

    New points are added to `chosen`, the points of the map by speed.
    """
    for _ in range(HALVINGS):
        added = False
        for first, second in pairwise(_ordered(chosen)):
            if _alike(first.modes, second.modes):
                continue
            middle = 0.5 * (first.speed + second.speed)
            with suppress(SolverError):
                chosen[middle] = solver.at(middle)
                added = True
        if not added:
            return


def _alike(former: Modes, modes: Modes) -> bool:
    """True if the modes with little damping change little between two neighbouring speeds."""
    partners, overlaps = matched(former, modes)
    for i, (partner, overlap) in enumerate(zip(partners, overlaps, strict=True)):
        roots = former.roots[i], modes.roots[partner]
        oscillates = all(root.imag > 0.0 and damping_ratio(root) < OVERDAMPED for root in roots)
        if oscillates and overlap < CLOSE:
            return False
    return True


def _zero(function: Callable[[float], float], first: float, last: float) -> float:
    """Speed between `first` and `last` at which a function of the speed is zero [rad/s].

    The relative error of the speed is at most `ACCURACY`.
    """
    from scipy.optimize import brentq

    return float(brentq(function, first, last, xtol=ACCURACY * abs(first), rtol=ACCURACY))


def _limits(solver: MapSolver, chosen: dict[float, MapPoint]) -> list[MapPoint]:
    """Points at the limits of stability, where the largest real part of all roots is zero.

    The points are also added to `chosen`, the points of the map by speed.
    """
    limits = []
    for first, second in pairwise(_ordered(chosen)):
        if (first.largest_real_part > 0.0) == (second.largest_real_part > 0.0):
            continue
        with suppress(SolverError):
            speed = _zero(lambda s: solver.at(s).largest_real_part, first.speed, second.speed)
            chosen[speed] = solver.at(speed)
            limits.append(chosen[speed])
    return limits


def _critical_speeds(
    solver: MapSolver, chosen: dict[float, MapPoint]
) -> list[tuple[MapPoint, int]]:
    """Points at which a mode vibrates once per revolution, each with the index of the mode.

    The points are also added to `chosen`, the points of the map by speed.
    """
    critical = []
    for first, second in pairwise(_ordered(chosen)):
        partners, _ = matched(first.modes, second.modes)
        for mode, partner in enumerate(partners):
            roots = first.modes.roots[mode], second.modes.roots[partner]
            before = roots[0].imag - abs(first.speed)
            after = roots[1].imag - abs(second.speed)
            if not all(root.imag > 0.0 for root in roots) or before * after > 0.0:
                continue
            off = partial(_off_the_line, solver, first, mode)
            with suppress(SolverError):
                speed = _zero(off, first.speed, second.speed)
                point = solver.at(speed)
                index = _partner(first, mode, point)
                if damping_ratio(point.modes.roots[index]) < CRITICAL_DAMPING:
                    chosen[speed] = point
                    critical.append((point, index))
    return critical


def _partner(first: MapPoint, mode: int, point: MapPoint) -> int:
    """Index of the mode at `point` that continues mode `mode` of the neighbouring point `first`."""
    return int(matched(first.modes, point.modes)[0][mode])


def _off_the_line(solver: MapSolver, first: MapPoint, mode: int, speed: float) -> float:
    """Angular frequency of a mode at a speed, minus the speed [rad/s].

    The mode is the one that continues the mode `mode` of the point `first`.
    """
    point = solver.at(speed)
    return float(point.modes.roots[_partner(first, mode, point)].imag - abs(speed))


# Results of a map


def _track_of(bare: RotorMap, point: MapPoint, mode: int) -> tuple[int, int]:
    """Index of a point in a map, and index of the track to which one of its modes belongs."""
    n = bare.points.index(point)
    return n, int(np.flatnonzero(bare.tracks[:, n] == mode)[0])


def _critical_speed(bare: RotorMap, point: MapPoint, mode: int) -> CriticalSpeed:
    """Critical speed of the mode with the index `mode` at a point of the map."""
    n, track = _track_of(bare, point, mode)
    root = complex(point.modes.roots[mode])
    of_root = complex(point.scatter[mode])
    frequencies = bare.roots[track].imag
    present = [i for i in (n - 1, n, n + 1) if 0 <= i < len(frequencies)]
    present = [i for i in present if np.isfinite(frequencies[i])]
    # The curve of the frequency meets the 1x line at an angle that depends on its slope.
    slope = 0.0
    if len(present) > 1:
        speeds = np.abs(bare.speeds[present])
        rise = frequencies[present[-1]] - frequencies[present[0]]
        slope = float(rise / (speeds[-1] - speeds[0]))
    return CriticalSpeed(
        point.speed,
        track,
        damping_ratio(root),
        bare.direction(n, track),
        of_root.imag / max(abs(1.0 - slope), float(np.finfo(float).tiny)),
        damping_ratio_scatter(root, of_root),
    )


def _limit(bare: RotorMap, point: MapPoint) -> StabilityLimit:
    mode = point.least_stable
    n, track = _track_of(bare, point, mode)
    before = bare.points[max(n - 1, 0)]
    after = bare.points[min(n + 1, len(bare.points) - 1)]
    rise = after.largest_real_part - before.largest_real_part
    per_speed = rise / (abs(after.speed) - abs(before.speed))
    return StabilityLimit(
        point.speed,
        track,
        float(point.modes.roots[mode].imag / abs(point.speed)),
        bare.direction(n, track),
        rise > 0.0,
        float(0.5 * np.ptp(point.growth) / abs(per_speed)),
        float(point.scatter[mode].imag / abs(point.speed)),
    )


def _response(bare: RotorMap, system: System, unbalances: Sequence[Unbalance]) -> UnbalanceResponse:
    """Response of the rotor of a map to unbalances, at all stations except nodes of beams."""
    z = bare.points[0].starts[0].x[: system.n]
    rows = [point_rows(system, z, unbalance.point) for unbalance in unbalances]
    named = [i for i, name in enumerate(bare.stations.names) if not name.endswith("]")]
    return unbalance_response(
        unbalances,
        rows,
        tuple(bare.stations.names[i] for i in named),
        bare.stations.rows[named],
        [point.linear for point in bare.points],
        bare.speeds,
        {film.name: np.eye(system.n)[film.xi[:2]] for film in system.films},
        prominence=PROMINENCE if len(bare.points[0].growth) > 1 else PROMINENCE_ON_ONE_MESH,
    )
