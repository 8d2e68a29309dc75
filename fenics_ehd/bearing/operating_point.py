"""One rigid bearing: equilibrium, forces, losses and dynamic coefficients.

The load acts on the shaft along x and is balanced by the film's pressure. Shear adds a
force of relative size c / R, the order that lubrication theory leaves out; it enters
the friction torque and the power, not the equilibrium. Against tables made with
``h = c (1 + eps cos(theta))``, loads differ by the ``e_t^2 / 2 R`` that the gap (4)
keeps: up to c / R.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from fenics_ehd.base.errors import SettingsError, VerificationError, ViscosityError
from fenics_ehd.bearing.coefficients import DynamicCoefficients, coefficients
from fenics_ehd.bearing.contact import ContactFigures
from fenics_ehd.bearing.equilibrium import NO_PRESSURE, at_eccentricity, at_load, carries
from fenics_ehd.bearing.film import BearingFilm, Operation
from fenics_ehd.bearing.heat import BearingHeat, balanced
from fenics_ehd.bearing.settings import BearingSettings
from fenics_ehd.bearing.thinnest import minimum_film
from fenics_ehd.film.flow import FlowBalance, flow_balance
from fenics_ehd.film.forces import FilmForces, film_forces
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.thickening import MOST_WITHIN_A_CELL, steepest_thickening

#: Points a direction at which the pressure is sampled between the nodes.
SAMPLES = 41


@dataclass(frozen=True, eq=False)
class BearingResult:
    """A bearing in equilibrium. None stands for what is not defined.

    Attributes
    ----------
    settings
        The bearing.
    load
        W, carried by the film's pressure [N].
    attitude
        From the load line to the line of centres, in direction of rotation [rad];
        None for a centred shaft or a film without pressure.
    max_pressure
        [Pa].
    max_pressure_angle
        From the maximum film, in direction of rotation, 0..2 pi [rad].
    min_film_thickness
        [m].
    eccentricity_ratio
        e / c at mid-width [-].
    sommerfeld_number
        ``eta N / p (R / c)^2`` with N in revolutions per second and ``p = W / (2 R B)`` [-].
    forces
        In the load's frame.
    flow
        Sides, supply and cavities [m3/s].
    friction_torque
        With which the film brakes the shaft, about its own axis [N m].
    power_loss
        Mechanical power that goes into the film [W].
    contact
        Of rough surfaces; None for smooth ones.
    coefficients
        Stiffness, damping and stability, if asked for.
    heat
        Temperatures, where they follow from that of the supply.
    bearing, operation
        The film and its solution.
    """

    settings: BearingSettings
    load: float
    attitude: float | None
    max_pressure: float
    max_pressure_angle: float | None
    min_film_thickness: float
    eccentricity_ratio: float
    sommerfeld_number: float | None
    forces: FilmForces
    flow: FlowBalance
    friction_torque: float
    power_loss: float
    contact: ContactFigures | None
    coefficients: DynamicCoefficients | None
    heat: BearingHeat | None
    bearing: BearingFilm
    operation: Operation

    @property
    def friction_coefficient(self) -> float | None:
        """Friction torque over load and radius of the bore."""
        return self.friction_torque / (self.settings.radius * self.load) if self.load else None

    @property
    def tilting_moment(self) -> np.ndarray:
        """Of the film on the shaft, about x and y at mid-width, shape (2,) [N m]."""
        return self.forces.on_shaft.turned(self.operation.angle).moment[:2]


def solve_bearing(
    settings: BearingSettings,
    *,
    eccentricity: float | None = None,
    load: float | None = None,
    with_coefficients: bool = False,
) -> BearingResult:
    """Operating point of a bearing.

    Parameters
    ----------
    settings
        The bearing.
    eccentricity, load
        Eccentricity ratio in 0..1 or load [N], exactly one of them.
    with_coefficients
        Whether to add stiffness, damping and the stability threshold.

    Raises
    ------
    SettingsError
        A value out of its limits, or no equilibrium for it.
    HeatError
        The heat cannot leave.
    CavitationError
        From `Film.solve`.
    ViscosityError
        The viscosity runs away with the pressure, or grows faster than the cells show.
    VerificationError
        A figure of the result is no finite number.
    """
    if (eccentricity is None) == (load is None):
        raise SettingsError("exactly one of eccentricity and load must be given")
    if eccentricity is not None:
        if not 0 <= eccentricity < 1:
            raise SettingsError(
                f"eccentricity = {eccentricity:g} must be at least 0 and below 1 (of the clearance)"
            )
    if load is not None and not 0 < load < np.inf:
        raise SettingsError(f"load = {load:g} N must be a finite number above 0")
    # What overflows is named below.
    with np.errstate(all="ignore"):
        heat = None
        if settings.heated:
            settings, heat, found = balanced(settings, lambda s: _operation(s, eccentricity, load))
        else:
            found = _operation(settings, eccentricity, load)
        _require_resolved(*found)
        result = _result(*found, with_coefficients, heat)
    unknown = [name for name, value in _figures("", result) if not np.isfinite(value).all()]
    if unknown:
        raise VerificationError(
            f"{', '.join(unknown)}: no finite number: is one of radius, clearance, width, "
            "viscosity, speed and pressures far from any bearing's?"
        )
    return result


def _require_resolved(bearing: BearingFilm, operation: Operation) -> None:
    """Refuse pressures that are the mesh's own: oil that thickens too much within a cell."""
    steepest = steepest_thickening(bearing.film, operation.state.pressure)
    if not steepest <= MOST_WITHIN_A_CELL:
        raise ViscosityError(
            f"the viscosity grows {steepest:.3g} times within a film cell, above "
            f"{MOST_WITHIN_A_CELL:g}: use more cells; where that does not help the viscosity runs "
            "away, lower load, eccentricity or the pressure coefficient (barus, roelands)"
        )


def _operation(
    settings: BearingSettings, eccentricity: float | None, load: float | None
) -> tuple[BearingFilm, Operation]:
    """Equilibrium at a given temperature."""
    if load is not None:
        return at_load(settings, load)
    assert eccentricity is not None
    return at_eccentricity(settings, eccentricity)


def _figures(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Numbers of a result by name, those of its parts too, without the film itself."""
    if isinstance(value, float | np.ndarray):
        yield name, value
    elif is_dataclass(value) and not isinstance(value, Operation):
        for field in fields(value):
            yield from _figures(field.name, getattr(value, field.name))


def _result(
    bearing: BearingFilm,
    operation: Operation,
    with_coefficients: bool,
    heat: BearingHeat | None,
) -> BearingResult:
    settings = bearing.settings
    load = float(np.hypot(*operation.force)) if carries(bearing, operation) else 0.0
    forces = film_forces(
        bearing.film, operation.state, operation.motion, settings.shear_rule, bearing.outside
    )
    pressure, pressure_angle = _peak(bearing, operation)
    mean = load / (2 * settings.radius * settings.width)
    revolutions = abs(settings.speed) / (2 * np.pi)
    ratio = settings.radius / settings.clearance
    viscosity = bearing.film.parameters.lubricant.viscosity
    return BearingResult(
        settings=settings,
        load=load,
        attitude=_attitude(operation) if load else None,
        max_pressure=pressure,
        max_pressure_angle=pressure_angle,
        min_film_thickness=minimum_film(settings, operation.position),
        eccentricity_ratio=float(np.hypot(*operation.position)) / settings.clearance,
        sommerfeld_number=viscosity * revolutions / mean * ratio**2 if load else None,
        forces=forces,
        flow=flow_balance(bearing.film, operation.state),
        # The frame is chosen so that the shaft turns in the positive sense.
        friction_torque=0.0 - forces.friction_torque,
        power_loss=0.0 + forces.power,
        contact=bearing.contact_figures(operation),
        coefficients=coefficients(bearing, operation) if with_coefficients else None,
        heat=heat,
        bearing=bearing,
        operation=operation,
    )


def _attitude(operation: Operation) -> float | None:
    """Angle from the load line to the line of centres [rad], None for a centred shaft."""
    x, y = operation.position
    return float(np.arctan2(y, x)) if x or y else None


def _peak(bearing: BearingFilm, operation: Operation) -> tuple[float, float | None]:
    """Largest pressure, between the nodes too, and its angle from the maximum film."""
    grid, nodal = bearing.film.parameters.grid, operation.state.pressure
    highest = float(nodal.max())
    if not highest > NO_PRESSURE * bearing.film.parameters.pressure_scale:
        return 0.0, None
    angle, height = grid.node_positions[int(np.argmax(nodal))]
    ranges = _neighbours(grid, angle, height)
    for _ in range(2):  # the second time around the best of the first
        axes = [np.linspace(low, high, SAMPLES) for low, high in ranges]
        a, z = (mesh.ravel() for mesh in np.meshgrid(*axes))
        values = grid.interpolation(a, z) @ nodal
        best = int(np.argmax(values))
        highest, angle, height = float(values[best]), float(a[best]), float(z[best])
        steps = [(high - low) / (SAMPLES - 1) for low, high in ranges]
        ranges = [
            (max(low, x - step), min(high, x + step))
            for x, step, (low, high) in zip((angle, height), steps, ranges, strict=True)
        ]
    if not np.any(operation.position):
        return highest, None
    # Position and pressure in the mesh's frame.
    centre = np.arctan2(operation.motion.eccentricity[1], operation.motion.eccentricity[0])
    return highest, float(np.mod(angle - centre - np.pi, 2 * np.pi))


def _neighbours(grid: FilmGrid, angle: float, height: float) -> list[tuple[float, float]]:
    """Next cell boundaries on both sides of a point, around and along."""
    ahead = np.mod(grid.angles - angle, 2 * np.pi)
    behind = np.mod(angle - grid.angles, 2 * np.pi)
    slack = 1e-9
    heights = grid.heights
    return [
        (angle - behind[behind > slack].min(), angle + ahead[ahead > slack].min()),
        (
            float(heights[heights < height].max(initial=heights[0])),
            float(heights[heights > height].min(initial=heights[-1])),
        ),
    ]
