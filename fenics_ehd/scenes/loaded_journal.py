"""Parts of the loaded-journal scene: load, film, shaft, steps."""

from __future__ import annotations

import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.film import Film, FilmParameters, Lubricant, ShaftMotion, uniform_grid
from fenics_ehd.film.grid import aligned_grid
from fenics_ehd.film.supply import AxialGroove, Sides
from fenics_ehd.multibody.bdf import StepControl
from fenics_ehd.multibody.massless_journal import MasslessJournal
from fenics_ehd.multibody.starved_journal import StarvedJournal
from fenics_ehd.scenes.engine_load import engine_load
from fenics_ehd.scenes.load_history import LoadHistory, read_load
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings
from fenics_ehd.scenes.thin_film import check_thin_film

#: Name of the built-in load.
BUILT_IN_LOAD = "single-cylinder"


def build_load(settings: LoadedJournalSettings) -> LoadHistory:
    """Load of the scene.

    Raises
    ------
    SettingsError
        From `read_load`, or the built-in load meets a speed it is not made for.
    """
    load, speed = settings.load, settings.bearing.shaft_speed
    if load.file != BUILT_IN_LOAD:
        return read_load(
            load.file, scale=load.scale, interpolation=load.interpolation, period=load.period
        )
    if not speed > 0:
        raise SettingsError(
            f"bearing.shaft_speed = {speed:g} rad/s must be above 0 for load.file = "
            f"{BUILT_IN_LOAD!r}, that of a running engine"
        )
    if load.period:
        raise SettingsError(
            f"load.period = {load.period:g} s must be 0 for load.file = {BUILT_IN_LOAD!r}: "
            "its period is two revolutions"
        )
    return engine_load(speed, scale=load.scale, interpolation=load.interpolation)


def build_film(settings: LoadedJournalSettings, period: float) -> Film:
    """Film of the bearing.

    Raises
    ------
    SettingsError
        The film is not thin, or the grooves cannot be used.
    """
    bearing = settings.bearing
    check_thin_film(bearing.clearance, bearing.radius)
    if bearing.grooves and bearing.bore_speed:
        raise SettingsError(
            f"bearing.bore_speed = {bearing.bore_speed:g} rad/s must be 0 with bearing.grooves: "
            "they stay where they are in the frame of the load"
        )
    grooves = tuple(
        AxialGroove(np.radians(angle), np.radians(width), pressure)
        for angle, width, pressure in bearing.grooves
    )
    around, along = settings.film.cells
    grid = uniform_grid(bearing.radius, bearing.width, (around, along), settings.film.element)
    grid = aligned_grid(grid, np.array([edge for groove in grooves for edge in groove.edges]))
    parameters = FilmParameters(
        grid=grid,
        clearance=bearing.clearance,
        lubricant=Lubricant(bearing.viscosity),
        rate=max(abs(bearing.shaft_speed), abs(bearing.bore_speed), 2 * np.pi / period),
        sides=Sides(bearing.ambient_pressure, bearing.ambient_pressure),
        regions=grooves,
    )
    return Film(parameters)


def build_journal(settings: LoadedJournalSettings, load: LoadHistory) -> MasslessJournal:
    """Put film, load and speeds together.

    Raises
    ------
    SettingsError
        From `build_film`, or the film cannot conserve its oil.
    """
    film = build_film(settings, load.period)
    bearing = settings.bearing
    speeds = ShaftMotion(np.zeros(2), bearing.shaft_speed, bore_speed=bearing.bore_speed)
    if settings.film.cavitation == "reynolds":
        return MasslessJournal(film, load, speeds)
    if not (bearing.ambient_pressure or any(pressure for *_, pressure in bearing.grooves)):
        raise SettingsError(
            "bearing.grooves: film.cavitation = 'mass-conserving' needs a supply of oil, a groove "
            "with a pressure above 0, or bearing.ambient_pressure above 0"
        )
    return StarvedJournal(film, load, speeds)


def start_of(settings: LoadedJournalSettings) -> np.ndarray:
    """Eccentricity at the start [m].

    Raises
    ------
    SettingsError
        The shaft would touch the bore.
    """
    ratio = np.array([settings.start.eccentricity_x, settings.start.eccentricity_y])
    if not np.hypot(*ratio) < 1:
        raise SettingsError(
            f"start.eccentricity_x, _y = {ratio[0]:g}, {ratio[1]:g}: together "
            f"{np.hypot(*ratio):.4g}, they must stay below 1"
        )
    return settings.bearing.clearance * ratio


def step_control(settings: LoadedJournalSettings, period: float) -> StepControl:
    """Step sizes for one period [s].

    A film that conserves its oil is integrated with order 1, or the estimated error
    would not be that of its steps, see `fenics_ehd.multibody.starved_journal`.

    Raises
    ------
    SettingsError
        The smallest step is not the smallest.
    """
    time = settings.time
    largest = time.largest_step * period
    for name, value in (("time.first_step", time.first_step), ("time.largest_step", largest)):
        if not time.smallest_step < value:
            raise SettingsError(
                f"time.smallest_step = {time.smallest_step:g} s must be below {name} = {value:g} s"
            )
    order = time.order if settings.film.cavitation == "reynolds" else 1
    return StepControl(time.tolerance, time.first_step, time.smallest_step, largest, order)
