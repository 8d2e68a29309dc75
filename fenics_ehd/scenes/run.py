"""Run a slider-crank over its crank revolutions and record every step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.film import Film, FilmGrid, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.film.layout import film_grid
from fenics_ehd.multibody.basis_error import BasisErrorEstimate
from fenics_ehd.multibody.bdf import Step, StepControl, integrate
from fenics_ehd.multibody.crank import ConstantSpeedCrank
from fenics_ehd.multibody.energy import EnergyBalance, Powers
from fenics_ehd.multibody.quasi_static import massless_coordinates, neglected_inertia
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.slider_crank import SliderCrank
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.scenes.thin_film import check_thin_film

#: Film cells around and along a bore that is no structured mesh.
DEFAULT_CELLS = (20, 5)

#: Largest energy balance error of a run that may be trusted.
ENERGY_LIMIT = 0.05


@dataclass
class Totals:
    """Figures of a run so far."""

    time: float = 0.0
    steps: int = 0
    newton_iterations: int = 0
    rejected_steps: int = 0
    film_solves: int = 0
    max_pressure: float = 0.0
    max_pressure_time: float = 0.0
    min_film_thickness: float = np.inf
    min_film_thickness_time: float = 0.0
    basis_error: float = float("nan")
    energy_error: float = 0.0
    wall_time: float = 0.0


def build_mechanism(settings: SliderCrankSettings, body: ReducedBody) -> SliderCrank:
    """Put crank, rod, film and piston together.

    Raises
    ------
    SettingsError
        The crank is longer than the rod, the film not thin, or the body clamped.
    InterfaceMismatchError
        The body's bore is not meshed as a film mesh is.
    """
    mechanism, bearing = settings.mechanism, settings.bearing
    if "pin" not in body.points:
        raise SettingsError("the body has no boundary point 'pin' for the piston")
    rod_length = float(np.hypot(*body.points["pin"][:2, 0]))
    if not mechanism.crank_length < rod_length:
        raise SettingsError(
            f"mechanism.crank_length = {mechanism.crank_length:g} m must be below the rod's "
            f"length of {rod_length:g} m, or the crank cannot turn"
        )
    if body.frame == "clamped":
        raise SettingsError("the body was clamped when it was reduced, a rod must be free")
    check_thin_film(bearing.clearance, body.bore_radius)
    parameters = FilmParameters(
        film_mesh(settings, body),
        bearing.clearance,
        Lubricant(bearing.viscosity),
        rate=mechanism.crank_speed,
    )
    crank = ConstantSpeedCrank(mechanism.crank_length, mechanism.crank_speed)
    return SliderCrank(
        crank,
        massless_coordinates(body),
        Film(parameters),
        mechanism.piston_mass,
        settings.rod.damping_time,
        settings.film.transfer,
    )


def film_mesh(settings: SliderCrankSettings, body: ReducedBody) -> FilmGrid:
    """Film mesh of the scene: the bore's own cells, or those the scene asks for.

    A bore of triangles has no such cells and gets `DEFAULT_CELLS`.

    Raises
    ------
    InterfaceMismatchError
        The bore's cells are wanted and are not a structured quadratic mesh.
    """
    cells = settings.film.cells
    if not cells and body.pressure_family != "triangle":
        return film_grid(body.pressure_nodes)
    around, along = cells or DEFAULT_CELLS
    return uniform_grid(body.bore_radius, body.bore_width, (around, along), settings.film.element)


def step_control(settings: SliderCrankSettings, end: float) -> StepControl:
    """Step sizes of the run up to `end` [s].

    Raises
    ------
    SettingsError
        The smallest step is not the smallest.
    """
    time = settings.time
    largest = np.radians(time.largest_step) / settings.mechanism.crank_speed
    for name, value in (
        ("time.first_step", time.first_step),
        ("time.largest_step", largest),
        ("the simulated time", end),
    ):
        if not time.smallest_step < value:
            raise SettingsError(
                f"time.smallest_step = {time.smallest_step:g} s must be below {name} = {value:g} s"
            )
    return StepControl(time.tolerance, time.first_step, time.smallest_step, largest, time.order)


def simulate(
    settings: SliderCrankSettings,
    body: ReducedBody,
    totals: Totals,
    record: Callable[[dict[str, Any], dict[str, np.ndarray]], None] | None = None,
    progress: Callable[[Totals, Step], None] | None = None,
) -> Totals:
    """Integrate the scene from its start: slider at the far end, shaft centred.

    Parameters
    ----------
    settings
        The scene.
    body
        Reduced rod.
    totals
        Updated step by step, so that an interrupted run keeps its figures.
    record
        Called with the history row and the fields of every accepted step.
    progress
        Called after every accepted step.

    Returns
    -------
    Totals
        The object given.
    """
    end = settings.mechanism.revolutions * 2 * np.pi / settings.mechanism.crank_speed
    control = step_control(settings, end)
    mechanism = build_mechanism(settings, body)
    rest = np.zeros(mechanism.size)
    estimate = BasisErrorEstimate(
        body.missing_flexibility, settings.rod.damping_time, neglected_inertia(body)
    )
    n = 2 + body.modes
    balance = EnergyBalance(0.0, mechanism.initial_powers())
    started = perf_counter()
    for step in integrate(mechanism, (0.0, end), rest, rest, control):
        powers = mechanism.powers(step.x, step.rate, step.auxiliary)
        balance.add(step.time, powers)
        pressure = mechanism.journal.bore.structure_pressure(step.auxiliary.film.pressure)
        error = estimate.add(step.time - totals.time, pressure, step.acceleration[2:])
        row = _row(mechanism, step, powers, balance, error, step.time - totals.time)
        _account(totals, row, step, balance, estimate)
        totals.film_solves = mechanism.journal.film.solves
        totals.wall_time = perf_counter() - started
        if record is not None:
            fields = {"coordinates": step.x[:n], "rates": step.rate[:n], "pressure_Pa": pressure}
            if body.residual is not None:
                fields["quasi_static"] = step.x[n:]
            record(row, fields)
        if progress is not None:
            progress(totals, step)
    return totals


def _row(
    mechanism: SliderCrank,
    step: Step,
    powers: Powers,
    balance: EnergyBalance,
    error: float,
    size: float,
) -> dict[str, Any]:
    """One row of the history."""
    state = step.auxiliary
    pressure = state.film.pressure
    peak = int(np.argmax(pressure))
    angle, _ = mechanism.journal.film.parameters.grid.node_positions[peak]
    return {
        "time_s": step.time,
        "max_pressure_Pa": pressure[peak],
        "min_film_thickness_m": mechanism.journal.gap(step.x).min(),
        "max_pressure_angle_deg": np.degrees(np.mod(angle + np.pi, 2 * np.pi) - np.pi),
        "eccentricity_x_m": -step.x[0],
        "eccentricity_y_m": -step.x[1],
        "rod_angle_rad": state.angle.angle,
        "rod_rate_rad_per_s": state.angle.rate,
        "step_s": size,
        "newton_iterations": step.newton_iterations,
        "rejected_steps": sum(step.rejected.values()),
        "kinetic_energy_J": powers.kinetic,
        "strain_energy_J": powers.strain,
        "energy_defect_J": balance.defect,
        "basis_error_estimate_m": error,
    }


def _account(
    totals: Totals,
    row: dict[str, Any],
    step: Step,
    balance: EnergyBalance,
    estimate: BasisErrorEstimate,
) -> None:
    totals.time = step.time
    totals.steps += 1
    totals.newton_iterations += step.newton_iterations
    totals.rejected_steps += row["rejected_steps"]
    if row["max_pressure_Pa"] > totals.max_pressure:
        totals.max_pressure, totals.max_pressure_time = row["max_pressure_Pa"], step.time
    if row["min_film_thickness_m"] < totals.min_film_thickness:
        totals.min_film_thickness = row["min_film_thickness_m"]
        totals.min_film_thickness_time = step.time
    totals.basis_error = estimate.largest
    totals.energy_error = balance.error


def verdict(totals: Totals) -> str:
    """``"complete"``, or why the figures of a run that came to its end cannot be trusted."""
    if totals.energy_error > ENERGY_LIMIT:
        return (
            f"untrustworthy: energy balance error {100 * totals.energy_error:.2g} % above "
            f"{100 * ENERGY_LIMIT:g} %, lower time.tolerance"
        )
    return "complete"
