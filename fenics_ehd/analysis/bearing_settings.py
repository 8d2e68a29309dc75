"""Settings of one rigid bearing; the default values are those of the paper's Table 1.

Imports inside functions: `--help` must be quick, and needs no film modules.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import attrs

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.checks import as_tuple
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import (
    ambient_pressure,
    cavitation,
    count,
    film_element,
    film_meshes,
    flag,
    metres,
    number,
    pair,
    radial_clearance,
    shear_rule,
    viscosity,
)
from fenics_ehd.base.fields import speed as angular_speed
from fenics_ehd.base.needs import NO_TEMPERATURE, only_with
from fenics_ehd.base.settings import require_effects
from fenics_ehd.base.shared_settings import (
    ROUGH,
    OilSettings,
    Roughness,
    conducted_share,
    outlet_weight,
    supply_temperature,
)

if TYPE_CHECKING:
    from fenics_ehd.film.heat import Heat
    from fenics_ehd.film.kinematics import Shape
    from fenics_ehd.film.supply import AxialGroove

#: Default viscosity, that of the paper's oil [Pa s].
VISCOSITY = 0.01

#: Tolerance of the effective temperature [K].
TEMPERATURE_TOLERANCE = 1e-6

#: Largest number of cells of a mesh: such a mesh is solved in minutes.
MOST_CELLS = 100_000


@attrs.frozen
class BearingSettings(OilSettings, Roughness):
    """Settings of a bearing, its oil and the motion of its shaft.

    Directions refer to the load: x is along the load, y is a quarter turn from x in the direction
    of rotation, and z is along the axis, about which the shaft rotates in the positive sense.
    """

    radius: float = metres(0.0225, "radius R of the bore [m]")
    clearance: float = radial_clearance(17e-6)
    width: float = metres(0.022, "width B of the bearing [m]")
    viscosity: float = viscosity(VISCOSITY, "dynamic viscosity of the oil [Pa s]")
    speed: float = angular_speed(500.0, "angular speed of the shaft [rad/s]")
    bore_speed: float = angular_speed(0.0, "angular speed of the bore [rad/s], load at rest")
    tilt: tuple[float, float] = pair("tilt of the shaft about x and y [rad]")
    squeeze: tuple[float, float] = pair("velocity of the shaft's centre along x and y [m/s]")
    cells_around: int = count(64, "number of cells around the bore", 3)
    cells_along: int = count(12, "number of cells along the axis", 1)
    element: str = film_element()
    meshes: int = film_meshes()
    grooves: tuple[AxialGroove, ...] = attrs.field(default=(), converter=as_tuple)
    line_at_max_film: bool = flag(
        False,
        "whether p = 0 is imposed on the line of the maximum film, as in classical tables; for "
        "coefficients the line keeps its position when the shaft moves",
    )
    ambient: float = ambient_pressure()
    cavitation: str = cavitation()
    shear_rule: str = shear_rule()
    supply_temperature: float = supply_temperature(
        NO_TEMPERATURE,
        f"temperature of the supplied oil [C], from which the oil's effective temperature is "
        f"computed; {NO_TEMPERATURE:g}: not used",
    )
    conducted: float = only_with(
        conducted_share(
            "part of the dissipated power that shaft and bore conduct away, with supply_temperature"
        ),
        "supply_temperature",
    )
    mixing: float = only_with(outlet_weight(), "supply_temperature")
    contact_modulus: float = only_with(
        number(115e9, "1 / sum of (1 - nu^2) / E of both [Pa]", least=1e6, below=1e17),
        "roughness",
        words=ROUGH,
    )
    #: Shape of the bore, with angles from the load line; None for a round bore.
    bore_shape: Shape | None = None

    @property
    def heated(self) -> bool:
        """True if the temperature of the oil is computed from a heat balance."""
        return self.supply_temperature > NO_TEMPERATURE

    @property
    def heat(self) -> Heat:
        """Settings of the heat balance, which is computed if a supply temperature is set."""
        from fenics_ehd.film.heat import Heat

        return Heat(
            supply_temperature=self.supply_temperature,
            conducted_share=self.conducted,
            outlet_weight=self.mixing,
            tolerance=TEMPERATURE_TOLERANCE,
        )

    @property
    def oil(self) -> OilSettings:
        """Settings of the oil; if they have a grade, the default viscosity is not used."""
        values = {field.name: getattr(self, field.name) for field in attrs.fields(OilSettings)}
        if self.graded and self.viscosity == VISCOSITY:
            values["viscosity"] = 0.0
        return OilSettings(**values)

    def relative_shape(self, angle: float = 0.0) -> Shape:
        """Shape of the bore relative to a shaft without tilt.

        The tilt of the shaft is replaced by an equal and opposite misalignment of the bore. The
        frame of the shape is at `angle` from the load line [rad], which must be 0 for a bore that
        is not round.
        """
        from fenics_ehd.base.plane import rotation
        from fenics_ehd.film.kinematics import Shape

        shape = self.bore_shape or Shape()
        if not any(self.tilt):
            return shape
        tilt = shape.misalignment - rotation(-angle) @ self.tilt
        return attrs.evolve(shape, misalignment=tilt.tolist())

    @property
    def plain(self) -> bool:
        """True if the bearing is the same in all directions, except for load and eccentricity."""
        fixed = self.grooves or self.line_at_max_film or self.bore_shape is not None
        return not (fixed or any(self.tilt) or any(self.squeeze))

    def __attrs_post_init__(self) -> None:
        if self.cells_around * self.cells_along > MOST_CELLS:
            raise SettingsError(
                f"cells = {self.cells_around}x{self.cells_along}: the limit is {MOST_CELLS} cells"
            )
        # At this slope one end touches when the middle is centred.
        limit = 2 * self.clearance / self.width
        if not math.hypot(*self.tilt) < limit:
            raise SettingsError(
                f"tilt = {math.hypot(*self.tilt):g} rad closes the gap: it must be below "
                f"2 clearance / width = {limit:.4g} rad"
            )
        require_effects(self)
        self._check_classes()
        if self.cavitation == "mass-conserving":
            self._check_mass_conserving()
        if self.grooves and self.line_at_max_film:
            raise SettingsError(
                "grooves and line_at_max_film exclude each other: the line belongs to the plain "
                "bearing of the classical tables"
            )
        if self.bore_shape is not None and not self.bore_shape.round:
            self._check_shape()
        if self.grooves and self.speed and self.bore_speed:
            raise SettingsError(
                f"bore_speed = {self.bore_speed:g} rad/s with grooves: these belong to a part at "
                "rest, so that either speed or bore_speed must be 0"
            )
        self._check_entrainment()
        # Without rotation, the film's only force is resistance to the motion of the shaft.
        still = not (self.speed or self.bore_speed or any(g.pressure for g in self.grooves))
        if still and any(self.squeeze) and not self.squeeze[0] > 0:
            raise SettingsError(
                f"squeeze = {self.squeeze[0]:g}, {self.squeeze[1]:g} m/s at speed 0: its first "
                "component must be above 0, so that the shaft moves along the load"
            )

    def _check_entrainment(self) -> None:
        """Refuse speeds of shaft and bore whose sum is nearly zero.

        The pressure of the film is proportional to the sum of the speeds. Terms with the difference
        of the speeds are smaller by c / R, and lubrication theory neglects some of these terms.
        """
        least = self.clearance / self.radius * abs(self.speed - self.bore_speed)
        if abs(self.entrainment) < least and not any(self.squeeze):
            raise SettingsError(
                f"bore_speed = {self.bore_speed:g} rad/s and speed = {self.speed:g} rad/s draw in "
                f"no oil: their sum must be at least {least:.3g} rad/s, which is their difference "
                "times clearance / radius"
            )

    def _check_classes(self) -> None:
        """Refuse grooves and shapes that are not objects of their classes."""
        if self.grooves:
            from fenics_ehd.film.supply import AxialGroove

            require_class("grooves", self.grooves, tuple)
            for i, groove in enumerate(self.grooves):
                require_class(f"grooves[{i}]", groove, AxialGroove)
        if self.bore_shape is not None:
            from fenics_ehd.film.kinematics import require_shape

            require_shape("bore_shape", self.bore_shape)

    def _check_shape(self) -> None:
        """Refuse a bore that is not round if it rotates or if a zero-pressure line is imposed."""
        if self.line_at_max_film:
            raise SettingsError(
                "bore_shape and line_at_max_film exclude each other: the line belongs to the plain "
                "bearing of the classical tables"
            )
        if self.bore_speed:
            raise SettingsError(
                f"bore_speed = {self.bore_speed:g} rad/s with a bore_shape that is not round: the "
                "shape is at rest, so bore_speed must be 0"
            )

    def _check_mass_conserving(self) -> None:
        """Refuse mass-conserving cavitation without an oil supply, or with a moving shaft."""
        from fenics_ehd.film.oil_balance import require_monotone

        require_monotone(self.element, "element")
        if not (self.ambient or self.grooves) or self.line_at_max_film:
            raise SettingsError(
                "cavitation = 'mass-conserving' needs a supply, a groove or an ambient pressure "
                "above 0: without one, the bearing runs dry"
            )
        if any(self.squeeze):
            raise SettingsError(
                f"squeeze = {self.squeeze[0]:g}, {self.squeeze[1]:g} m/s: cavitation = "
                "'mass-conserving' computes the steady film of a shaft without squeeze: set "
                "squeeze to 0"
            )

    @property
    def entrainment(self) -> float:
        """Sum of the speeds of shaft and bore [rad/s]; half of it entrains the oil."""
        return self.speed + self.bore_speed

    @property
    def direction(self) -> int:
        """Sense of rotation of the shaft, 1 or -1; if the shaft is at rest, that of the bore."""
        return -1 if (self.speed or self.bore_speed) < 0 else 1
