"""What can be said of a run in advance: a measure of how wrong it is, and the most it may be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from extremes_rigid import RigidSliderCrank, balanced
from extremes_runs import Workshop, apart, begin, crank_speed
from scene_runs import TOLERANCE, Curves, Reduce, changed

from fenics_ehd.scenes.scene import Scene

#: Keys of the slider-crank.
SPEED, OIL = "drives.crank.speed", "lubricants.oil.viscosity"
CLEARANCE = "joints.big_end.clearance"
MODULUS, DAMPING = "bodies.rod.material.youngs_modulus", "bodies.rod.damping_time"
VELOCITY = "joints.big_end.eccentricity_rate"

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
        The value, of workshop, scene and run.
    name
        Short, for the column of checks.
    """

    text: str
    limit: float
    measure: Callable[[Workshop, Scene, Curves], float]
    name: str


def number(value: float) -> str:
    """A limit or a measured value in a few characters."""
    if value == 0.0:
        return "0"
    return f"{100 * value:.2g} %" if abs(value) >= 1e-4 else f"{value:.1e}"


def tighter(limit: float, reduce: Reduce | None = None) -> Claim:
    """Error of both curves, from the same run at a finer tolerance."""

    def measure(shop: Workshop, scene: Scene, run: Curves) -> float:
        fine = changed(scene, {TOLERANCE: scene.time.tolerance / TIGHTER})
        return max(apart(run, shop.run(fine, reduce), scene))

    return Claim(f"curves of tolerance / {TIGHTER} to {{}}", limit, measure, "tolerance")


def energy(limit: float) -> Claim:
    """Energy balance error."""
    return Claim(
        "energy balance to {}",
        limit,
        lambda _shop, _scene, run: run.figures["energy_balance_error"],
        "energy",
    )


def falls_below(text: str, limit: float, other: Scene, share: float) -> Claim:
    """Time at which another run's film first falls below a share of the clearance."""

    def measure(shop: Workshop, scene: Scene, run: Curves) -> float:
        uninterrupted = shop.run(other)
        below = uninterrupted.film < share * scene.joints["big_end"].clearance
        return abs(uninterrupted.times[np.argmax(below)] / run.times[-1] - 1)

    return Claim(text, limit, measure, "crossing")


def same_as(text: str, limit: float, other: Scene, reduce: Reduce | None = None) -> Claim:
    """Curves of another scene of the same duration."""

    def measure(shop: Workshop, scene: Scene, run: Curves) -> float:
        return max(apart(run, shop.run(other, reduce), scene))

    return Claim(text, limit, measure, "other run")


def ends_as(text: str, limit: float, other: Scene, reduce: Reduce | None = None) -> Claim:
    """The thinnest film of another scene at the end."""

    def measure(shop: Workshop, _scene: Scene, run: Curves) -> float:
        return abs(run.film[-1] / shop.run(other, reduce).film[-1] - 1)

    return Claim(text, limit, measure, "end")


def squeezed(limit: float) -> Claim:
    """How far a false start velocity carries rod and piston before the film stops them.

    ``m v / d`` with the squeeze film of a short bearing on half of the bore,
    ``d = pi eta R B^3 / (2 c^3)``, short by a tenth for this width.
    """

    def measure(shop: Workshop, scene: Scene, run: Curves) -> float:
        rod, bearing = shop.rod(scene), scene.joints["big_end"]
        (speed, _), usual = (
            bearing.eccentricity_rate,
            shop.run(changed(scene, {VELOCITY: [0.0, 0.0]})),
        )
        mass = rod.inertia.total_mass + scene.bodies["piston"].mass
        slimness = rod.bore.radius * (rod.bore.width / bearing.clearance) ** 3
        damping = 0.5 * np.pi * scene.lubricants["oil"].viscosity * slimness
        ends = (found.columns["eccentricity_x_m"][-1] for found in (run, usual))
        return abs(np.subtract(*ends) * damping / (mass * speed) - 1)

    text = "carried by m v / d, d = pi eta R B^3 / (2 c^3) of a short bearing, to {}"
    return Claim(text, limit, measure, "m v / d")


def similar(limit: float) -> Claim:
    """The machine at 500 rad/s that has the same dimensionless equations.

    Inertia forces and with them pressures grow with the square of the speed, so that E does
    too, viscosity as the speed, and times shrink with it: then strains and gaps stay.
    """

    def measure(shop: Workshop, scene: Scene, run: Curves) -> float:
        factor, time = crank_speed(scene) / 500.0, scene.time
        twin = {
            SPEED: 500.0,
            OIL: scene.lubricants["oil"].viscosity / factor,
            MODULUS: scene.bodies["rod"].material.youngs_modulus / factor**2,
            DAMPING: scene.bodies["rod"].damping_time * factor,
            "time.first_step": time.first_step * factor,
            "time.smallest_step": time.smallest_step * factor,
        }
        other = shop.run(changed(scene, twin))
        scales = {"time_s": 1 / factor, "max_pressure_Pa": factor**2, "min_film_thickness_m": 1.0}
        scaled = Curves({name: scale * other.columns[name] for name, scale in scales.items()})
        return max(apart(run, scaled, scene))

    text = "curves of the similar machine at 500 rad/s (viscosity / s, E / s^2, zeta s) to {}"
    return Claim(text, limit, measure, "similarity")


def rigid_balance(limit: float) -> Claim:
    """A rigid rod's film under the load of a rigid mechanism, see `extremes_rigid`.

    Extremes over the run, after the start: where the shaft crosses the bore in a few degrees,
    what is left out there shifts the crossing, in proportion to the clearance.
    """

    def measure(shop: Workshop, scene: Scene, run: Curves) -> float:
        times, pressure, film = balanced(shop.build(scene), run.times[-1])
        start = begin(scene, run.times[-1])
        own, other = run.times >= start, times >= start
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

    def measure(shop: Workshop, scene: Scene, run: Curves) -> float:
        return max(apart(run, shop.nested(scene), scene))

    return Claim("curves of the nested formulation to {}", limit, measure, "nested")


def textbook_crank(limit: float) -> Claim:
    """Angle of a free crank under a constant torque, against one equation of motion [rad]."""

    def measure(shop: Workshop, scene: Scene, run: Curves) -> float:
        machine = RigidSliderCrank(shop.build(scene))
        inertia, torque = scene.bodies["crank"].inertia, scene.drives["crank"].torque
        angle = machine.driven(crank_speed(scene), inertia, torque, run.times)
        found = run.columns["crank.angle_rad"]
        return float(np.abs(found - angle).max() / np.ptp(angle))

    return Claim("crank angle of one textbook equation of motion to {}", limit, measure, "angle")


def reversed_crank() -> Claim:
    """The crank must have turned back: its last speed over its first, negative."""

    def measure(_shop: Workshop, _scene: Scene, run: Curves) -> float:
        speed = run.columns["crank.speed_rad_per_s"]
        return float(speed[-1] / speed[0])

    return Claim("last speed over the first, below {}", -0.1, measure, "speed")


def periodic(limit: float, revolutions: int) -> Claim:
    """Peak pressure and thinnest film of every revolution but the first, against the second."""

    def measure(_shop: Workshop, scene: Scene, run: Curves) -> float:
        period = 2 * np.pi / crank_speed(scene)
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

    def measure(shop: Workshop, scene: Scene, run: Curves) -> float:
        fine = shop.run(changed(scene, {TOLERANCE: scene.time.tolerance / TIGHTER}))
        if type(fine.error) is not type(run.error):
            return np.inf
        return float(abs(fine.times[-1] / run.times[-1] - 1)) if len(run.times) else 0.0

    return Claim(f"at the same time for tolerance / {TIGHTER} to {{}}", limit, measure, "end time")


def open_film() -> Claim:
    """Recorded films are all positive: minus the thinnest over the clearance."""

    def measure(_shop: Workshop, scene: Scene, run: Curves) -> float:
        return float(-run.film.min() / scene.joints["big_end"].clearance)

    return Claim("no film without thickness recorded", 0.0, measure, "minus film / c")
