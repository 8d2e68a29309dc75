"""The one angle of a machine that its curves are drawn over."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fenics_ehd.multibody.forces import Torque
from fenics_ehd.multibody.system import System

#: Rounding of a turn.
WHOLE = 1e-6


def crank(system: System) -> int | None:
    """Place in z of the angle that a drive turns, else a torque, else that of a journal or a body.

    The first by name of several; None where nothing can turn.
    """
    mechanism = system.mechanism
    places = {
        name: system.bodies[name].start + body.angle
        for name, body in system.each_name()
        if body.angle is not None
    }

    def named() -> Iterator[int | None]:
        yield from (places.get(name) for name in sorted(mechanism.drives))
        turned = (mechanism.forces[name] for name in sorted(mechanism.forces))
        yield from (places.get(force.body) for force in turned if isinstance(force, Torque))
        yield from (film.journal_angle for film in system.films)
        yield from places.values()

    return next((place for place in named() if place is not None), None)


class CrankAngle:
    """That angle at the steps of a run: continuous, in a search from one cycle's start to its end.

    Every cycle but the first begins in 0 to 360 degrees, so that an engine's last one is 0 to 720
    degrees, not 1440 to 2160.

    Parameters
    ----------
    system
        Of the mechanism.

    Attributes
    ----------
    left_out
        Whole turns before the cycle under way [degrees].
    """

    def __init__(self, system: System):
        self._place = crank(system)
        self.left_out = 0.0

    def restart(self, x: np.ndarray) -> None:
        """Begin another cycle at the coordinates x."""
        self.left_out = 0.0
        self.left_out = 360.0 * float(np.floor(self.at(x) / 360.0 + WHOLE))

    def at(self, x: np.ndarray) -> float:
        """At the coordinates x of a step [degrees]; 0 where nothing can turn."""
        return 0.0 if self._place is None else float(np.degrees(x[self._place])) - self.left_out
