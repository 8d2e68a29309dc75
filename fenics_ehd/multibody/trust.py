"""Accuracy of a run: energy balance, error of the basis, and components of an error budget.

Stored energy changes by the powers of drives and loads, and by losses of films and bodies. The
difference that accumulates over the steps, the energy defect, is an error of the integration.

The flexibility that a basis lacks, or the inertia that M4 neglects, is an error of the gap, which
`BasisErrorEstimate` estimates along the run. Components of an error budget are estimated by
`fenics_ehd.analysis.error_budget`; `fenics_ehd.multibody.verdict` judges a run by all of them.
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
    """Integral over time from one point to the last, of the cubic through four points at a time.

    A crank and its rod exchange hundreds of times the energy that is lost. Parabolas would
    integrate that exchange with an error of ten times the defect of the time integration.

    Parameters
    ----------
    times, values
        Times [s], shape (k,), and values of several quantities, shape (k, names).
    first
        Number of the point at which the integral begins.
    """
    total = np.zeros(values.shape[1])
    for last in range(first + 1, len(times)):
        near = slice(max(0, last - 3), last + 1)
        total += last_interval(times[near]) @ values[near]
    return total


def last_interval(times: np.ndarray) -> np.ndarray:
    """Weights of the integral, over the last interval, of the polynomial through all points."""
    step = times[-1] - times[-2]
    powers = np.vander((times - times[-2]) / step, increasing=True)
    return step * np.linalg.solve(powers.T, 1.0 / np.arange(1, len(times) + 1))


#: Works by name, 1 if they add to the stored energy, -1 if they are losses.
SIGNS = {"drive": 1, "applied": 1, "drag": 1, "film": -1, "damping": -1}

#: Largest energy balance error of a run that is accepted, unless a larger error of its steps is
#: known. Steps of a crank or four-bar with this defect have extremes of the film that are some 5 %
#: off. The defect is relative to the energy exchanged: the dissipation is a hundredth of it.
ENERGY_LIMIT = 0.05


def energy_row(
    former: Sequence[Mapping[str, Any]],
    time: float,
    powers: Mapping[str, float],
    *,
    begins: bool = False,
) -> dict[str, Any]:
    """Columns of the energy at a step: stored energy, works since the start, and the defect.

    Parameters
    ----------
    former
        Rows of the steps before, none at the first one; the last three count.
    time, powers
        Time of the step [s], and powers, see `step_powers`.
    begins
        Whether the step is the first of a cycle, in which works begin at zero. Energy that a moved
        start of the cycle has added is no defect.
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
    """Largest defect over the largest energy exchanged, from columns of a history by path."""
    defect = columns["run/energy_defect_J"]
    works = [columns[f"run/{name}_work_J"] for name in SIGNS]
    gained = sum(sign * work for sign, work in zip(SIGNS.values(), works, strict=True))
    exchanged = np.abs([defect + gained, *works]).max()
    return float(np.abs(defect).max() / exchanged) if exchanged else 0.0


def step_powers(equations: StepEquations, step: MechanismStep) -> dict[str, float]:
    """Energy and the powers that change it, at an accepted step [J], [W], by name.

    ``d(kinetic + strain)/dt = drive + applied + drag - film - damping``: powers of the drives, of
    forces and gravity, and of the surfaces' drag on the oil; losses in the films and in the bodies'
    structure.

    Without friction the loss of a film is that of its pressure flow, and the drag is an external
    power. With friction the loss is all that the film dissipates, and the drag is internal: zero.
    The work of oil that is supplied under pressure counts as drag.
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


#: Time constants of the slowest pattern after which the ringing of a start has decayed to 2e-9.
RINGS = 20.0


class BasisErrorEstimate(Stateful):
    """Error of the gap by the basis along a run.

        (S_full - S_basis) w   with   w + zeta dw/dt = P

    It is the quasi-static response of the missing flexibility to the pressure of the run, damped as
    the structure is: an estimate within a factor of about two, not a bound. M4 lacks no
    flexibility, but the inertia of its residual patterns; their response to it is added,

        S_res M y'',   delayed by zeta and by the time constant of the patterns' inertia.

    At the start of a run, patterns without mass accelerate for microseconds, in which the
    neglected inertia could not have moved the bore. Patterns of little damping ring after that, and
    their estimate is meaningless. Estimates count from `start` on, when the ringing is over.

    Parameters
    ----------
    missing_flexibility
        Outward displacement of the surface per nodal pressure [m/Pa], and per further load, shape
        (m, k).
    damping_time
        zeta [s].
    neglected_inertia
        Outward displacement of the surface per acceleration of the residual amplitudes, shape
        (m, r); None: no inertia is neglected.
    inertia_time
        Time constant of the slowest pattern [s].

    Attributes
    ----------
    loads
        Number k of pressures and other loads.
    start
        Time after which estimates count [s].
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
        """Estimate of the gap error by missing flexibility."""
        return cls(
            missing.flexibility,
            missing.damping_time,
            missing.neglected_inertia,
            missing.inertia_time,
        )

    def add(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> float:
        """Largest gap error over the surface after one step of this length [s], in [m]."""
        if not self.known:
            return float("nan")
        return float(np.abs(self.field(step, pressure, acceleration)).max())

    def field(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> np.ndarray:
        """Gap error at points of the surface after one step of this length [s], shape (m,) [m]."""
        # Backward Euler on the first-order lags.
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
    """Loads of all bodies by the films on their surfaces, see `Surface.loads`, by body [Pa].

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


#: Components of an error, and the settings that reduce them.
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

#: In place of an error that could not be estimated, and of one that a run or joint cannot have.
NOT_ESTIMATED = "not estimated"
NOT_APPLICABLE = "not applicable"
