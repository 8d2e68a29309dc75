"""What a run has shown so far, step by step: rows of its history, its figures, its trust.

With one lubricated joint its columns and figures stand alone, with several they bear its name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from fenics_ehd.multibody.basis_error import BasisErrorEstimate
from fenics_ehd.multibody.bdf import Step
from fenics_ehd.multibody.energy import EnergyBalance, trusted
from fenics_ehd.multibody.friction import film_friction
from fenics_ehd.multibody.neglected_inertia import neglected_inertia, slowest_pattern
from fenics_ehd.multibody.planar_body import FlexibleBody
from fenics_ehd.multibody.powers import step_powers
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.system import FilmPlace

#: Names of a body's frame coordinates in a history.
FRAME = ("x_m", "y_m", "angle_rad")


@dataclass
class Extremes:
    """Of one film [Pa], [s], [m], [s]."""

    max_pressure: float = 0.0
    max_pressure_time: float = 0.0
    min_film_thickness: float = np.inf
    min_film_thickness_time: float = 0.0

    def add(self, time: float, pressure: float, thickness: float) -> None:
        """Account for one step."""
        if pressure > self.max_pressure:
            self.max_pressure, self.max_pressure_time = pressure, time
        if thickness < self.min_film_thickness:
            self.min_film_thickness, self.min_film_thickness_time = thickness, time


class Tracker:
    """Follows a run.

    Parameters
    ----------
    equations, norm
        Of the mechanism.
    """

    def __init__(self, equations: StepEquations, norm: StepNorm):
        self._equations, self._norm = equations, norm
        films = equations.system.films
        self._several = len(films) > 1
        self.extremes = {place.name: Extremes() for place in films}
        self.estimates = {
            place.name: _estimate(equations, place) for place in films if place.film.bore
        }
        self.balance: EnergyBalance | None = None
        self.counts = {"steps": 0, "newton_iterations": 0, "rejected_steps": 0}
        self.rejected_because: dict[str, int] = {}
        self.time = 0.0
        self._gaps = np.empty(0)

    def begin_cycle(self) -> None:
        """Forget the figures of the cycle before; counts and the estimates' past go on."""
        self.extremes = {name: Extremes() for name in self.extremes}
        self.balance = None
        for estimate in self.estimates.values():
            estimate.largest *= 0.0  # what is not known stays so

    def add(self, step: Step) -> tuple[dict[str, float], dict[str, np.ndarray]]:
        """Account for an accepted step.

        Returns
        -------
        row, fields
            Of the history.
        """
        system, state = self._equations.system, step.auxiliary
        rejected = sum(step.rejected.values())
        self.counts["steps"] += 1
        self.counts["newton_iterations"] += step.newton_iterations
        self.counts["rejected_steps"] += rejected
        for reason, count in step.rejected.items():
            self.rejected_because[reason] = self.rejected_because.get(reason, 0) + count
        size, self.time = step.time - self.time, step.time
        row = {"time_s": step.time}
        stored = {"coordinates": step.x[: system.n], "rates": step.rate[: system.n]}
        if len(step.x) > system.n:
            stored["quasi_static"] = step.x[system.n :]
        patterns = system.n
        gaps = self._norm.film_gaps(step.watched)
        for i, (place, film, gap) in enumerate(zip(system.films, state.films, gaps, strict=True)):
            prefix = self._prefix(place.name)
            figures = self._joint(place, step, film, gap)
            flexibility = self._equations.flexibilities[i]
            if place.name in self.estimates and place.film.bore is not None:
                last = patterns + (flexibility.size if flexibility else 0)
                pressure = place.film.bore.structure_pressure(film.pressure)
                accelerations = step.acceleration[patterns:last]
                figures["basis_error_estimate_m"] = self.estimates[place.name].add(
                    size, pressure, accelerations
                )
                patterns = last
            row |= {f"{prefix}{name}": value for name, value in figures.items()}
            stored[f"{prefix}pressure_Pa"] = film.pressure
        row |= self._bodies(step) | self._energy(step)
        row |= {"step_s": size, "newton_iterations": step.newton_iterations}
        return row | {"rejected_steps": rejected}, stored

    def _prefix(self, joint: str) -> str:
        return f"{joint}." if self._several else ""

    def _joint(self, place: FilmPlace, step: Step, film: Any, gap: np.ndarray) -> dict[str, float]:
        """Columns of one lubricated joint."""
        peak = int(np.argmax(film.pressure))
        angle, _ = place.film.film.parameters.grid.node_positions[peak]
        thickness, pressure = float(gap.min()), float(film.pressure[peak])
        self.extremes[place.name].add(step.time, pressure, thickness)
        force = step.auxiliary.motion.multipliers[place.rows]
        figures = {
            "max_pressure_Pa": pressure,
            "min_film_thickness_m": thickness,
            "max_pressure_angle_deg": np.degrees(np.mod(angle + np.pi, 2 * np.pi) - np.pi),
            "eccentricity_x_m": step.x[place.xi[0]],
            "eccentricity_y_m": step.x[place.xi[1]],
            "force_x_N": force[0],
            "force_y_N": force[1],
        }
        if place.film.friction:
            # Braking is positive, and the power that the journal's turning puts into the oil.
            torque = -film_friction(place.film, film).torque
            figures["friction_torque_Nm"] = torque
            figures["friction_power_W"] = torque * place.shaft_rate(step.rate)
        return figures

    def _bodies(self, step: Step) -> dict[str, float]:
        """Columns of the bodies' frames; a shaft has an angle alone."""
        system, row = self._equations.system, {}
        for name, body in system.each_name():
            first = system.bodies[name].start
            if body.angle is None:
                continue
            for place, column in zip(range(body.angle + 1), FRAME[2 - body.angle :], strict=True):
                row[f"{name}.{column}"] = step.x[first + place]
            row[f"{name}.speed_rad_per_s"] = step.rate[first + body.angle]
        return row

    def _energy(self, step: Step) -> dict[str, float]:
        powers = step_powers(self._equations, step)
        if self.balance is None:
            self.balance = EnergyBalance(step.time, powers)
        else:
            self.balance.add(step.time, powers)
        return {
            "kinetic_energy_J": powers.kinetic,
            "strain_energy_J": powers.strain,
            **{f"{name}_work_J": work for name, work in self.balance.work.items()},
            "energy_defect_J": self.balance.defect,
        }

    def figures(self) -> dict[str, Any]:
        """What ``summary.json`` has of them."""
        joints = {
            name: {
                "max_pressure_Pa": extremes.max_pressure,
                "max_pressure_time_s": extremes.max_pressure_time,
                "min_film_thickness_m": extremes.min_film_thickness,
                "min_film_thickness_time_s": extremes.min_film_thickness_time,
                "basis_error_estimate_m": self.estimates[name].largest
                if name in self.estimates
                else float("nan"),
            }
            for name, extremes in self.extremes.items()
        }
        alone: dict[str, Any] = {"joints": joints}
        if len(joints) == 1:
            ((name, found),) = joints.items()
            alone = {"joint": name, **found}
        balance = self.balance
        return {
            **alone,
            "energy_balance_error": balance.error if balance else 0.0,
            "net_energy_balance_error": balance.net_error if balance else 0.0,
            "simulated_time_s": self.time,
            **self.counts,
            "rejected_because": dict(self.rejected_because),
        }

    def verdict(self) -> str:
        """``"complete"``, or why the figures cannot be trusted."""
        balance = self.balance
        return trusted(balance.error, balance.net_error) if balance else "complete"

    def change_over_cycle(self, watched: np.ndarray) -> float:
        """Largest change of a film, relative, since this was asked last; infinite at first."""
        gaps = self._norm.gaps(watched)
        former, self._gaps = self._gaps, gaps
        if not len(former):
            return np.inf
        return float(np.max(np.abs(gaps - former) / gaps))

    def memory(self) -> dict[str, Any]:
        """All of it as nested dictionaries of arrays and numbers, for `restore`."""
        return {
            "totals": {**self.counts, "time": self.time},
            "rejected": dict(self.rejected_because),
            "extremes": {name: asdict(found) for name, found in self.extremes.items()},
            "estimates": {name: found.memory() for name, found in self.estimates.items()},
            "balance": {} if self.balance is None else self.balance.memory(),
            "gaps": self._gaps,
        }

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on where another run of the same mechanism was."""
        self.counts = {name: int(memory["totals"][name]) for name in self.counts}
        self.time = float(memory["totals"]["time"])
        self.rejected_because = {name: int(n) for name, n in memory["rejected"].items()}
        names = [field.name for field in fields(Extremes)]
        for joint, found in memory["extremes"].items():
            self.extremes[joint] = Extremes(*(float(found[name]) for name in names))
        for joint, found in memory["estimates"].items():
            self.estimates[joint].restore(found)
        self.balance = EnergyBalance.of(memory["balance"]) if memory["balance"] else None
        self._gaps = np.array(memory["gaps"])


def _estimate(equations: StepEquations, place: FilmPlace) -> BasisErrorEstimate:
    """Of the bore of a flexible body."""
    body = equations.system.mechanism.bodies[place.bore_body]
    assert isinstance(body, FlexibleBody)
    part = body.reduced
    return BasisErrorEstimate(
        part.missing_flexibility, body.damping_time, neglected_inertia(part), slowest_pattern(part)
    )
