"""Where the shaft of a bearing runs: the film's pressure on it opposes a load along x.

With the push on the bore written as a complex number, ``-F = W exp(i delta)``, the
search works on its logarithm ``ln W + i delta``. Newton's method takes that well from
light loads to eccentricity 0.999: the attitude turns delta, the eccentricity moves
ln W. Steps stay inside the bearing and are halved until they gain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.errors import GapClosedError, SettingsError, SolverError
from fenics_ehd.bearing.contact import surfaces_of
from fenics_ehd.bearing.film import BearingFilm, Operation
from fenics_ehd.bearing.settings import BearingSettings
from fenics_ehd.bearing.thinnest import minimum_film, require_open

#: Relative error of the load, and error of its direction [rad], at which a search ends.
TOLERANCE = 1e-9

MAX_STEPS = 60
MAX_HALVINGS = 14

#: Largest share of the smallest film thickness that a step may use up.
THINNING = 0.8

#: Longest step, in clearances or radians.
LONGEST_STEP = 1.0

#: A load that needs a film thinner than this share of the clearance is refused: accuracy was
#: measured up to eccentricity 0.999.
THINNEST_FILM = 5e-4

#: Below this share of the largest pressure, times the area, a force is round-off.
ROUND_OFF = 1e-11

#: So is a pressure below this share of ``12 eta Omega (R / c)^2``.
NO_PRESSURE = 1e-13

#: Direction error [rad] allowed where no attitude can correct it.
STRAIGHT = 1e-6


@dataclass(frozen=True, eq=False)
class _Search:
    """Unknowns of a search and the equations for them.

    Attributes
    ----------
    place
        Eccentricity [m] for the unknowns, shape (k,) -> (2,).
    tangent
        Its derivative, shape (k,) -> (2, k).
    load
        The load [N], or None when only its direction counts.
    """

    place: Callable[[np.ndarray], np.ndarray]
    tangent: Callable[[np.ndarray], np.ndarray]
    load: float | None

    def defect(self, operation: Operation) -> np.ndarray:
        """``delta``, after ``ln(W / load)`` if there is a load."""
        push = -operation.force
        strength = float(np.hypot(*push))
        if not strength > 0:
            raise _NoForceError("the film carries nothing")
        direction = float(np.arctan2(push[1], push[0]))
        if self.load is None:
            return np.array([direction])
        return np.array([np.log(strength / self.load), direction])

    def newton_step(
        self, bearing: BearingFilm, operation: Operation, unknowns: np.ndarray, defect: np.ndarray
    ) -> np.ndarray:
        """Change of the unknowns that Newton's method proposes, not too long."""
        push = complex(*-operation.force)
        change = -(bearing.derivatives(operation)[0] @ self.tangent(unknowns))
        logarithm = (change[0] + 1j * change[1]) / push
        rows = np.array([logarithm.real, logarithm.imag])[2 - len(defect) :]
        if not np.isfinite(rows).all():
            raise SolverError(_failure(bearing.settings, self, operation))
        step = -np.linalg.lstsq(rows, defect, rcond=None)[0]
        longest = LONGEST_STEP * (bearing.settings.clearance if self.load is not None else 1.0)
        return step * min(1.0, longest / max(float(np.linalg.norm(step)), 1e-300))


class _NoForceError(SolverError):
    """Nothing to turn or to scale: the film has no pressure anywhere."""


def at_eccentricity(settings: BearingSettings, ratio: float) -> tuple[BearingFilm, Operation]:
    """Operation at an eccentricity ratio in 0..1, the attitude found.

    A film without pressure is returned with whatever attitude.

    Raises
    ------
    SettingsError
        No attitude puts the force on the load line, or the shaft touches the bore.
    """
    distance = ratio * settings.clearance

    def place(unknowns: np.ndarray) -> np.ndarray:
        return distance * np.array([np.cos(unknowns[0]), np.sin(unknowns[0])])

    def tangent(unknowns: np.ndarray) -> np.ndarray:
        return distance * np.array([[-np.sin(unknowns[0])], [np.cos(unknowns[0])]])

    _check_squeeze(settings)
    if not ratio:
        return _centred(settings)
    starts = [np.array([angle]) for angle in _open_attitudes(settings, place)]
    try:
        return _first_success(settings, _Search(place, tangent, None), starts)
    except _NoForceError:
        bearing = BearingFilm(settings, place(starts[0]))
        return bearing, bearing.operate(place(starts[0]))


def at_load(settings: BearingSettings, load: float) -> tuple[BearingFilm, Operation]:
    """Operation under a load above 0 [N].

    Raises
    ------
    SettingsError
        The film carries no such load.
    """
    _check_squeeze(settings)
    if settings.bore_shape is not None:
        require_open(settings)
    first = _expected_attitude(settings)
    direction = np.array([np.cos(first), np.sin(first)])
    starts = minimum_film(settings, np.zeros(2)) * np.outer([0.6, 0.2, -0.3], direction)
    try:
        return _first_success(settings, _Search(lambda e: e, lambda e: np.eye(2), load), starts)
    except _NoForceError:
        raise SettingsError(
            f"load = {load:g} N: the film has no pressure at speed = {settings.speed:g} rad/s, "
            f"squeeze = {settings.squeeze[0]:g}, {settings.squeeze[1]:g} m/s"
        ) from None


def _expected_attitude(settings: BearingSettings) -> float:
    """First guess: ahead of the load when something turns, else where the squeeze goes."""
    entrainment = settings.direction * (settings.speed + settings.bore_speed)
    if entrainment:
        return float(np.copysign(np.radians(50.0), entrainment))
    return float(np.arctan2(settings.squeeze[1], settings.squeeze[0]))


def _open_attitudes(
    settings: BearingSettings, place: Callable[[np.ndarray], np.ndarray]
) -> list[float]:
    """Attitudes to start from, those that leave a film, the likeliest first [rad].

    Raises
    ------
    SettingsError
        The shaft touches the bore at every attitude.
    """
    first = _expected_attitude(settings)
    # Across the way that the tilted shaft's ends go there is most room.
    across = np.arctan2(settings.tilt[1], settings.tilt[0])
    turns = np.radians([0, 90, -90, 180])
    message = ""
    found = []
    for angle in [*(first + turns), across, across + np.pi]:
        try:
            minimum_film(settings, place(np.array([angle])))
            found.append(float(angle))
        except GapClosedError as error:
            message = str(error)
    if not found:
        raise SettingsError(f"eccentricity and tilt close the gap at every attitude: {message}")
    return found


def _check_squeeze(settings: BearingSettings) -> None:
    """A film at rest but for the squeeze only resists: it cannot push the shaft along."""
    still = not (settings.speed or settings.bore_speed)
    supplied = any(groove.pressure for groove in settings.grooves)
    if still and not supplied and any(settings.squeeze) and not settings.squeeze[0] > 0:
        raise SettingsError(
            f"squeeze = {settings.squeeze[0]:g}, {settings.squeeze[1]:g} m/s at speed 0: the shaft "
            "must move along the load, the first must be above 0"
        )


def _centred(settings: BearingSettings) -> tuple[BearingFilm, Operation]:
    """At eccentricity zero, where there is no attitude that could turn the force."""
    bearing = BearingFilm(settings, np.zeros(2))
    operation = bearing.operate(np.zeros(2))
    push = -operation.force
    if carries(bearing, operation) and abs(np.arctan2(push[1], push[0])) > STRAIGHT:
        raise SettingsError(
            "eccentricity = 0: the film's force is "
            f"{np.degrees(np.arctan2(push[1], push[0])):.4g} degrees off the load line and no "
            "attitude can turn it: change squeeze or grooves"
        )
    return bearing, operation


def _first_success(
    settings: BearingSettings, search: _Search, starts: Iterable[np.ndarray]
) -> tuple[BearingFilm, Operation]:
    """Search from one start after the other; the first error counts when all of them fail."""
    errors: list[SolverError] = []
    for start in starts:
        try:
            return _solve(settings, search, start)
        except SolverError as error:
            errors.append(error)
    raise errors[0]


def _solve(
    settings: BearingSettings, search: _Search, unknowns: np.ndarray
) -> tuple[BearingFilm, Operation]:
    """Newton's method; the mesh is made anew when the gap has changed much."""
    bearing = BearingFilm(settings, search.place(unknowns))
    operation = bearing.operate(search.place(unknowns))
    for _ in range(MAX_STEPS):
        defect = search.defect(operation)
        if np.linalg.norm(defect) < TOLERANCE:
            return bearing, operation
        _check_room(settings, search, operation, defect)
        step = search.newton_step(bearing, operation, unknowns, defect)
        unknowns, operation = _shortened(bearing, search, unknowns, operation, step)
        if not bearing.suits(operation.position):
            bearing = BearingFilm(settings, operation.position)
            operation = bearing.operate(operation.position)
    raise SolverError(_failure(settings, search, operation))


def _shortened(
    bearing: BearingFilm,
    search: _Search,
    unknowns: np.ndarray,
    operation: Operation,
    step: np.ndarray,
) -> tuple[np.ndarray, Operation]:
    """Halve a step until it keeps a film and gains."""
    before = np.linalg.norm(search.defect(operation))
    thinnest = _thinnest(bearing.settings, minimum_film(bearing.settings, operation.position))
    failure: SolverError = SolverError(_failure(bearing.settings, search, operation))
    for _ in range(MAX_HALVINGS):
        trial = search.place(unknowns + step)
        try:
            if minimum_film(bearing.settings, trial) >= thinnest:
                result = bearing.operate(trial, operation.state)
                if np.linalg.norm(search.defect(result)) < before:
                    return unknowns + step, result
        except (GapClosedError, _NoForceError):
            pass
        except SolverError as error:
            failure = error
        step = 0.5 * step
    raise failure


def _thinnest(settings: BearingSettings, film: float) -> float:
    """Film that a step may leave of one."""
    surfaces = surfaces_of(settings)
    if surfaces is None:
        return (1 - THINNING) * film
    return film - THINNING * float(surfaces.length(np.array(film)))


def _check_room(
    settings: BearingSettings, search: _Search, operation: Operation, defect: np.ndarray
) -> None:
    """Refuse a load that no film of a trustworthy thickness balances."""
    thinnest = minimum_film(settings, operation.position)
    if surfaces_of(settings) is not None:  # which carry any load, up to where they are described
        return
    if search.load is None or thinnest >= THINNEST_FILM * settings.clearance:
        return
    if defect[0] > 0:  # thin where it carries too much: on the way to nowhere
        raise SolverError(_failure(settings, search, operation))
    raise SettingsError(
        f"load = {search.load:g} N is too high: a film of {THINNEST_FILM:g} clearance, the "
        f"thinnest allowed, carries {np.hypot(*operation.force):.4g} N"
    )


def _failure(settings: BearingSettings, search: _Search, operation: Operation) -> str:
    push = -operation.force
    ratio = float(np.linalg.norm(operation.position)) / settings.clearance
    wanted = f"load = {search.load:g} N" if search.load is not None else f"eccentricity = {ratio:g}"
    return (
        f"{wanted}: no equilibrium found; at eccentricity {ratio:.4g} the film carries "
        f"{np.hypot(*push):.4g} N, {np.degrees(np.arctan2(push[1], push[0])):.4g} degrees off the "
        "load line"
    )


def carries(bearing: BearingFilm, operation: Operation) -> bool:
    """Whether the force is more than round-off of the pressures it is the sum of."""
    film = bearing.film
    least = (
        ROUND_OFF * operation.state.pressure.max() + NO_PRESSURE * film.parameters.pressure_scale
    )
    area = bearing.settings.radius * bearing.settings.width
    return float(np.hypot(*operation.force)) > least * area
