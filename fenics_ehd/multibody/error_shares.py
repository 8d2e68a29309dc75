"""Errors of a run: of its basis, estimated as long as it runs, and shares of its error budget.

Error of the gap by the bore flexibility that a basis misses, or by the inertia of M4's, estimated
along the run; and what the components of an error budget (`fenics_ehd.analysis.error_budget`) say
of whether the run may be trusted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from fenics_ehd.base.sealed_file import Stateful
from fenics_ehd.multibody.body import FlexibleBody
from fenics_ehd.multibody.mechanism import FilmPlace, System
from fenics_ehd.reduction.body import ReducedBody

#: Times of the slowest pattern after which 2e-9 of the ringing of a start are left.
RINGS = 20.0


class BasisErrorEstimate(Stateful):
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
        Outward bore displacement per nodal pressure [m/Pa], and per other load if there are any,
        shape (m, k).
    damping_time
        zeta [s].
    neglected_inertia
        Outward bore displacement per acceleration of the residual amplitudes, shape (m, r); no
        rows if no inertia is neglected.
    inertia_time
        Of the slowest of the patterns [s], see `slowest_pattern`.

    Attributes
    ----------
    loads
        Number k of pressures and other loads.
    start
        Time that a start takes [s].
    known
        Whether there is a flexibility to tell by.
    filtered, accelerated
        Pressures and accelerations behind their lags.
    """

    carried = ("filtered", "accelerated")

    def __init__(
        self,
        missing_flexibility: np.ndarray,
        damping_time: float,
        neglected_inertia: np.ndarray | None = None,
        inertia_time: float = 0.0,
    ):
        self._missing, self.loads = missing_flexibility, missing_flexibility.shape[1]
        self._damping_time = damping_time
        self._inertia = np.zeros((0, 0)) if neglected_inertia is None else neglected_inertia
        self._inertia_time = damping_time + inertia_time
        self.start, self.known = RINGS * inertia_time, bool(missing_flexibility.size)
        self.filtered = np.zeros(self.loads)
        self.accelerated = np.zeros(self._inertia.shape[1])

    def add(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> float:
        """Largest gap error over the bore after one step of this length [s], in [m]."""
        if not self.known:
            return float("nan")
        return float(np.abs(self.field(step, pressure, acceleration)).max())

    def field(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> np.ndarray:
        """Gap error at the bore's nodes after one step of this length [s], shape (m,) [m]."""
        # Backward Euler on the first-order lags.
        share = step / (step + self._damping_time)
        self.filtered = self.filtered + share * (pressure - self.filtered)
        field = self._missing @ self.filtered
        if len(self._inertia) and acceleration is not None:
            share = step / (step + self._inertia_time)
            self.accelerated = self.accelerated + share * (acceleration - self.accelerated)
            field = field + self._inertia @ self.accelerated
        return field


def estimate_at(body: FlexibleBody, bore: str) -> BasisErrorEstimate:
    """Estimate at one of a body's bores, for pressures on all of them."""
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


#: Components of an error, and the settings that make them smaller.
KEYS = {
    "basis": "reduction",
    "film_mesh": "cells",
    "part_mesh": "geometry",
    "step_size": "time.tolerance",
    "start": "time.periodicity",
}
COMPONENTS = tuple(KEYS)

#: Quantities by their names in a summary.
QUANTITIES = ("max_pressure", "min_film_thickness")

#: Said of what cannot be estimated, and of what a run or joint does not have.
NOT_ESTIMATED, NOT_APPLICABLE = "not estimated", "not applicable"


def stated(worth: Mapping[str, Any], component: str) -> float | None:
    """The largest error over the cycle by one component of all joints; None: one is not known."""
    errors = [
        own["largest_over_cycle"][quantity][component]
        for own in worth.values()
        for quantity in QUANTITIES
    ]
    if not errors or NOT_ESTIMATED in errors:
        return None
    return max((error for error in errors if not isinstance(error, str)), default=0.0)


def above(worth: Mapping[str, Any], limit: float) -> str:
    """Why figures cannot be trusted of which one is off by more than a limit; usually nothing."""
    errors = {
        (joint, quantity): own[quantity]["known"]
        for joint, own in worth.items()
        for quantity in QUANTITIES
        if not isinstance(own[quantity]["known"], str)
    }
    if not errors or max(errors.values()) <= limit:
        return ""
    joint, quantity = max(errors, key=errors.__getitem__)
    own = worth[joint][quantity]
    worst = max((key for key in COMPONENTS if not isinstance(own[key], str)), key=own.__getitem__)
    return (
        f"untrustworthy: {quantity} of joints.{joint} is off by {100 * own['known']:.3g} %, above "
        f"output.error_limit = {100 * limit:g} %, most of it by the {worst.replace('_', ' ')}: "
        f"see {KEYS[worst]}"
    )
