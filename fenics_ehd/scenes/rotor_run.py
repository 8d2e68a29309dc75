"""Run a rotor over its revolutions and record every step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.film import Film, FilmParameters, Lubricant
from fenics_ehd.multibody.bdf import Step, StepControl
from fenics_ehd.multibody.beam import Disk, Shaft, beam_plane
from fenics_ehd.multibody.dry_system import DrySystem, no_force
from fenics_ehd.multibody.energy import Powers
from fenics_ehd.multibody.rotor import ModalRotor, RotatingForce
from fenics_ehd.multibody.shaft_journal import ShaftJournal
from fenics_ehd.reduction import ReducedBody, Structure
from fenics_ehd.scenes.film_mesh import film_mesh
from fenics_ehd.scenes.rotor import Rotor
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.step_sizes import step_sizes
from fenics_ehd.scenes.thin_film import check_thin_film
from fenics_ehd.scenes.transient import Progress, Record, Totals, Watchers, march

#: Largest difference of shaft and bore, share of the bore's radius: the film has one radius.
FIT = 0.01


def build_rotor(settings: RotorSettings) -> ModalRotor:
    """Shaft and disk, reduced to the lowest modes.

    Raises
    ------
    SettingsError
        An odd number of modes, or more than the beam elements have.
    """
    given, disk = settings.shaft, settings.disk
    available = 4 * (given.elements + 1)
    if given.modes % 2 or given.modes > available:
        raise SettingsError(
            f"shaft.modes = {given.modes} must be even, half of them for either plane, and at "
            f"most {available}, the degrees of freedom of shaft.elements = {given.elements}"
        )
    shaft = Shaft(
        given.length,
        given.diameter,
        given.youngs_modulus,
        given.density,
        given.support_stiffness,
        given.elements,
    )
    rigid = Disk(disk.position, disk.mass, disk.polar_inertia, disk.diametral_inertia)
    return ModalRotor.of(beam_plane(shaft, [rigid]), given.modes // 2)


def rotor_system(settings: RotorSettings, rotor: ModalRotor) -> DrySystem:
    """The turning rotor under its force."""
    speed, force = settings.shaft.speed, settings.force
    turning = RotatingForce(force.amplitude, speed, force.ramp * 2 * np.pi / speed)
    return rotor.system(speed, settings.shaft.damping_ratio, turning, force.position)


def housing_system(body: ReducedBody, damping_time: float) -> DrySystem:
    """A clamped body with the structural damping ``D_e = zeta T^T K T``."""
    stiffness = body.stiffness
    return DrySystem(body.mass, damping_time * stiffness, stiffness, no_force(body.modes))


def build_mechanism(settings: RotorSettings, body: ReducedBody) -> Rotor:
    """Put rotor, housing and film together.

    Raises
    ------
    SettingsError
        The body is not clamped, the film not thin, the shaft not that of the bore, or its modes
        do not exist.
    InterfaceMismatchError
        The body's bore is not meshed as a film mesh is.
    """
    if body.frame != "clamped":
        raise SettingsError(
            f"the body's frame is {body.frame}: a housing must be held when it is reduced"
        )
    bearing = settings.bearing
    check_sizes(settings, body.bore_radius)
    rotor = build_rotor(settings)
    film = Film(
        FilmParameters(
            film_mesh(settings.film, body),
            bearing.clearance,
            Lubricant(bearing.viscosity),
            rate=settings.shaft.speed,
        )
    )
    damping_time = settings.housing.damping_time
    shaft = rotor.motion(bearing.position)
    journal = ShaftJournal(body, film, shaft, settings.film.transfer, damping_time)
    dry = rotor_system(settings, rotor).beside(housing_system(body, damping_time))
    return Rotor(dry, journal, settings.shaft.speed)


def check_sizes(settings: RotorSettings, bore_radius: float) -> None:
    """Refuse a shaft and a clearance that are not the bore's [m].

    Raises
    ------
    SettingsError
        Naming both sizes.
    """
    check_thin_film(settings.bearing.clearance, bore_radius)
    diameter = settings.shaft.diameter
    if not abs(0.5 * diameter - bore_radius) <= FIT * bore_radius:
        raise SettingsError(
            f"shaft.diameter = {diameter:g} m must be that of the bore, {2 * bore_radius:g} m, "
            f"within {100 * FIT:g} %: change it or housing.geometry"
        )


def check_structure(settings: RotorSettings, structure: Structure) -> None:
    """`check_sizes` for a housing that is meshed and not yet reduced."""
    check_sizes(settings, structure.lubricated_bore.radius)


def check_before_reduction(settings: RotorSettings) -> None:
    """Refuse at once what needs no reduced housing to be seen.

    Raises
    ------
    SettingsError
        As `build_rotor` and `step_control`.
    """
    build_rotor(settings)
    step_control(settings, simulated_time(settings))


def step_control(settings: RotorSettings, end: float) -> StepControl:
    """See `step_sizes`."""
    return step_sizes(settings.time, settings.shaft.speed, end)


def simulated_time(settings: RotorSettings) -> float:
    """End of the run [s]."""
    return settings.shaft.revolutions * 2 * np.pi / settings.shaft.speed


def simulate(
    settings: RotorSettings,
    body: ReducedBody,
    totals: Totals,
    record: Record | None = None,
    progress: Callable[[Totals, Step], None] | None = None,
    *,
    checkpoint: Callable[[Progress], None] | None = None,
    memory: Mapping[str, Any] | None = None,
) -> Totals:
    """Integrate the scene from its start: a straight, centred rotor that turns, all else at rest.

    Parameters
    ----------
    settings
        The scene.
    body
        Reduced housing.
    totals
        Updated step by step, so that an interrupted run keeps its figures.
    record
        Called with the history row and the fields of every accepted step.
    progress
        Called after every accepted step.
    checkpoint, memory
        As in `fenics_ehd.scenes.run.simulate`.

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
    control = step_control(settings, end)
    machine = build_mechanism(settings, body)
    run = Progress.begin(
        machine, body, settings.housing.damping_time, control, machine.initial_powers(), totals
    )
    if memory is not None:
        run.restore(memory)
    march(
        machine,
        run,
        end,
        control,
        settings.bearing.smallest_film * settings.bearing.clearance,
        lambda step, powers: _row(machine, step, powers),
        Watchers(record, progress, checkpoint),
    )
    return totals


def _row(machine: Rotor, step: Step, powers: Powers) -> dict[str, Any]:
    """Columns of the history that only this machine has."""
    journal = machine.journal
    peak = int(np.argmax(step.auxiliary.film.pressure))
    xi = step.x[: journal.coordinates]
    x, y = journal.centre @ xi
    tilt_x, tilt_y = journal.tilt @ xi
    return {
        "max_pressure_height_m": journal.film.parameters.grid.node_positions[peak, 1],
        "eccentricity_x_m": x,
        "eccentricity_y_m": y,
        "tilt_x_rad": tilt_x,
        "tilt_y_rad": tilt_y,
        "drive_W": powers.drive,
        "drag_W": powers.drag,
        "film_loss_W": powers.film,
        "damping_W": powers.damping,
    }
