"""What a run has shown so far, step by step: rows of its history, its figures, its trust.

With one lubricated joint its columns and figures stand alone, with several they bear its name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from fenics_ehd.base.columns import joint_prefix
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.sealed_file import named, require_like
from fenics_ehd.film.thickening import steepest_thickening
from fenics_ehd.multibody.basis_error import bore_body, bore_loads, estimate_at
from fenics_ehd.multibody.contact_record import ContactRecord
from fenics_ehd.multibody.crank_angle import CrankAngle
from fenics_ehd.multibody.cycle_answer import CycleAnswer
from fenics_ehd.multibody.energy import ENERGY_LIMIT, EnergyBalance, trusted
from fenics_ehd.multibody.error_shares import above, stated
from fenics_ehd.multibody.film_integrals import FilmIntegrals
from fenics_ehd.multibody.integrals import JointIntegrals
from fenics_ehd.multibody.joint_columns import joint_columns
from fenics_ehd.multibody.joint_heat import temperatures
from fenics_ehd.multibody.joint_places import JointPlaces
from fenics_ehd.multibody.joint_rates import joint_rates
from fenics_ehd.multibody.oil_account import OilAccount
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.powers import step_powers
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.system import FilmPlace
from fenics_ehd.multibody.thickening import unresolved

#: Largest distance of nodes, as a share of the angle over which the film is thin. There the load
#: of a fixed position is 2 % off on quadratic cells and 6 % on bilinear ones, and the thinnest film
#: of an orbit by less; at 0.8 it is 15 %.
NODE_SPACING = 0.5

#: Pressure beyond which a notice asks for the reason [Pa]: bearing metals yield far below, and
#: films of gears and rollers, whose solids are not those of a bearing, begin there.
HIGHEST = 1e9

#: Pressure over that of a film which moves in the time simulated, below which it is rounding.
RESTING = 1e-6

#: Names of a body's frame coordinates in a history.
FRAME = ("x_m", "y_m", "angle_rad")


@dataclass
class Extremes:
    """Of one film [Pa], [s], [m], [s]; in a periodic run of a cycle, from its start."""

    max_pressure: float = 0.0
    max_pressure_time: float = 0.0
    min_film_thickness: float = np.inf
    min_film_thickness_time: float = 0.0
    steepest_thickening: float = 1.0

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

    Attributes
    ----------
    groups
        Group and name of columns that are not the whole run's, ``joints/big_end/force_x_N``, once
        there is a step.
    extremes, former
        Of every joint, and those of the cycle before.
    worth
        What is known of how far figures of joints are off, by joint, see `error_budget`.
    """

    def __init__(self, equations: StepEquations, norm: StepNorm):
        self.groups: dict[str, str] = {}
        self._equations, self._norm = equations, norm
        films = equations.system.films
        self.extremes = {place.name: Extremes() for place in films}
        self.former: dict[str, Extremes] = {}
        self.worth: dict[str, dict[str, Any]] = {}
        self.crank_angle = CrankAngle(equations.system)
        self._places = {place.name: JointPlaces(equations.system, place) for place in films}
        self.estimates = {
            place.name: estimate_at(bore_body(equations.system, place), place.bore)
            for place in films
            if place.film.bore
        }
        self.balance: EnergyBalance | None = None
        self.rates = JointIntegrals()
        self.contacts = ContactRecord.of_all(equations)
        self.oil: dict[str, OilAccount] = {}
        self.counts = {"steps": 0, "newton_iterations": 0, "rejected_steps": 0}
        self.rejected_because: dict[str, int] = {}
        self.time = 0.0
        self._cycle, self._start = 1, 0.0

    def begins(self, cycles: Cycles | None) -> bool:
        """Whether another cycle of a search has begun since this was asked.

        The figures of the one before are forgotten then; counts and the estimates' past go on.
        """
        if cycles is None or cycles.number == self._cycle:
            return False
        self._cycle, self._start = cycles.number, cycles.start
        # A search that begins on another's orbit has no cycle before its first.
        self.former = self.extremes if self.counts["steps"] else {}
        self.extremes = {name: Extremes() for name in self.extremes}
        if self.balance is not None:
            self.balance.restart()
        self.crank_angle.restart(cycles.began.x[0])
        for estimate in self.estimates.values():
            estimate.largest *= 0.0  # what is not known stays so
        self.rates.restart()
        for contact in self.contacts.values():
            contact.restart()
        self.oil = {name: OilAccount(found.end, found.end) for name, found in self.oil.items()}
        return True

    def enter(self, step: MechanismStep) -> None:
        """Begin after a step that led to the run, and does not count among its own."""
        self.add(step)
        self.counts, self.rejected_because = dict.fromkeys(self.counts, 0), {}

    def add(self, step: MechanismStep) -> tuple[dict[str, float], dict[str, np.ndarray]]:
        """Account for an accepted step.

        Returns
        -------
        row, fields
            Of the history.
        """
        system, state = self._equations.system, step.solution
        rejected = sum(step.rejected.values())
        self.counts["steps"] += 1
        self.counts["newton_iterations"] += step.newton_iterations
        self.counts["rejected_steps"] += rejected
        for reason, count in step.rejected.items():
            self.rejected_because[reason] = self.rejected_because.get(reason, 0) + count
        size, self.time = step.time - self.time, step.time
        row = {"time_s": step.time, "crank_angle_deg": self.crank_angle.at(step.x)}
        stored = {"state/coordinates": step.x[: system.n], "state/rates": step.rate[: system.n]}
        if patterns := self._equations.responses.size:
            stored["state/quasi_static"] = step.x[system.n : system.n + patterns]
        loads = bore_loads(system, [film.pressure for film in state.films])
        gaps = self._norm.film_gaps(step.observed)
        for place, own, gap in zip(system.films, state.integrals, gaps, strict=True):
            prefix, film = self.prefix(place.name), own.state
            figures = self._joint(place, step, own, gap)
            if place.name in self.estimates:
                amplitudes = self._equations.responses.of_body(place.bore_body)
                figures["basis_error_estimate_m"] = self.estimates[place.name].add(
                    size, loads[place.bore_body], step.acceleration[amplitudes]
                )
            row |= self._grouped(prefix, f"joints/{place.name}", figures)
            path = f"joints/{place.name}/film"
            stored[f"{path}/pressure"] = film.pressure
            stored[f"{path}/gap"] = gap[-len(film.pressure) :]
            if film.fluid_fraction is not None:
                stored[f"{path}/fluid_fraction"] = film.fluid_fraction
        row |= self._bodies(step) | self._energy(step)
        row |= {"step_s": size, "newton_iterations": step.newton_iterations}
        return row | {"rejected_steps": rejected}, stored

    def _grouped(self, prefix: str, group: str, figures: dict[str, float]) -> dict[str, float]:
        """Columns of a joint or body, whose groups are kept."""
        found = {f"{prefix}{name}": value for name, value in figures.items()}
        if not found.keys() <= self.groups.keys():
            self.groups |= {f"{prefix}{name}": f"{group}/{name}" for name in figures}
        return found

    def prefix(self, joint: str) -> str:
        """What columns of a joint begin with."""
        return joint_prefix(joint, self.extremes)

    def _joint(
        self, place: FilmPlace, step: MechanismStep, own: FilmIntegrals, gap: np.ndarray
    ) -> dict[str, float]:
        """Columns of one lubricated joint."""
        film = own.state
        figures = joint_columns(place, step, film, gap)
        extremes = self.extremes[place.name]
        extremes.add(
            step.time - self._start, figures["max_pressure_Pa"], figures["min_film_thickness_m"]
        )
        steepest = steepest_thickening(place.film.film, film.pressure)
        extremes.steepest_thickening = max(extremes.steepest_thickening, steepest)
        figures |= self._places[place.name].columns(step, film.pressure, gap)
        if place.name in self.contacts:
            record = self.contacts[place.name]
            figures |= record.add(step.time, step.time - self._start, own)
        rates = joint_rates(place, step, own)
        self.rates.follow(place.name, step.time, rates)
        if account := OilAccount.follow(self.oil.get(place.name), rates):
            self.oil[place.name] = account
        return figures | rates

    def _bodies(self, step: MechanismStep) -> dict[str, float]:
        """Columns of the bodies' frames; a shaft has an angle alone."""
        system = self._equations.system
        row: dict[str, float] = {}
        for name, body in system.each_name():
            first = system.bodies[name].start
            if body.angle is None:
                continue
            frame = dict(zip(FRAME[2 - body.angle :], step.x[first:], strict=False))
            frame["speed_rad_per_s"] = step.rate[first + body.angle]
            row |= self._grouped(f"{name}.", f"bodies/{name}", frame)
        return row

    def _energy(self, step: MechanismStep) -> dict[str, float]:
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

    def answer(self, columns: Mapping[str, np.ndarray]) -> CycleAnswer:
        """Of the last cycle, from the columns of a history, see `CycleAnswer`."""
        rates = [
            self.prefix(joint) + name for joint, own in self.rates.items() for name in own.totals
        ]
        return CycleAnswer.of(self._equations.system, columns, rates)

    def joint_figures(self, answer: CycleAnswer | None = None) -> dict[str, dict[str, Any]]:
        """What ``summary.json`` has of every lubricated joint, by its name."""
        return {
            name: {
                "max_pressure_Pa": extremes.max_pressure,
                "max_pressure_time_s": extremes.max_pressure_time,
                "min_film_thickness_m": extremes.min_film_thickness,
                "min_film_thickness_time_s": extremes.min_film_thickness_time,
                "basis_error_estimate_m": self.estimates[name].largest
                if name in self.estimates
                else float("nan"),
                **self._means(name),
                **(self.contacts[name].figures() if name in self.contacts else {}),
                **({"error_budget": self.worth[name]} if name in self.worth else {}),
                **(answer.joint(self.prefix(name)) if answer else {}),
            }
            for name, extremes in self.extremes.items()
        }

    def figures(self, answer: CycleAnswer | None = None) -> dict[str, Any]:
        """What ``summary.json`` has of them."""
        joints = self.joint_figures(answer)
        alone: dict[str, Any] = {"joints": joints}
        if len(joints) == 1:
            ((name, found),) = joints.items()
            alone = {"joint": name, **found}
        balance = self.balance
        return {
            **alone,
            **(answer.figures() if answer else {}),
            "energy_balance_error": balance.error if balance else 0.0,
            "net_energy_balance_error": balance.net_error if balance else 0.0,
            "simulated_time_s": self.time,
            **self.counts,
            "rejected_because": dict(self.rejected_because),
            "notices": self._notices(),
        }

    def _means(self, joint: str) -> dict[str, float]:
        """Of a joint's rates over the run, or the cycle, and temperatures that follow from them."""
        found = self.rates[joint].means if joint in self.rates else {}
        means = {f"mean_{name}": value for name, value in found.items()}
        if joint in self.oil:
            means |= self.oil[joint].figures(self.rates[joint].totals)
        place = next(film for film in self._equations.system.films if film.name == joint)
        return means | ({} if place.joint.heat is None else temperatures(place, found))

    def _notices(self) -> list[str]:
        """One line each of what is hardly meant."""
        return [
            f"{name}: {1e-6 * found.max_pressure:.6g} MPa, more than {1e-6 * HIGHEST:g} MPa: no "
            "lining bears that, and no model here is made for it: see loads, units, size and "
            "whether a bore is meant to be rigid"
            for name, found in self.extremes.items()
            if found.max_pressure > HIGHEST
        ] + [
            f"{name}: nothing moves or loads its film, the {self.extremes[name].max_pressure:.2g} "
            "Pa in it are rounding"
            for name in self._resting
        ]

    @property
    def _resting(self) -> list[str]:
        """Names of the films whose pressures are nothing beside what a motion would make."""
        return [
            place.name
            for place in self._equations.system.films
            if self.counts["steps"]
            and self.extremes[place.name].max_pressure
            < RESTING * place.film.film.parameters.pressure_scale
        ]

    def verdict(self, limit: float = np.inf) -> str:
        """``"complete"``, or why the figures cannot be trusted.

        They cannot where what is known of their errors exceeds a relative limit. What stands for
        these errors, of the films' meshes and of the steps, counts as far as they are not known; a
        defect of the energy also where it exceeds them.
        """
        if self.extremes and len(self._resting) == len(self.extremes):
            return "complete"  # errors of nothing are no shares
        if told := above(self.worth, limit):
            return told
        mesh, steps = (stated(self.worth, component) for component in ("film_mesh", "step_size"))
        for place in self._equations.system.films if mesh is None else ():
            extremes = self.extremes[place.name]
            told = _too_coarse(place, extremes.min_film_thickness)
            told = told or unresolved(place, extremes.steepest_thickening)
            if told:
                return told
        balance = self.balance
        if balance is None or (steps is not None and balance.error <= max(steps, ENERGY_LIMIT)):
            return "complete"
        return trusted(balance.error, balance.net_error)

    def stored_state(self) -> dict[str, Any]:
        """All of it as nested dictionaries of arrays and numbers, for `load_state`."""
        return {
            "totals": {
                **self.counts,
                "time": self.time,
                "cycle": self._cycle,
                "start": self._start,
                "turns_left_out": self.crank_angle.left_out,
            },
            "rejected": dict(self.rejected_because),
            "extremes": {name: asdict(found) for name, found in self.extremes.items()},
            "former": {name: asdict(found) for name, found in self.former.items()},
            "estimates": {name: found.stored_state() for name, found in self.estimates.items()},
            "balance": {} if self.balance is None else self.balance.stored_state(),
            "rates": self.rates.stored_state(),
            "contacts": {name: found.stored_state() for name, found in self.contacts.items()},
            "oil": {name: asdict(found) for name, found in self.oil.items()},
            "groups": dict(self.groups),
        }

    def load_state(self, stored: Mapping[str, Any]) -> None:
        """Go on where another run of the same mechanism was.

        Raises
        ------
        InputError
            It is not the state of such a run.
        """
        with named(InputError, "the checkpoint's figures"):
            require_like(stored, self.stored_state())
            if stored["balance"]:
                require_like(stored["balance"], EnergyBalance.pattern(), "balance/")
            time = stored["integrator"]["times"][0]
            if stored["totals"]["time"] != time:
                raise ValueError(f"totals/time must be that of the integrator, {time:.9g} s")
            self._load(stored)

    def _load(self, stored: Mapping[str, Any]) -> None:
        self.counts = {name: int(stored["totals"][name]) for name in self.counts}
        self.time = float(stored["totals"]["time"])
        self._cycle = int(stored["totals"]["cycle"])
        self._start = float(stored["totals"]["start"])
        self.crank_angle.left_out = float(stored["totals"]["turns_left_out"])
        self.rejected_because = {name: int(n) for name, n in stored["rejected"].items()}
        # A run may have no step left to tell them anew.
        self.groups.update({name: str(place) for name, place in stored["groups"].items()})
        names = [field.name for field in fields(Extremes)]
        for extremes, key in ((self.extremes, "extremes"), (self.former, "former")):
            for joint, found in stored[key].items():
                extremes[joint] = Extremes(*(float(found[name]) for name in names))
        for joint, found in stored["estimates"].items():
            self.estimates[joint].load_state(found)
        self.balance = EnergyBalance.of(stored["balance"]) if stored["balance"] else None
        self.rates.load_state(stored["rates"])
        for joint, found in stored["contacts"].items():
            self.contacts[joint].load_state(found)
        self.oil = {
            joint: OilAccount(float(found["start"]), float(found["end"]))
            for joint, found in stored["oil"].items()
        }


def _too_coarse(place: FilmPlace, thickness: float) -> str:
    """What is to be said of a rigid bore's film that is too thin for its mesh; usually nothing."""
    if place.film.bore is not None:
        return ""
    angles = np.unique(place.film.film.parameters.grid.node_positions[:, 0].round(9))
    spacing = np.degrees(np.diff(angles, append=angles[0] + 2 * np.pi).max())
    # Where the gap is below twice its least: h = c (1 - eps cos phi).
    length = float(place.film.lengths(np.array([thickness]))[0])
    shape = place.film.shape
    bend = place.film.clearance + (0.0 if shape is None else shape.bend)
    thin = np.degrees(np.sqrt(2 * length / bend))
    if spacing <= NODE_SPACING * thin:
        return ""
    return (
        f"untrustworthy: joints.{place.name}.cells put nodes {spacing:.3g} degrees apart, above "
        f"half of the {thin:.3g} degrees over which a film of {thickness * 1e6:.3g} um is thin: "
        "use more cells around"
    )
