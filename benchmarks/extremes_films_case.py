"""Extreme films: what is run, what became of it, and what can be said of it in advance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from time import process_time
from typing import Any

import numpy as np
from scene_runs import TOLERANCE, GivenUpError, Parts, changed

from fenics_ehd.base.errors import EhdError
from fenics_ehd.bearing.operating_point import BearingResult, solve_bearing
from fenics_ehd.bearing.settings import BearingSettings
from fenics_ehd.film.heat import Heat
from fenics_ehd.film.oil_settings import make_lubricant
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.tracking import Tracker

#: Steps for which a run is given up as one that does not advance.
MOST_STEPS = 20_000

#: Factor between the tolerance of a run and that of the run which checks it.
TIGHTER = 30

#: The journal's table, that of its oil, and peak pressure and thinnest film.
JOINT, OIL = "joints.bearing", "lubricants.oil"
EXTREMES = "max_pressure_Pa", "min_film_thickness_m"


@dataclass(frozen=True)
class Machine:
    """A shipped scene with other values."""

    base: str
    values: Mapping[str, Any]

    def but(self, values: Mapping[str, Any]) -> Machine:
        """With more values replaced."""
        return replace(self, values={**self.values, **values})

    def run(self, parts: Parts) -> Outcome:
        """All steps, or all cycles; what is shown is that of the last cycle."""
        scene = changed(self.base, self.values)
        built = parts.build(scene)
        run, time = Run(built.mechanism, built.steps, scene.span), scene.time
        cycles = Cycles(run, scene.span, time.periodicity, time.cycles) if time.periodic else None
        tracker, rows, error = Tracker(run.equations, run.norm), [], None
        try:
            for step in run.until(scene.span) if cycles is None else cycles:
                if tracker.begins(cycles):
                    rows.clear()
                rows.append(tracker.add(step)[0])
                if tracker.counts["steps"] >= MOST_STEPS:
                    raise GivenUpError(f"{MOST_STEPS} steps led to {step.time:.3g} s only")
        except EhdError as found:
            error = found
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]} if rows else {}
        return Outcome(tracker.figures(), columns, tracker.verdict(), error)


@dataclass(frozen=True)
class Steady:
    """One rigid bearing at an eccentricity or under a load."""

    values: Mapping[str, Any]
    at: Mapping[str, float]

    def but(self, values: Mapping[str, Any]) -> Steady:
        """With more values replaced."""
        return replace(self, values={**self.values, **values})

    def run(self, _parts: Parts) -> Outcome:
        """Its operating point."""
        result = solve_bearing(BearingSettings(**self.values), **self.at)
        figures = {
            "max_pressure_Pa": result.max_pressure,
            "min_film_thickness_m": result.min_film_thickness,
            "load_N": result.load,
        }
        return Outcome(figures, steady=result)


@dataclass
class Outcome:
    """What became of a run: figures, columns of its history, its verdict, what ended it early."""

    figures: Mapping[str, Any] = field(default_factory=dict)
    columns: Mapping[str, np.ndarray] = field(default_factory=dict)
    verdict: str = "complete"
    error: EhdError | None = None
    seconds: float = 0.0
    steady: BearingResult | None = None


class Shop:
    """Runs machines and keeps what became of them."""

    def __init__(self) -> None:
        self._parts, self._found = Parts(), {}

    def run(self, machine: Machine | Steady) -> Outcome:
        """Run it, or refuse it."""
        key = repr(machine)
        if key not in self._found:
            began = process_time()
            try:
                found = machine.run(self._parts)
            except EhdError as error:
                found = Outcome(error=error)
            found.seconds = process_time() - began
            self._found[key] = found
        return self._found[key]


Measure = Callable[[Shop, Machine | Steady, Outcome], float]


@dataclass(frozen=True)
class Claim:
    """One thing expected of a run: text, in which ``{}`` is the limit, and how far it is off."""

    text: str
    limit: float
    measure: Measure
    name: str


@dataclass(frozen=True)
class Case:
    """One row; `error` is the class of the error that must end it, None for none."""

    name: str
    machine: Machine | Steady
    claims: tuple[Claim, ...]
    error: type[EhdError] | None = None
    trusted: bool = True


def figure(name: str, text: str, wanted: float, limit: float) -> Claim:
    """A figure's value."""

    def measure(_shop: Shop, _machine: Machine | Steady, run: Outcome) -> float:
        return abs(run.figures[name] / wanted - 1)

    return Claim(text, limit, measure, name)


def at_most(text: str, limit: float, value: Callable[[Outcome], float], name: str) -> Claim:
    """Something that an outcome has by itself."""
    return Claim(text, limit, lambda _shop, _machine, run: float(value(run)), name)


def same(text: str, limit: float, values: Mapping[str, Any], names: tuple = EXTREMES) -> Claim:
    """Figures of the machine with other values."""

    def measure(shop: Shop, machine: Machine | Steady, run: Outcome) -> float:
        other = shop.run(machine.but(values))
        if other.error is not None:
            return np.inf
        return max(abs(run.figures[name] / other.figures[name] - 1) for name in names)

    return Claim(text, limit, measure, "other run")


def without(text: str, limit: float, key: str) -> Claim:
    """Peak pressure and thinnest film of the machine without one of its values."""

    def measure(shop: Shop, machine: Machine | Steady, run: Outcome) -> float:
        values = {name: value for name, value in machine.values.items() if name != key}
        other = shop.run(replace(machine, values=values))
        if other.error is not None:
            return np.inf
        return max(abs(run.figures[name] / other.figures[name] - 1) for name in EXTREMES)

    return Claim(text, limit, measure, "without")


def tighter(limit: float) -> Claim:
    """Peak pressure and thinnest film at a finer tolerance."""

    def measure(shop: Shop, machine: Machine | Steady, run: Outcome) -> float:
        other = shop.run(machine.but({TOLERANCE: machine.values[TOLERANCE] / TIGHTER}))
        if other.error is not None:
            return np.inf
        return max(abs(run.figures[name] / other.figures[name] - 1) for name in EXTREMES)

    return Claim(f"extremes of tolerance / {TIGHTER} to {{}}", limit, measure, "tolerance")


def energy(limit: float) -> Claim:
    """Energy balance of the machine."""
    return at_most(
        "energy balance to {}", limit, lambda run: run.figures["energy_balance_error"], "energy"
    )


def powers(limit: float) -> Claim:
    """What goes into a film with friction is dissipated there, over run or cycle."""

    def value(run: Outcome) -> float:
        found = run.figures
        power = found["mean_film_power_W"] + found.get("mean_supply_power_W", 0.0)
        return abs(power / found["mean_dissipated_power_W"] - 1)

    return at_most("film and supply power dissipated to {}", limit, value, "powers")


def heat_balance(joint: str, oil: str, limit: float) -> Claim:
    """Effective temperature that mean power and flow stand for, less that of the film [K]."""

    def measure(_shop: Shop, machine: Machine | Steady, run: Outcome) -> float:
        scene, found = changed(machine.base, machine.values), run.figures
        heat = scene.joints[joint].heat
        temperature = found["effective_temperature_C"]
        lubricant = make_lubricant(replace_temperature(scene.lubricants[oil], temperature))
        carried = lubricant.density * lubricant.specific_heat * found["mean_leaving_flow_m3_per_s"]
        rise = (1 - heat.conducted) * found["mean_dissipated_power_W"] / carried
        return abs(heat.supply_temperature + heat.mixing * rise - temperature)

    return Claim(f"T by mean power and flow to {limit:g} K", limit, measure, "kelvin")


def replace_temperature(settings: Any, temperature: float) -> Any:
    """Settings of an oil at another temperature."""
    import attrs

    return attrs.evolve(settings, temperature=temperature)


def at_its_temperature(joint: str, oil: str, limit: float) -> Claim:
    """Extremes of a run without balance whose oil is given at the temperature found."""

    def measure(shop: Shop, machine: Machine | Steady, run: Outcome) -> float:
        key = f"joints.{joint}.heat"
        values = {k: v for k, v in machine.values.items() if k != key}
        values[f"lubricants.{oil}.temperature"] = run.figures["effective_temperature_C"]
        other = shop.run(replace(machine, values=values))
        if other.error is not None:
            return np.inf
        return max(abs(run.figures[name] / other.figures[name] - 1) for name in EXTREMES)

    return Claim("extremes of oil given at that temperature to {}", limit, measure, "given T")


def steady_balance(limit: float) -> Claim:
    """Effective temperature by bisection over bearings of given temperature [K]."""

    def measure(_shop: Shop, machine: Machine | Steady, run: Outcome) -> float:
        assert isinstance(machine, Steady)
        assert run.steady is not None
        values = {k: v for k, v in machine.values.items() if k != "supply_temperature"}
        supply = machine.values["supply_temperature"]
        heat = Heat(supply_temperature=supply)
        low, high = supply, 200.0
        for _ in range(20):
            middle = 0.5 * (low + high)
            settings = BearingSettings(**values, temperature=middle)
            found = solve_bearing(settings, **machine.at)
            density = make_lubricant(settings, 0.0).density
            rise = found.power_loss / (density * settings.specific_heat * found.flow.side)
            low, high = (middle, high) if supply + heat.mixing * rise > middle else (low, middle)
        assert run.steady.heat is not None
        return abs(middle - run.steady.heat.effective_temperature)

    return Claim(f"T by bisection to {limit:g} K", limit, measure, "kelvin")


def named(*words: str) -> Claim:
    """Words that an error must have; the number of those that it has not."""

    def value(run: Outcome) -> float:
        return sum(word not in str(run.error) for word in words)

    return at_most(f"it names {', '.join(words)}", 0.0, value, "words missing")


def untrusted(word: str) -> Claim:
    """A verdict that must say so: 1 where it does not."""

    def value(run: Outcome) -> float:
        return float(not (run.verdict.startswith("untrustworthy") and word in run.verdict))

    return at_most(f"called untrustworthy for its {word}", 0.0, value, "not called so")
