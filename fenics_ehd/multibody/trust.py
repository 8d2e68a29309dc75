"""What a run is worth: its balance of energy, errors of its basis and films, its error budget.

The energy stored changes by the powers of what moves the mechanism, and by what films and bodies
lose; what is left over as steps go on is their error. The flexibility that a basis misses, or the
inertia of M4's, makes an error of the gap that is estimated along the run. What components of an
error budget (`fenics_ehd.analysis.error_budget`) say, and a film too thin for its mesh, decides
whether the run may be trusted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from fenics_ehd.base.layout import Stateful, Value
from fenics_ehd.film.forces import under_pressure
from fenics_ehd.multibody.body import FlexibleBody
from fenics_ehd.multibody.mechanism import FilmBinding, System
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.reduction.body import ReducedBody, ResidualFlexibility


def integral(times: np.ndarray, values: np.ndarray, first: int = 0) -> np.ndarray:
    """Integral of the cubic through four points at a time, from the point of a number to the last.

    A crank lends its rod hundreds of times what is lost, and by a parabola the error of that
    integral would be ten times the defect of the integration itself.

    Parameters
    ----------
    times, values
        shape (k,) [s], (k, names).
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


#: What adds to the energy and what takes from it.
SIGNS = {"drive": 1, "applied": 1, "drag": 1, "film": -1, "damping": -1}

#: Largest energy balance error of a run that may be trusted, where no larger one of the steps is
#: known. Steps of a crank or four-bar that leave as much leave extremes of its film some 5 % off;
#: beside what a film dissipates, a hundredth of what a crank lends, the same defect says nothing.
ENERGY_LIMIT = 0.05


def energy_row(
    former: Sequence[Mapping[str, Any]],
    time: float,
    powers: Mapping[str, float],
    *,
    begins: bool = False,
) -> dict[str, Any]:
    """Columns of the energy at a step: what is stored, works since the start, and the defect.

    Parameters
    ----------
    former
        Rows of the steps before, none at the first one; the last three count.
    time, powers
        Of the step [s], see `step_powers`.
    begins
        Whether works begin anew, of a cycle whose first step it is. What a move of its start has
        stored is no defect.
    """
    now, energy = np.array([powers[name] for name in SIGNS]), powers["kinetic"] + powers["strain"]
    near, work, defect = former[-3:], np.zeros(len(SIGNS)), 0.0
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
        **{f"run/{name}_work_J": own for name, own in zip(SIGNS, work.tolist(), strict=True)},
        "run/energy_defect_J": defect,
        "state/powers": now,
    }


def balance_error(columns: Mapping[str, np.ndarray]) -> float:
    """Largest defect over the largest energy exchanged, from columns of a history by path."""
    defect = columns["run/energy_defect_J"]
    work = [columns[f"run/{name}_work_J"] for name in SIGNS]
    gained = sum(sign * own for sign, own in zip(SIGNS.values(), work, strict=True))
    exchanged = np.abs([defect + gained, *work]).max()
    return float(np.abs(defect).max() / exchanged) if exchanged else 0.0


def step_powers(equations: StepEquations, step: MechanismStep) -> dict[str, float]:
    """Energy and the powers that change it, at an accepted step [J], [W], by name.

    ``d(kinetic + strain)/dt = drive + applied + drag - film - damping``: the power of what imposes
    angles over time, that of forces and gravity, that of the surfaces' drag on the oil, the losses
    in the films and in the bodies' structure.

    Without friction the films lose what drives their pressure flow, and the drag comes from
    outside. With friction they lose all that they dissipate; the drag is internal, and zero. Oil
    that is let in and out under pressure brings its work with the drag.
    """
    system, motion, responses = equations.system, step.solution.motion, equations.responses
    z, rates = step.x[: system.n], step.rate[: system.n]
    found = dict.fromkeys(("kinetic", "strain", *SIGNS), 0.0)
    for _, body, (own, own_rates) in system.each_body(z, rates):
        energies = body.energies(own, own_rates)
        found["kinetic"] += energies.kinetic
        found["strain"] += energies.strain
        found["damping"] += energies.dissipated
    found["strain"] += responses.energy(step.x[responses.indices])
    found["damping"] += responses.dissipation(step.rate[responses.indices])
    for joint in step.solution.joints:
        lost, fed = joint.powers
        lost -= joint.flows.refill_work
        if joint.binding.film.friction:
            lost, fed = lost + joint.friction.sheared, 0.0
        if under_pressure(joint.film):
            fed += joint.flows.work
        if joint.contact is not None:
            found["strain"] += float(joint.contact.area @ joint.touch.potential)
            lost += joint.rubbed if joint.contact.friction else 0.0
        found["film"] += lost
        found["drag"] += fed
    return found | {"drive": motion.drive_power, "applied": motion.applied_power}


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
    if part.residual is None or not part.residual.mass.size:
        return BasisErrorEstimate(missing, body.damping_time)
    inertia = neglected_inertia(part, part.residual)
    return BasisErrorEstimate(missing, body.damping_time, inertia, slowest_pattern(part.residual))


def bore_body(system: System, binding: FilmBinding) -> FlexibleBody:
    """The flexible body that has the bore of a film."""
    body = system.mechanism.bodies[binding.bore_body]
    assert isinstance(body, FlexibleBody)
    return body


def bore_loads(system: System, pressures: Iterable[np.ndarray]) -> dict[str, np.ndarray]:
    """Pressures on the pressure nodes of all bores of a body, by its name, of all films' nodes."""
    found: dict[str, np.ndarray] = {}
    for binding, pressure in zip(system.films, pressures, strict=True):
        if binding.film.bore is not None:
            part = bore_body(system, binding).reduced
            load = found.setdefault(binding.bore_body, np.zeros(part.load_projection.shape[1]))
            load[part.rows_of(binding.bore).pressures] = binding.film.bore.structure_pressure(
                pressure
            )
    return found


def neglected_inertia(body: ReducedBody, residual: ResidualFlexibility) -> np.ndarray:
    """Gap error per acceleration of the residual amplitudes.

    The force ``-M_rr y''`` that a residual pattern's mass would exert, answered by
    its own stiffness.

    Returns
    -------
    numpy.ndarray
        Outward bore displacement, shape (m, r).
    """
    shape = body.outward(residual.displacement)
    return (shape / residual.stiffness) @ residual.mass


def slowest_pattern(residual: ResidualFlexibility) -> float:
    """``1 / omega`` of the slowest residual pattern on its own stiffness and mass [s]."""
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
