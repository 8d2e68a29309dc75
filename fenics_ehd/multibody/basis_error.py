"""Error of the gap by the bore flexibility that a basis misses, or by the inertia of M4's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from fenics_ehd.multibody.flexible_body import FlexibleBody
from fenics_ehd.multibody.system import FilmPlace, System
from fenics_ehd.reduction.body import ReducedBody

#: Times of the slowest pattern after which 2e-9 of the ringing of a start are left.
RINGS = 20.0


class BasisErrorEstimate:
    """``(S_full - S_basis) w`` along a run, with ``w + zeta dw/dt = P``.

    The quasi-static answer of the missing flexibility to the pressure of the
    run, damped as the structure is. An estimate within a factor of two or so,
    not a bound. It says nothing of M4, which misses no flexibility but the
    inertia of most of it: the answer to that is added,

        S_res M y'',   late by zeta and by the time that the patterns' own inertia takes.

    Patterns that carry no mass begin to move at once when a run begins, with accelerations that
    are over within microseconds: too soon for what they leave out to have moved the bore. Where
    they are hardly damped it rings all the same, and says nothing of what comes later: what counts
    begins when that is over, after `start`.

    Parameters
    ----------
    missing_flexibility
        Outward bore displacement per nodal pressure, shape (m, k) [m/Pa].
    damping_time
        zeta [s].
    neglected_inertia
        Outward bore displacement per acceleration of the residual amplitudes, shape (m, r); no
        rows if no inertia is neglected.
    inertia_time
        Of the slowest of the patterns [s], see `slowest_pattern`.

    Attributes
    ----------
    start
        Time that a start takes [s].
    largest
        Error after that [m].
    """

    def __init__(
        self,
        missing_flexibility: np.ndarray,
        damping_time: float,
        neglected_inertia: np.ndarray | None = None,
        inertia_time: float = 0.0,
    ):
        self._missing = missing_flexibility
        self._damping_time = damping_time
        self._inertia = np.zeros((0, 0)) if neglected_inertia is None else neglected_inertia
        self._inertia_time = damping_time + inertia_time
        self.start, self._elapsed = RINGS * inertia_time, 0.0
        self._filtered = np.zeros(missing_flexibility.shape[1])
        self._accelerated = np.zeros(self._inertia.shape[1])
        self.largest = 0.0 if missing_flexibility.size else float("nan")

    def add(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> float:
        """Largest gap error over the bore after one step of this length [s], in [m]."""
        if not self._missing.size:
            return float("nan")
        error = float(np.abs(self.field(step, pressure, acceleration)).max())
        self._elapsed += step
        if self._elapsed > self.start:
            self.largest = max(self.largest, error)
        return error

    def field(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> np.ndarray:
        """Gap error at the bore's nodes after one step of this length [s], shape (m,) [m]."""
        # Backward Euler on the first-order lags.
        share = step / (step + self._damping_time)
        self._filtered += share * (pressure - self._filtered)
        field = self._missing @ self._filtered
        if len(self._inertia) and acceleration is not None:
            share = step / (step + self._inertia_time)
            self._accelerated += share * (acceleration - self._accelerated)
            field = field + self._inertia @ self._accelerated
        return field

    def stored_state(self) -> dict[str, np.ndarray]:
        """All that the estimate knows, as arrays, for `load_state`."""
        return {
            "filtered": self._filtered,
            "accelerated": self._accelerated,
            "largest": np.array(self.largest),
            "elapsed": np.array(self._elapsed),
        }

    def load_state(self, stored: Mapping[str, np.ndarray]) -> None:
        """Go on where another estimate of the same body was."""
        self._filtered = np.array(stored["filtered"])
        self._accelerated = np.array(stored["accelerated"])
        self.largest, self._elapsed = float(stored["largest"]), float(stored["elapsed"])


def estimate_at(body: FlexibleBody, bore: str) -> BasisErrorEstimate:
    """Of one of a body's bores, for pressures on all of them."""
    reduced, part = body.reduced, body.reduced.at_bore(bore)
    missing = reduced.missing_flexibility[reduced.rows_of(bore).nodes]
    return BasisErrorEstimate(
        missing, body.damping_time, neglected_inertia(part), slowest_pattern(part)
    )


def bore_body(system: System, place: FilmPlace) -> FlexibleBody:
    """The flexible body that has the bore of a film."""
    body = system.mechanism.bodies[place.bore_body]
    assert isinstance(body, FlexibleBody)
    return body


def bore_loads(system: System, pressures: Iterable[np.ndarray]) -> dict[str, np.ndarray]:
    """Pressures on the pressure nodes of all bores of a body, by its name, of all films' nodes."""
    found: dict[str, np.ndarray] = {}
    for place, pressure in zip(system.films, pressures, strict=True):
        if place.film.bore is not None:
            part = bore_body(system, place).reduced
            load = found.setdefault(place.bore_body, np.zeros(part.load_projection.shape[1]))
            load[part.rows_of(place.bore).pressures] = place.film.bore.structure_pressure(pressure)
    return found


def neglected_inertia(body: ReducedBody) -> np.ndarray:
    """Gap error per acceleration of the residual amplitudes.

    The force ``-M_rr y''`` that a residual pattern's mass would exert, answered by
    its own stiffness.

    Returns
    -------
    numpy.ndarray
        Outward bore displacement, shape (m, r); no rows if the mass is unknown.
    """
    residual = body.residual
    if residual is None or not residual.mass.size:
        return np.zeros((0, 0))
    shape = body.outward(residual.displacement)
    return (shape / residual.stiffness) @ residual.mass


def slowest_pattern(body: ReducedBody) -> float:
    """``1 / omega`` of the slowest residual pattern on its own stiffness and mass [s]."""
    residual = body.residual
    if residual is None or not residual.mass.size:
        return 0.0
    root = 1.0 / np.sqrt(residual.stiffness)
    return float(np.sqrt(np.linalg.norm(root[:, None] * residual.mass * root, 2)))
