"""Accuracy of a run: energy balance, error of the basis, and components of an error budget.

Stored energy changes by the powers of drives and loads, and by losses of films and bodies. The
difference that accumulates over the steps, the energy defect, is an error of the time integration.

Flexibility that is missing in a basis, or inertia that M4 neglects, causes an error of the gap,
which `BasisErrorEstimate` estimates during the run. `fenics_ehd.analysis.error_budget` estimates
the other components of an error budget, and `fenics_ehd.multibody.verdict` accepts or rejects a
run.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from fenics_ehd.base.layout import Stateful, Value
from fenics_ehd.film.forces import under_pressure
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.surface import MissingFlexibility


def integral(times: np.ndarray, values: np.ndarray, first: int = 0) -> np.ndarray:
    """Integrals of several quantities over time, from one point to the last, shape (names,).

    In each interval the integrand is the cubic through four points. A crank and its rod exchange
    hundreds of times the energy that is lost: with parabolas the error of the integral would be
    ten times the defect of the time integration.

    Parameters
    ----------
    times, values
        Times [s], shape (k,), and values of the quantities, shape (k, names).
    first
        Index of the point at which the integral begins.
    """
    total = np.zeros(values.shape[1])
    for last in range(first + 1, len(times)):
        near = slice(max(0, last - 3), last + 1)
        total += last_interval(times[near]) @ values[near]
    return total


def last_interval(times: np.ndarray) -> np.ndarray:
    """Weights with which values at k times give their integral over the last interval [s].

    The integrand is the polynomial through the values. `times` [s] and weights have the shape (k,).
    """
    step = times[-1] - times[-2]
    powers = np.vander((times - times[-2]) / step, increasing=True)
    return step * np.linalg.solve(powers.T, 1.0 / np.arange(1, len(times) + 1))


#: Sign of every work in the energy balance by name: 1 for works that add energy, -1 for losses.
SIGNS = {"drive": 1, "applied": 1, "drag": 1, "film": -1, "damping": -1}

#: Largest energy balance error of an accepted run, unless its time-stepping error is known and
#: larger. With this defect, extremes of the film in a crank or four-bar have errors of about 5 %.
#: The defect is relative to the energy exchanged, of which the dissipation is a hundredth.
ENERGY_LIMIT = 0.05


def energy_row(
    former: Sequence[Mapping[str, Any]],
    time: float,
    powers: Mapping[str, float],
    *,
    begins: bool = False,
) -> dict[str, Any]:
    """Columns of a step about energy: stored energy, works since the start, and energy defect.

    Parameters
    ----------
    former
        Rows of the earlier steps, of which the last three are used; empty at the first step.
    time, powers
        Time of the step [s], and energies and powers, see `step_powers`.
    begins
        Whether the step is the first of a cycle, in which works begin at zero. Energy that the
        extrapolated start of the cycle has added does not count as a defect.
    """
    now = np.array([powers[name] for name in SIGNS])
    energy = powers["kinetic"] + powers["strain"]
    near = former[-3:]
    work = np.zeros(len(SIGNS))
    defect = 0.0
    if near:
        times = np.array([*(row["time_s"] for row in near), time])
        work = last_interval(times) @ np.vstack([*(row["state/powers"] for row in near), now])
    if near and not begins:
        last = near[-1]
        stored = last["run/kinetic_energy_J"] + last["run/strain_energy_J"]
        gained = float(work @ [*SIGNS.values()])
        defect = last["run/energy_defect_J"] + energy - stored - gained
        work += [last[f"run/{name}_work_J"] for name in SIGNS]
    return {
        "run/kinetic_energy_J": powers["kinetic"],
        "run/strain_energy_J": powers["strain"],
        **{f"run/{name}_work_J": value for name, value in zip(SIGNS, work.tolist(), strict=True)},
        "run/energy_defect_J": defect,
        "state/powers": now,
    }


def balance_error(columns: Mapping[str, np.ndarray]) -> float:
    """Largest energy defect over the largest energy exchanged [-], from columns by path."""
    defect = columns["run/energy_defect_J"]
    works = [columns[f"run/{name}_work_J"] for name in SIGNS]
    gained = sum(sign * work for sign, work in zip(SIGNS.values(), works, strict=True))
    exchanged = np.abs([defect + gained, *works]).max()
    return float(np.abs(defect).max() / exchanged) if exchanged else 0.0


def step_powers(equations: StepEquations, step: MechanismStep) -> dict[str, float]:
    """Energies [J] and the powers [W] that change them, at an accepted step, by name.

    They satisfy ``d(kinetic + strain)/dt = drive + applied + drag - film - damping``. The first
    three powers are those of the drives, of forces and gravity, and of the surfaces' drag on the
    oil. The last two are losses in the films and in the structure of the bodies.

    Without friction the loss of a film is that of its pressure flow, and the drag is an external
    power. With friction the loss is all power that the film dissipates, and the drag is an internal
    power, which is set to zero. The power of oil that is supplied under pressure is added to the
    drag.
    """
    system = equations.system
    motion = step.solution.motion
    responses = equations.responses
    z = step.x[: system.n]
    rates = step.rate[: system.n]
    powers = dict.fromkeys(("kinetic", "strain", *SIGNS), 0.0)
    for _, body, (body_z, body_rates) in system.each_body(z, rates):
        energies = body.energies(body_z, body_rates)
        powers["kinetic"] += energies.kinetic
        powers["strain"] += energies.strain
        powers["damping"] += energies.dissipated
    powers["strain"] += responses.energy(step.x[responses.indices])
    powers["damping"] += responses.dissipation(step.rate[responses.indices])
    for joint in step.solution.joints:
        lost, fed = joint.powers
        lost -= joint.flows.refill_work
        if joint.binding.film.friction:
            lost += joint.friction.sheared
            fed = 0.0
        if under_pressure(joint.film):
            fed += joint.flows.work
        if joint.contact is not None:
            powers["strain"] += float(joint.contact.area @ joint.touch.potential)
            lost += joint.rubbed if joint.contact.friction else 0.0
        powers["film"] += lost
        powers["drag"] += fed
    return powers | {"drive": motion.drive_power, "applied": motion.applied_power}


#: Number of time constants of the slowest pattern after which oscillations of the start have
#: decayed to 2e-9.
RINGS = 20.0


class BasisErrorEstimate(Stateful):
    """Estimate of the gap error due to the basis of a reduced body, during a run.

    The error is the quasi-static response of the missing flexibility to the pressure P of the run,
    with the damping of the structure,

        (S_full - S_basis) w   with   w + zeta dw/dt = P.

    It is an estimate within a factor of about two, not a bound. With M4 no flexibility is missing,
    but the inertia of the residual patterns is neglected. The response of these patterns to their
    inertia is added, with their flexibility S_res, mass matrix M and amplitudes y,

        S_res M y'',   delayed by zeta and by the time constant of the patterns' inertia.

    At the start of a run, patterns without mass accelerate for microseconds, in which the
    neglected inertia could not have moved the bore. Patterns with little damping oscillate after
    that, and their estimate is meaningless. Estimates are used only after the time `start`.

    Parameters
    ----------
    missing_flexibility
        Outward displacement of the surface at m points per nodal pressure [m/Pa], and per further
        load, shape (m, k).
    damping_time
        Structural damping zeta of the body [s].
    neglected_inertia
        Outward displacement of the surface at m points per acceleration of the r residual
        amplitudes, shape (m, r); None if no inertia is neglected.
    inertia_time
        Time constant of the slowest residual pattern [s].

    Attributes
    ----------
    loads
        Number k of pressures and other loads.
    start
        Time after which estimates are used [s].
    known
        Whether the missing flexibility is known.
    filtered, accelerated
        Delayed loads, shape (k,) [Pa], and delayed accelerations of the amplitudes, shape (r,)
        [Pa/s2].
    """

    carried: ClassVar = {
        "filtered": Value("float", ("loads",)),
        "accelerated": Value("float", ("patterns",)),
    }

    def __init__(
        self,
        missing_flexibility: np.ndarray,
        damping_time: float,
        neglected_inertia: np.ndarray | None = None,
        inertia_time: float = 0.0,
    ):
        self._missing = missing_flexibility
        self.loads = missing_flexibility.shape[1]
        self._damping_time = damping_time
        self._inertia = np.zeros((0, 0)) if neglected_inertia is None else neglected_inertia
        self._inertia_time = damping_time + inertia_time
        self.start = RINGS * inertia_time
        self.known = bool(missing_flexibility.size)
        self.filtered = np.zeros(self.loads)
        self.accelerated = np.zeros(self._inertia.shape[1])

    @classmethod
    def of(cls, missing: MissingFlexibility) -> BasisErrorEstimate:
        """Make the estimate for the missing flexibility of a surface."""
        return cls(
            missing.flexibility,
            missing.damping_time,
            missing.neglected_inertia,
            missing.inertia_time,
        )

    def add(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> float:
        """Add a step, and return the largest gap error on the surface at its end [m].

        Arguments are those of `field`. The error is NaN if the missing flexibility is not known.
        """
        if not self.known:
            return float("nan")
        return float(np.abs(self.field(step, pressure, acceleration)).max())

    def field(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> np.ndarray:
        """Add a step, and return the gap error at m points of the surface at its end, (m,) [m].

        Parameters
        ----------
        step
            Length of the step [s].
        pressure
            Loads of the body at the end of the step, shape (k,).
        acceleration
            Accelerations of the r residual amplitudes at the end of the step, shape (r,); None
            without patterns.
        """
        # Implicit Euler for the first-order delays.
        share = step / (step + self._damping_time)
        self.filtered = self.filtered + share * (pressure - self.filtered)
        field = self._missing @ self.filtered
        if len(self._inertia) and acceleration is not None:
            share = step / (step + self._inertia_time)
            self.accelerated = self.accelerated + share * (acceleration - self.accelerated)
            field = field + self._inertia @ self.accelerated
        return field


def surface_loads(
    system: System, pressures: Iterable[np.ndarray], z: np.ndarray
) -> dict[str, np.ndarray]:
    """Loads that all films exert on every body, by name of the body, see `Surface.loads` [Pa].

    Parameters
    ----------
    system
        The mechanism.
    pressures
        Pressures at the nodes of every film [Pa].
    z
        Coordinates of the mechanism, shape (n,).
    """
    loads: dict[str, np.ndarray] = {}
    for binding, pressure in zip(system.films, pressures, strict=True):
        for bound, angle in zip(binding.surfaces, binding.own_angles(z), strict=True):
            load = bound.surface.loads(pressure, angle)
            if load is not None:
                loads[bound.body] = loads.get(bound.body, 0.0) + load
    return loads


#: Components of an error, and the keys that reduce them; those without a table are keys of a joint
#: or of a body.
KEYS = {
    "basis": "reduction",
    "film_mesh": "cells",
    "part_mesh": "geometry",
    "step_size": "time.tolerance",
    "start": "time.periodicity",
}
COMPONENTS = tuple(KEYS)

#: Names in a summary of the quantities with an error budget.
QUANTITIES = ("max_pressure", "min_film_thickness")

#: Entries instead of an error that could not be estimated, and of one that cannot occur.
NOT_ESTIMATED = "not estimated"
NOT_APPLICABLE = "not applicable"
