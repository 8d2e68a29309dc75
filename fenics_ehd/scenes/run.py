"""Run a slider-crank over its crank revolutions and record every step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.film import Film, FilmParameters, Lubricant
from fenics_ehd.multibody.bdf import Step, StepControl
from fenics_ehd.multibody.energy import Powers
from fenics_ehd.reduction import ReducedBody, Structure
from fenics_ehd.scenes.drive import build_crank, build_gas_force
from fenics_ehd.scenes.film_mesh import film_mesh
from fenics_ehd.scenes.rod import rod_length
from fenics_ehd.scenes.slider_crank import SliderCrank
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.scenes.step_sizes import step_sizes, with_stable_order
from fenics_ehd.scenes.thin_film import check_thin_film
from fenics_ehd.scenes.transient import Progress, Record, Totals, Watchers, march, verdict

__all__ = ["Totals", "build_mechanism", "simulate", "simulated_time", "verdict"]


def build_mechanism(settings: SliderCrankSettings, body: ReducedBody) -> SliderCrank:
    """Put crank, rod, film and piston together.

    Raises
    ------
    SettingsError
        The crank is longer than the rod, the film not thin, the body clamped, or a table of
        torque or gas force is wrong.
    InterfaceMismatchError
        The body's bore is not meshed as a film mesh is.
    """
    mechanism, bearing = settings.mechanism, settings.bearing
    if "pin" not in body.points:
        raise SettingsError("the body has no boundary point 'pin' for the piston")
    if body.frame == "clamped":
        raise SettingsError("the body was clamped when it was reduced, a rod must be free")
    check_sizes(settings, float(np.hypot(*body.points["pin"][:2, 0])), body.bore_radius)
    parameters = FilmParameters(
        film_mesh(settings.film, body),
        bearing.clearance,
        Lubricant(bearing.viscosity),
        rate=mechanism.crank_speed,
    )
    return SliderCrank(
        build_crank(mechanism),
        body,
        Film(parameters),
        mechanism.piston_mass,
        settings.rod.damping_time,
        settings.film.transfer,
        gas_force=build_gas_force(mechanism),
        friction=settings.film.friction,
    )


def check_sizes(settings: SliderCrankSettings, reach: float, bore_radius: float) -> None:
    """Refuse a crank too long for the rod and a clearance that is none of the bore's.

    Parameters
    ----------
    settings
        The scene.
    reach
        Length of the rod, from the bore's axis to the pin [m].
    bore_radius
        [m].

    Raises
    ------
    SettingsError
        Naming both sizes.
    """
    length = settings.mechanism.crank_length
    if not length < reach:
        raise SettingsError(
            f"mechanism.crank_length = {length:g} m must be below the rod's length of "
            f"{reach:g} m, or the crank cannot turn"
        )
    check_thin_film(settings.bearing.clearance, bore_radius)


def check_structure(settings: SliderCrankSettings, structure: Structure) -> None:
    """`check_sizes` for a rod that is meshed and not yet reduced; collective."""
    check_sizes(settings, rod_length(structure), structure.lubricated_bore.radius)


def check_before_reduction(settings: SliderCrankSettings) -> None:
    """Refuse at once what needs no reduced rod to be seen, tables of torque and gas force as well.

    Raises
    ------
    SettingsError
        As `step_control`, `starting_eccentricity` and those who read the tables.
    """
    step_control(settings, simulated_time(settings))
    starting_eccentricity(settings)
    build_crank(settings.mechanism)
    build_gas_force(settings.mechanism)


def step_control(
    settings: SliderCrankSettings, end: float, body: ReducedBody | None = None
) -> StepControl:
    """See `step_sizes`; with a body, of an order that its modes bear."""
    control = step_sizes(settings.time, settings.mechanism.crank_speed, end)
    if body is None:
        return control
    return with_stable_order(control, body.frequencies, settings.rod.damping_time)


def simulated_time(settings: SliderCrankSettings) -> float:
    """End of the run [s]."""
    return settings.mechanism.revolutions * 2 * np.pi / settings.mechanism.crank_speed


def starting_eccentricity(settings: SliderCrankSettings) -> np.ndarray:
    """Of the shaft in its bore, share of the clearance, shape (2,).

    Raises
    ------
    SettingsError
        The shaft would start in the bore's wall.
    """
    start = settings.start
    eccentricity = np.array([start.eccentricity_x, start.eccentricity_y])
    if not np.hypot(*eccentricity) < 1.0:
        raise SettingsError(
            f"start.eccentricity_x, _y = {eccentricity[0]:g}, {eccentricity[1]:g} lie on the "
            "bore or beyond: their length must be below 1"
        )
    return eccentricity


def initial_state(
    settings: SliderCrankSettings, machine: SliderCrank
) -> tuple[np.ndarray, np.ndarray]:
    """State and rate at time zero.

    Raises
    ------
    SettingsError
        From `starting_eccentricity`.
    """
    start = settings.start
    x, rate = np.zeros(machine.size), np.zeros(machine.size)
    # Coordinates are those of the bore relative to the shaft.
    x[:2] = -settings.bearing.clearance * starting_eccentricity(settings)
    rate[:2] = -start.velocity_x, -start.velocity_y
    return x, rate


def simulate(
    settings: SliderCrankSettings,
    body: ReducedBody,
    totals: Totals,
    record: Record | None = None,
    progress: Callable[[Totals, Step], None] | None = None,
    *,
    checkpoint: Callable[[Progress], None] | None = None,
    memory: Mapping[str, Any] | None = None,
) -> Totals:
    """Integrate the scene from its start, the slider at the far end.

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
    checkpoint
        Called after every recorded step with the run, whose `Progress.memory` can be stored.
    memory
        What was stored of an interrupted run of the same scene and body, to go on from.

    Returns
    -------
    Totals
        The object given.

    Raises
    ------
    FilmTooThinError
        The film fell below ``bearing.smallest_film``, after that step was recorded.
    """
    end = simulated_time(settings)
    control = step_control(settings, end, body)
    machine = build_mechanism(settings, body)
    start = initial_state(settings, machine)
    powers = machine.initial_powers(*start)
    run = Progress.begin(machine, body, settings.rod.damping_time, control, powers, totals, start)
    if memory is not None:
        run.restore(memory)
    march(
        machine,
        run,
        end,
        control,
        settings.bearing.smallest_film * settings.bearing.clearance,
        partial(_row, machine),
        Watchers(record, progress, checkpoint),
    )
    return totals


def _row(machine: SliderCrank, step: Step, powers: Powers) -> dict[str, Any]:
    """Columns of the history that only this machine has."""
    crank, angle = step.auxiliary.mechanism.crank, step.auxiliary.mechanism.angle
    row = {
        "eccentricity_x_m": -step.x[0],
        "eccentricity_y_m": -step.x[1],
        "rod_angle_rad": angle.angle,
        "rod_rate_rad_per_s": angle.rate,
    }
    if crank.along is not None:
        row |= {"crank_angle_rad": crank.angle, "crank_speed_rad_per_s": crank.speed}
    friction = machine.friction(step.auxiliary)
    if friction is not None:
        # Braking is positive, and the power that the shaft's turning in the bore puts into the oil.
        row["friction_torque_Nm"] = -friction.torque
        row["friction_power_W"] = -friction.torque * (crank.speed - angle.rate)
    return row
