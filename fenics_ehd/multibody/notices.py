"""Notices about values that are probably mistakes, one line each.

Notices about a mechanism:

- a centre of mass or a moment of inertia that does not fit its body, perhaps in a wrong unit. For a
  part it is compared with the part's radius of gyration, for a rigid body with the extent of its
  points.
- a measured shape with a step.

Notices about the pressures of a run:

- a peak above the strength of any lining, or a pressure that is only round-off;
- a peak in a single step, or the first swing of an oscillation after the start.

Notices about the oil of a run:

- more oil leaves a film at its sides than its supplies feed, which the Reynolds condition permits.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fenics_ehd.film.kinematics import OVERSHOOT, Shape
from fenics_ehd.multibody.body import Body, FlexibleBody, RigidBody
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import System

#: Largest distance of a given centre of mass from that of the part, over the part's radius of
#: gyration. Beyond it the centre lies outside the part: for the end of a uniform bar it is 1.73.
OUTSIDE = 2.0

#: Largest ratio of the given and the computed radius of gyration of a part: counterweights and
#: bolts change it by less.
LIKE = 3.0

#: Largest radius of gyration of a rigid body, or distance of its centre of mass from the origin,
#: over the largest distance of its points: a flywheel on a crank has 5.
REACHES = 10.0


#: Flow out of the sides over the flow of the supplies, above which the oil that is not fed decides
#: film and flow: with 14 the film of a big end was 30 % too thick.
UNFED = 2.0


def unfed_film(name: str, side: float, fed: float) -> list[str]:
    """Notice of a film without mass conservation from which more oil flows than is fed.

    Parameters
    ----------
    name
        Name of the joint.
    side, fed
        Mean flow out of the sides, and mean flow of the supplies [m^3/s].
    """
    if not side > UNFED * fed > 0.0:
        return []
    return [
        f"joints.{name}: {1e6 * side:.3g} cm3/s of oil leave the film at its sides, but its "
        f"supplies feed {1e6 * fed:.3g} cm3/s: the Reynolds condition does not conserve oil, so "
        "that film and flow may be too large: compare with cavitation = 'mass-conserving'"
    ]


def unusual_totals(bodies: Mapping[str, Body]) -> list[str]:
    """Notices, one line each, of centres of mass and moments of inertia that do not fit a body."""
    lines = []
    for name, body in bodies.items():
        if isinstance(body, FlexibleBody) and not body.held:
            lines += _of_part(f"bodies.{name}", body)
        elif isinstance(body, RigidBody):
            lines += _of_rigid(f"bodies.{name}", body)
    return lines


def _of_part(key: str, body: FlexibleBody) -> list[str]:
    measured = body.reduced.inertia
    gyration = float(np.sqrt(max(measured.polar_inertia, 0.0) / measured.total_mass))
    lines = []
    if body.centre is not None:
        distance = float(np.hypot(*(np.array(body.centre) - measured.centre_of_mass)))
        if distance > OUTSIDE * gyration:
            lines.append(
                f"{key}.centre = {list(body.centre)} m is {distance:.3g} m from the centre of mass "
                f"of the part, more than {OUTSIDE:g} radii of gyration ({gyration:.3g} m), "
                "outside the part: check the unit"
            )
    if body.inertia is not None:
        radius = float(np.sqrt(body.inertia / (body.mass or measured.total_mass)))
        if not gyration / LIKE <= radius <= LIKE * gyration:
            lines.append(
                f"{key}.inertia = {body.inertia:g} kg m2 is a radius of gyration of {radius:.3g} "
                f"m, that of the part is {gyration:.3g} m: check the unit"
            )
    return lines


def _of_rigid(key: str, body: RigidBody) -> list[str]:
    limit = REACHES * body.reach
    if not limit or not body.mass:
        return []
    lines = []
    distance = float(np.hypot(*body.centre))
    radius = float(np.sqrt(body.inertia / body.mass))
    if distance > limit:
        lines.append(
            f"{key}.centre = {list(body.centre)} m is more than {REACHES:g} times as far from the "
            f"origin as any point of the body ({body.reach:.3g} m): check the unit"
        )
    if radius > max(limit, distance):
        lines.append(
            f"{key}.inertia = {body.inertia:g} kg m2 gives a radius of gyration of {radius:.3g} m, "
            f"but the body's points lie within {body.reach:.3g} m of the origin: check the unit"
        )
    return lines


def stepped_shapes(joints: Mapping[str, object]) -> list[str]:
    """Notices, one line each, of measured shapes whose spline would overshoot the measured rows."""
    lines = []
    for name, joint in joints.items():
        if isinstance(joint, LubricatedJoint):
            lines += stepped_shape(f"joints.{name}.bore_shape", joint.bore_shape)
            lines += stepped_shape(f"joints.{name}.journal_shape", joint.journal_shape)
    return lines


def stepped_shape(key: str, shape: Shape | None) -> list[str]:
    """Notice of a measured shape whose spline would overshoot the measured rows; else empty."""
    table = getattr(shape, "measured", None)
    if table is None or not table.stepped.any():
        return []
    beyond = 1e6 * table.overshoot.max()
    span = 1e6 * np.ptp(table.deviations)
    return [
        f"{key}.table: a spline would overshoot its rows by {beyond:.3g} um, more than "
        f"{100 * OVERSHOOT:g} % of their range of {span:.3g} um: a monotone curve is used instead; "
        "give more rows at the step of the surface for a smooth one"
    ]


#: Pressure above which a notice is given [Pa]. Bearing metals yield far below; pressures above it
#: occur between gears and rollers, whose solids are not modelled.
HIGHEST = 1e9

#: Largest pressure over the film's pressure scale below which the pressure is only round-off.
RESTING = 1e-6

#: Ratio of the largest pressure to the larger pressure of the steps before and after it, above
#: which it is a spike. In the ten shipped scenes the ratio is 1.0002 to 1.005, and for no step
#: above 1.022; in the starved journal it is 1.29, and 1.63 while the journal fills. For a peak of
#: 858 MPa between 1.6 MPa it is 536.
SPIKE = 5.0

#: Number of decreasing swings after the peak by which a start that rings is recognised.
#: In `slider-crank` without damping, started with the velocities of a rigid rod, the swings after a
#: peak of 73 MPa are 47, 30, 26 and 15 MPa, while the peak without oscillation is 47 MPa. With
#: damping, and in shipped scenes, there are none.
SWINGS = 4

#: Smallest swing that counts, over the peak.
SMALLEST_SWING = 0.1

#: Damping ratio below which the oscillation of a mode lasts.
RINGING = 0.02


def ratio_to_neighbours(values: np.ndarray) -> float:
    """Ratio of the largest value of a column to the larger one of its two neighbours.

    `values` has the shape (steps,). The ratio is 1 for a single step.
    """
    row = int(np.argmax(values))
    near = np.delete(values[max(row - 1, 0) : row + 2], min(row, 1))
    if not len(near) or not values[row] > 0.0:
        return 1.0
    return float(values[row] / max(near.max(), np.finfo(float).tiny))


def turning_points(values: np.ndarray, least: float) -> list[float]:
    """First value of a curve, which is a maximum, and the extremes after it.

    Parameters
    ----------
    values
        Values of the curve, shape (k,).
    least
        Smallest change between two extremes that counts.
    """
    points = [float(values[0])]
    rising = True
    for value in values[1:].tolist():
        if (value > points[-1]) == rising:
            points[-1] = value  # before the same extreme
        elif abs(value - points[-1]) > least:
            points.append(value)
            rising = not rising
    return points


def rings(values: np.ndarray) -> bool:
    """Whether a curve, shape (steps,), swings with decreasing amplitude after its peak."""
    peak = float(values.max())
    points = turning_points(values[int(np.argmax(values)) :], SMALLEST_SWING * peak)
    swings = np.abs(np.diff(points[: SWINGS + 1]))
    return len(swings) == SWINGS and bool((np.diff(swings) < 0.0).all())


def resting_films(system: System, peaks: Mapping[str, float]) -> list[str]:
    """Names of films whose pressure is only round-off, because no surface moves and no load acts.

    Parameters
    ----------
    system
        The mechanism.
    peaks
        Largest pressure by joint [Pa].
    """
    scales = {b.name: b.film.film.parameters.pressure_scale for b in system.films}
    return [name for name, peak in peaks.items() if peak < RESTING * scales[name]]


def unusual_pressures(system: System, peaks: Mapping[str, float]) -> list[str]:
    """Notices, one line each, of largest pressures that are above `HIGHEST` or only round-off.

    Parameters
    ----------
    system
        The mechanism.
    peaks
        Largest pressure by joint [Pa].
    """
    lines = [
        f"{name}: the largest pressure is {1e-6 * peak:.6g} MPa, more than {1e-6 * HIGHEST:g} MPa, "
        "the strength of any lining and the limit of the models: check loads, units, sizes and "
        "whether the bore is meant to be rigid"
        for name, peak in peaks.items()
        if peak > HIGHEST
    ]
    lines += [
        f"{name}: nothing moves or loads its film, whose {peaks[name]:.2g} Pa are round-off"
        for name in resting_films(system, peaks)
    ]
    return lines


def unusual_peaks(name: str, pressures: np.ndarray, *, may_ring: bool) -> list[str]:
    """Notice about a peak pressure that the time steps may not resolve; an empty list without one.

    Such a peak occurs in a single step, or in the decaying oscillation after the start of a run.

    Parameters
    ----------
    name
        Name of the joint.
    pressures
        Largest pressure of the film at every step, shape (steps,) [Pa].
    may_ring
        Whether the steps begin with the start of the run, and modes have little damping.
    """
    peak = 1e-6 * float(pressures.max())
    ratio = ratio_to_neighbours(pressures)
    if ratio > SPIKE:
        return [
            f"{name}: the peak of {peak:.4g} MPa is in a single step, {ratio:.3g} times the "
            "pressures of the steps before and after: lower time.tolerance, and check loads and "
            "shapes for jumps at this time"
        ]
    if may_ring and rings(pressures):
        return [
            f"{name}: the peak of {peak:.4g} MPa is the first swing of a start that rings, "
            "because modes have little damping: let loads grow (ramp), damp the bodies "
            "(damping_time, damping_ratio), or simulate until periodic (time.periodic = true)"
        ]
    return []
