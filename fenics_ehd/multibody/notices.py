"""Notices of values that are probably mistakes, one line each.

Of a mechanism:

- A centre of mass or an inertia far from the body's own, whose unit may be another: that of a part
  is compared with its radius of gyration, that of a rigid body with the extent of its points.
- A measured shape with a step.

Of the pressures of a run:

- A peak above the strength of any lining, and a pressure that is rounding.
- A peak of a single step, and a start that rings.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fenics_ehd.film.kinematics import OVERSHOOT, Shape
from fenics_ehd.multibody.body import Body, FlexibleBody, RigidBody
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import System

#: Distance of a centre of mass from the part's own beyond which it is outside the part, in radii of
#: gyration: half a uniform bar is 1.73 of them long.
OUTSIDE = 2.0

#: Ratio of two radii of gyration of one part: counterweights and bolts change it by less.
LIKE = 3.0

#: Radius of gyration, or distance of the centre of mass, of a rigid body over the reach of its
#: points: a flywheel on a crank has 5.
REACHES = 10.0


def unusual_totals(bodies: Mapping[str, Body]) -> list[str]:
    """One line for every centre of mass or inertia that is far from the rest of its body."""
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
                f"of the part, more than {OUTSIDE:g} radii of gyration ({gyration:.3g} m): it lies "
                "outside the part, is the unit another?"
            )
    if body.inertia is not None:
        radius = float(np.sqrt(body.inertia / (body.mass or measured.total_mass)))
        if not gyration / LIKE <= radius <= LIKE * gyration:
            lines.append(
                f"{key}.inertia = {body.inertia:g} kg m2 is a radius of gyration of {radius:.3g} "
                f"m, the part has {gyration:.3g} m: is the unit another?"
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
            f"origin as any point of the body ({body.reach:.3g} m): is the unit another?"
        )
    if radius > max(limit, distance):
        lines.append(
            f"{key}.inertia = {body.inertia:g} kg m2 is a radius of gyration of {radius:.3g} m, "
            f"points of the body reach {body.reach:.3g} m: is the unit another?"
        )
    return lines


def stepped_shapes(joints: Mapping[str, object]) -> list[str]:
    """One line for every measured shape whose spline would overshoot its rows."""
    lines = []
    for name, joint in joints.items():
        if isinstance(joint, LubricatedJoint):
            lines += stepped_shape(f"joints.{name}.bore_shape", joint.bore_shape)
            lines += stepped_shape(f"joints.{name}.journal_shape", joint.journal_shape)
    return lines


def stepped_shape(key: str, shape: Shape | None) -> list[str]:
    """A line for a measured shape whose spline would overshoot its rows, else none."""
    table = getattr(shape, "measured", None)
    if table is None or not table.stepped.any():
        return []
    beyond = 1e6 * table.overshoot.max()
    span = 1e6 * np.ptp(table.deviations)
    return [
        f"{key}.table: a spline would overshoot its rows by {beyond:.3g} um, more than "
        f"{100 * OVERSHOOT:g} % of the {span:.3g} um that they span: a monotone curve takes its "
        "place; more rows where the surface steps make it smooth"
    ]


#: Pressure beyond which a notice asks for the reason [Pa]: bearing metals yield far below, and
#: films of gears and rollers, whose solids are not those of a bearing, begin there.
HIGHEST = 1e9

#: Largest pressure over that of a film whose surfaces move within the simulated time, below which
#: the pressure is rounding.
RESTING = 1e-6

#: Largest pressure over the pressures of the steps before and after it, above which it is a spike.
#: The ten shipped scenes have 1.0002 to 1.005 at their peaks and 1.022 anywhere, the starved
#: journal 1.29 and 1.63 while it fills; a peak of 858 MPa between 1.6 MPa has 536.
SPIKE = 5.0

#: Number of decreasing swings after the peak of a ringing start. A rod without damping that begins
#: with the velocities of a rigid one swings from 73 MPa by 47, 30, 26 and 15 MPa (`slider-crank`,
#: whose peak without ringing is 47 MPa); with its damping, and in shipped scenes, none follows.
SWINGS = 4

#: Smallest swing that counts, as a share of the peak.
SMALLEST_SWING = 0.1

#: Damping ratio below which a mode rings.
RINGING = 0.02


def ratio_to_neighbours(values: np.ndarray) -> float:
    """Largest value over the larger of its neighbours, shape (steps,); 1 of a single step."""
    row = int(np.argmax(values))
    near = np.delete(values[max(row - 1, 0) : row + 2], min(row, 1))
    if not len(near) or not values[row] > 0.0:
        return 1.0
    return float(values[row] / max(near.max(), np.finfo(float).tiny))


def turning_points(values: np.ndarray, least: float) -> list[float]:
    """First value of a curve, a maximum, and its further extremes.

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
            points[-1] = value  # on the way to the same extreme
        elif abs(value - points[-1]) > least:
            points.append(value)
            rising = not rising
    return points


def rings(values: np.ndarray) -> bool:
    """True of a curve that swings after its largest value with decreasing amplitude."""
    peak = float(values.max())
    points = turning_points(values[int(np.argmax(values)) :], SMALLEST_SWING * peak)
    swings = np.abs(np.diff(points[: SWINGS + 1]))
    return len(swings) == SWINGS and bool((np.diff(swings) < 0.0).all())


def resting_films(system: System, peaks: Mapping[str, float]) -> list[str]:
    """Names of the films whose pressure is rounding: no surface moves, no load acts.

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
    """One line for every largest pressure above the strength of any lining, or that is rounding.

    Parameters
    ----------
    system, peaks
        As of `resting_films`.
    """
    lines = [
        f"{name}: the largest pressure is {1e-6 * peak:.6g} MPa, more than {1e-6 * HIGHEST:g} MPa, "
        "which no lining bears and no model of this program describes: check loads, units, sizes "
        "and whether the bore is meant to be rigid"
        for name, peak in peaks.items()
        if peak > HIGHEST
    ]
    lines += [
        f"{name}: nothing moves or loads its film, its pressure of {peaks[name]:.2g} Pa is rounding"
        for name in resting_films(system, peaks)
    ]
    return lines


def unusual_peaks(name: str, pressures: np.ndarray, *, may_ring: bool) -> list[str]:
    """A line for a peak of a single step, or of a start that rings, else none.

    Parameters
    ----------
    name
        Name of the joint.
    pressures
        Largest pressure at every step, shape (steps,) [Pa].
    may_ring
        Whether the run begins with a start, and has modes of hardly any damping.
    """
    peak = 1e-6 * float(pressures.max())
    ratio = ratio_to_neighbours(pressures)
    if ratio > SPIKE:
        return [
            f"{name}: the peak of {peak:.4g} MPa is in a single step, {ratio:.3g} times the "
            "pressures of the steps around it: lower time.tolerance, and check loads and shapes "
            "for jumps at this time"
        ]
    if may_ring and rings(pressures):
        return [
            f"{name}: the peak of {peak:.4g} MPa is the first swing of a start that rings, "
            "with modes of hardly any damping: let loads grow (ramp), damp the bodies "
            "(damping_time, damping_ratio), or simulate until periodic (time.periodic = true)"
        ]
    return []
