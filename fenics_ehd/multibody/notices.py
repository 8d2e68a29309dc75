"""Notices of values of a mechanism that are hardly meant, one line each.

- A centre of mass or an inertia far from the body's own, whose unit may be another: that of a part
  is compared with its radius of gyration, that of a rigid body with the reach of its points.
- A measured shape with a step.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fenics_ehd.film.kinematics import OVERSHOOT, Shape
from fenics_ehd.multibody.body import Body, FlexibleBody, RigidBody
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint

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
    beyond, span = 1e6 * table.overshoot.max(), 1e6 * np.ptp(table.deviations)
    return [
        f"{key}.table: a spline would overshoot its rows by {beyond:.3g} um, more than "
        f"{100 * OVERSHOOT:g} % of the {span:.3g} um that they span: a monotone curve takes its "
        "place; more rows where the surface steps make it smooth"
    ]
