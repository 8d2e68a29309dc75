"""What can be said of a run in advance: a measure of how wrong it is, and the most it may be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from extremes_rigid import RigidSliderCrank, balanced
from extremes_runs import START_ANGLE, START_SHARE, Reducer, Run, Workshop, changed, difference

from fenics_ehd.scenes.drive import build_gas_force
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

#: Factor between the tolerance of a run and that of the run which checks it.
TIGHTER = 30


@dataclass(frozen=True)
class Claim:
    """One thing expected of a run.

    Attributes
    ----------
    text
        What and why, in which ``{}`` stands for the limit.
    limit
        Largest value.
    measure
        The value, of workshop, settings and run.
    name
        Short, for the column of checks.
    """

    text: str
    limit: float
    measure: Callable[[Workshop, SliderCrankSettings, Run], float]
    name: str


def number(value: float) -> str:
    """A limit or a measured value in a few characters."""
    if value == 0.0:
        return "0"
    return f"{100 * value:.2g} %" if abs(value) >= 1e-4 else f"{value:.1e}"


def tighter(limit: float, reducer: Reducer | None = None) -> Claim:
    """Error of both curves, from the same run at a finer tolerance."""

    def measure(shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        fine = changed(settings, time__tolerance=settings.time.tolerance / TIGHTER)
        return max(difference(run, shop.run(fine, reducer), settings))

    return Claim(f"curves of tolerance / {TIGHTER} to {{}}", limit, measure, "tolerance")


def energy(limit: float) -> Claim:
    """Energy balance error."""
    return Claim(
        "energy balance to {}",
        limit,
        lambda _shop, _settings, run: run.totals.energy_error,
        "energy",
    )


def falls_below(text: str, limit: float, other: SliderCrankSettings, share: float) -> Claim:
    """Time at which another run's film first falls below a share of the clearance."""

    def measure(shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        uninterrupted = shop.run(other)
        below = uninterrupted.film < share * settings.bearing.clearance
        return abs(uninterrupted.times[np.argmax(below)] / run.times[-1] - 1)

    return Claim(text, limit, measure, "crossing")


def same_as(
    text: str, limit: float, other: SliderCrankSettings, reducer: Reducer | None = None
) -> Claim:
    """Curves of another scene of the same duration."""

    def measure(shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        return max(difference(run, shop.run(other, reducer), settings))

    return Claim(text, limit, measure, "other run")


def ends_as(
    text: str, limit: float, other: SliderCrankSettings, reducer: Reducer | None = None
) -> Claim:
    """The thinnest film of another scene at the end."""

    def measure(shop: Workshop, _settings: SliderCrankSettings, run: Run) -> float:
        return abs(run.film[-1] / shop.run(other, reducer).film[-1] - 1)

    return Claim(text, limit, measure, "end")


def squeezed(limit: float) -> Claim:
    """How far a false start velocity carries rod and piston before the film stops them.

    ``m v / d`` with the squeeze film of a short bearing on half of the bore,
    ``d = pi eta R B^3 / (2 c^3)``, short by a tenth for this width.
    """

    def measure(shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        body, bearing = shop.body(settings), settings.bearing
        usual = shop.run(changed(settings, start__velocity_x=0.0))
        mass = body.inertia.total_mass + settings.mechanism.piston_mass
        slimness = body.bore_radius * (body.bore_width / bearing.clearance) ** 3
        damping = 0.5 * np.pi * bearing.viscosity * slimness
        carried = run.eccentricity[0, -1] - usual.eccentricity[0, -1]
        return abs(carried * damping / (mass * settings.start.velocity_x) - 1)

    text = "carried by m v / d, d = pi eta R B^3 / (2 c^3) of a short bearing, to {}"
    return Claim(text, limit, measure, "m v / d")


def similar(limit: float) -> Claim:
    """The machine at 500 rad/s that has the same dimensionless equations.

    Inertia forces and with them pressures grow with the square of the speed, so that E does
    too, viscosity as the speed, and times shrink with it: then strains and gaps stay.
    """

    def measure(shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        factor = settings.mechanism.crank_speed / 500.0
        twin = changed(
            settings,
            mechanism__crank_speed=500.0,
            bearing__viscosity=settings.bearing.viscosity / factor,
            rod__youngs_modulus=settings.rod.youngs_modulus / factor**2,
            rod__damping_time=settings.rod.damping_time * factor,
            time__first_step=settings.time.first_step * factor,
            time__smallest_step=settings.time.smallest_step * factor,
        )
        other = shop.run(twin)
        scaled = Run(
            other.times / factor,
            other.pressure * factor**2,
            other.film,
            other.columns,
            other.totals,
            other.error,
            other.seconds,
        )
        return max(difference(run, scaled, settings))

    text = "curves of the similar machine at 500 rad/s (viscosity / s, E / s^2, zeta s) to {}"
    return Claim(text, limit, measure, "similarity")


def rigid_balance(limit: float) -> Claim:
    """A rigid rod's film under the load of a rigid mechanism, see `extremes_rigid`.

    Extremes over the run, after the start: where the shaft crosses the bore in a few degrees,
    what is left out there shifts the crossing, in proportion to the clearance.
    """

    def measure(shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        gas = build_gas_force(settings.mechanism)
        end = run.times[-1]
        times, pressure, film, _ = balanced(settings, shop.body(settings), end, gas)
        begin = min(START_SHARE * end, START_ANGLE / settings.mechanism.crank_speed)
        own, other = run.times >= begin, times >= begin
        return float(
            max(
                abs(run.pressure[own].max() / pressure[other].max() - 1),
                abs(run.film[own].min() / film[other].min() - 1),
            )
        )

    text = "peak pressure and thinnest film under the load of textbook mechanics to {}"
    return Claim(text, limit, measure, "textbook load")


def nested(limit: float) -> Claim:
    """The film solved within every evaluation, Newton's method by our own hand."""

    def measure(shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        return max(difference(run, shop.nested(settings), settings))

    return Claim("curves of the nested formulation to {}", limit, measure, "nested")


def textbook_crank(limit: float) -> Claim:
    """Angle of a free crank under a constant torque, against one equation of motion [rad]."""

    def measure(shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        mechanism = settings.mechanism
        machine = RigidSliderCrank(settings, shop.body(settings))
        angle = machine.driven(
            mechanism.crank_speed, mechanism.crank_inertia, mechanism.drive_torque, run.times
        )
        found = run.columns["crank_angle_rad"]
        return float(np.abs(found - angle).max() / np.ptp(angle))

    return Claim("crank angle of one textbook equation of motion to {}", limit, measure, "angle")


def reversed_crank() -> Claim:
    """The crank must have turned back: its last speed over its first, negative."""

    def measure(_shop: Workshop, _settings: SliderCrankSettings, run: Run) -> float:
        speed = run.columns["crank_speed_rad_per_s"]
        return float(speed[-1] / speed[0])

    return Claim("last speed over the first, below {}", -0.1, measure, "speed")


def periodic(limit: float, revolutions: int) -> Claim:
    """Peak pressure and thinnest film of every revolution but the first, against the second."""

    def measure(_shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        period = 2 * np.pi / settings.mechanism.crank_speed
        which = np.minimum((run.times / period).astype(int), revolutions - 1)
        extremes = np.array(
            [
                (run.pressure[which == k].max(), run.film[which == k].min())
                for k in range(1, revolutions)
            ]
        )
        return float(np.abs(extremes / extremes[0] - 1).max())

    return Claim("extremes of all later revolutions to {}", limit, measure, "periodic")


def same_end(limit: float) -> Claim:
    """For a run that ends early: the time at which it does, at a finer tolerance."""

    def measure(shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        fine = shop.run(changed(settings, time__tolerance=settings.time.tolerance / TIGHTER))
        if type(fine.error) is not type(run.error):
            return np.inf
        return float(abs(fine.times[-1] / run.times[-1] - 1)) if len(run.times) else 0.0

    return Claim(f"at the same time for tolerance / {TIGHTER} to {{}}", limit, measure, "end time")


def open_film() -> Claim:
    """Recorded films are all positive: minus the thinnest over the clearance."""

    def measure(_shop: Workshop, settings: SliderCrankSettings, run: Run) -> float:
        return float(-run.film.min() / settings.bearing.clearance)

    return Claim("no film without thickness recorded", 0.0, measure, "minus film / c")
