"""Forces and moments of the film on shaft and bore.

On the bore the oil presses with ``p n`` (n = e_r, outward) and pulls with
``tau_2 t`` (t along the circumference, `fenics_ehd.film.shear`). The shaft lies
``h`` further in: its surface ``(R_2 - h) e_r + z e_z`` has the area element
``[(R_2 - h) e_r + dh/dphi e_phi] dphi dz`` in the plane, smaller than that of the
bore and inclined. Pressure on it gives, integrated by parts around the bore
(``d e_phi / dphi = -e_r``),

    -int p [(R_2 - h) e_r + dh/dphi e_phi] dphi dz = -int p n dA + int h dp/dy t dA

exactly, for the film is periodic; the ends leave no term, as their normal is
the axis. With ``tau_1 + tau_2 = -h dp/dy`` the two bodies then receive opposite
forces, and opposite moments about any one point, to round-off. A bore that lies ``delta`` outside
the round one is inclined too: ``delta dp/dy t`` of that is on the bore, the rest on the shaft. Left
out, smaller
by c / R like all that lubrication theory leaves out: the lever arm of the
shaft's shear is that of the bore, and tractions along the axis have no moments.

Moments are about the bore's centre at mid-width; the friction torque is the shaft's
moment about its own axis. By the same integration it is ``R_1 int tau_1 dA`` up to c / R.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.plane import rotation
from fenics_ehd.film.contact import FilmContact
from fenics_ehd.film.film import Film, FilmState
from fenics_ehd.film.kinematics import Gap, ShaftMotion
from fenics_ehd.film.shear import FilmFields, beside_drag, film_fields, sheared_heights


@dataclass(frozen=True, eq=False)
class Wrench:
    """Force in the plane, x and y [N], and moment about x, y, z at the bore's centre [N m]."""

    force: np.ndarray
    moment: np.ndarray

    def __add__(self, other: Wrench) -> Wrench:
        return Wrench(self.force + other.force, self.moment + other.moment)

    @property
    def reversed(self) -> Wrench:
        """What acts on the other body."""
        return Wrench(-self.force, -self.moment)

    def turned(self, angle: float) -> Wrench:
        """The same in a frame that is turned by ``-angle`` about z [rad]."""
        turn = rotation(angle)
        moment = np.append(turn @ self.moment[:2], self.moment[2])
        return Wrench(turn @ self.force, moment)


@dataclass(frozen=True, eq=False)
class FilmForces:
    """What the oil does to its two bodies.

    Attributes
    ----------
    pressure_on_shaft, shear_on_shaft, pressure_on_bore, shear_on_bore
        Their sum over both bodies is zero to round-off.
    friction_torque
        Moment of pressure and shear on the shaft about its own axis [N m],
        negative when it brakes a shaft that turns in the positive sense.
    power
        Mechanical power that shaft and bore put into the film [W].
    dissipation
        ``int theta eta U^2 / h + h^3 / (12 eta) |grad p|^2 dA`` [W]: the mechanical
        power and that of the oil supplied under pressure, less what flows
        out against an ambient pressure. Between rough surfaces with what contact loses.
    contact_on_bore
        Of touching asperities, on the shaft its opposite; None between smooth surfaces.
    """

    pressure_on_shaft: Wrench
    shear_on_shaft: Wrench
    pressure_on_bore: Wrench
    shear_on_bore: Wrench
    friction_torque: float
    power: float
    dissipation: float
    contact_on_bore: Wrench | None = None

    @property
    def on_shaft(self) -> Wrench:
        """Pressure and shear together, contact too."""
        oil, contact = self.pressure_on_shaft + self.shear_on_shaft, self.contact_on_bore
        return oil if contact is None else oil + contact.reversed

    @property
    def on_bore(self) -> Wrench:
        """Pressure and shear together, contact too."""
        oil, contact = self.pressure_on_bore + self.shear_on_bore, self.contact_on_bore
        return oil if contact is None else oil + contact


def film_forces(
    film: Film,
    state: FilmState,
    motion: ShaftMotion,
    shear_rule: str = "streamers",
    bore_deviation: np.ndarray | None = None,
) -> FilmForces:
    """Forces, moments and powers of a solved film.

    Parameters
    ----------
    film, state
        A film and its solution.
    motion
        Of the shaft, the one that the state's gap belongs to; the bore rigid.
    shear_rule
        For the cavitated zone, one of `fenics_ehd.film.shear.SHEAR_RULES`.
    bore_deviation
        Of a bore that is not round, at the Gauss points [m]; None: it is.
    """
    fields = film_fields(film, state, shear_rule)
    gap = state.gap
    thin, deep = sheared_heights(film, gap)
    couette = fields.filled * fields.viscosity * gap.sliding_velocity / thin
    poiseuille = 0.5 * deep * fields.slope_around
    on_bore, on_shaft = 0.0, deep * fields.slope_around
    if bore_deviation is not None:
        on_bore = bore_deviation * fields.slope_around
        on_shaft = on_shaft - on_bore
    pressure_on_bore = _wrench(film, fields.pressure, on_bore)
    pressure_on_shaft = _wrench(film, -fields.pressure, on_shaft)
    shear_on_bore = _wrench(film, 0.0, couette - poiseuille)
    shear_on_shaft = _wrench(film, 0.0, -couette - poiseuille)
    shaft, bore = pressure_on_shaft + shear_on_shaft, pressure_on_bore + shear_on_bore
    torque = _own_torque(shaft, motion)
    contact, rubbed = None, 0.0
    if film.parameters.surfaces is not None:
        contact, braking, rubbed = _contact(film, gap)
        shaft, bore, torque = shaft + contact.reversed, bore + contact, torque - braking
    power = -(
        shaft.force @ motion.eccentricity_rate
        + shaft.moment[:2] @ motion.tilt_rate
        + torque * motion.shaft_speed
        + bore.moment[2] * motion.bore_speed
    )
    return FilmForces(
        pressure_on_shaft,
        shear_on_shaft,
        pressure_on_bore,
        shear_on_bore,
        float(torque),
        float(power),
        _dissipation(film, state, fields, thin) + rubbed,
        contact,
    )


def _contact(film: Film, gap: Gap) -> tuple[Wrench, float, float]:
    """On the bore; torque with which it brakes the shaft [N m]; power that it loses [W].

    It acts on the shaft through its axis, but for the friction.
    """
    contact = FilmContact(film)
    touch, shape = contact.touch(gap.thickness), gap.thickness.shape
    normal, rubbing = touch.pressure, touch.pressure * contact.rubbing(gap)[0]
    wrench = _wrench(film, normal.reshape(shape), rubbing.reshape(shape))
    return wrench, contact.braking(touch, gap), contact.rubbing_power(touch, gap)


def _wrench(film: Film, normal: np.ndarray | float, tangential: np.ndarray | float) -> Wrench:
    """Resultants of tractions along n and t [Pa], at the Gauss points of the bore."""
    radius = film.parameters.grid.radius
    area = radius**2 * film.assembly.area
    cosine, sine = film.points.normal
    x, y = normal * cosine - tangential * sine, normal * sine + tangential * cosine
    height = film.points.height
    return Wrench(
        np.array([np.sum(area * x), np.sum(area * y)]),
        np.array(
            [
                -np.sum(area * height * y),
                np.sum(area * height * x),
                radius * np.sum(area * tangential),
            ]
        ),
    )


def _own_torque(shaft: Wrench, motion: ShaftMotion) -> float:
    """Moment about the shaft's tilted axis through its own centre."""
    x, y = motion.eccentricity
    about_centre = shaft.moment[2] - (x * shaft.force[1] - y * shaft.force[0])
    return about_centre + motion.tilt[1] * shaft.moment[0] - motion.tilt[0] * shaft.moment[1]


def _dissipation(film: Film, state: FilmState, fields: FilmFields, thin: np.ndarray) -> float:
    gap = state.gap
    sheared = fields.filled * fields.viscosity * gap.sliding_velocity**2 / thin
    if film.parameters.surfaces is not None:
        area = film.parameters.grid.radius**2 * film.assembly.area
        sheared = sheared + beside_drag(film, gap, fields)
        return float(np.sum(area * sheared)) + film.powers(state)[0]
    squared = fields.slope_around**2 + fields.slope_along**2
    driven = gap.thickness**3 / (12 * fields.viscosity) * squared
    area = film.parameters.grid.radius**2 * film.assembly.area
    return float(np.sum(area * (sheared + driven)))
