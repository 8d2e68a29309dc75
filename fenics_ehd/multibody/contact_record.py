"""What a run shows of the contact in a joint: columns, the largest pressure, what wear depends on.

Wear grows, by whatever law, with ``int p_c |U| dt``: the contact pressure times the distance slid.
It is summed at every Gauss point of the bore, over the run or the cycle, by the trapezoidal rule.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fenics_ehd.film.flow_factors import PUBLISHED
from fenics_ehd.multibody.film_integrals import FilmIntegrals
from fenics_ehd.multibody.joint_contact import JointContact
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.system import FilmPlace


def contact_rates(contact: JointContact, place: FilmPlace, film: FilmIntegrals) -> dict[str, float]:
    """Columns of the history of which the summary has means.

    Normal force of contact; its share of all normal force; shares of the bore in true contact, and
    of surfaces nearer than flow factors are published for; with friction, the power that touching
    asperities lose.
    """
    joint, state, area = place.film.film, film.state, contact.area
    thickness = state.gap.thickness.ravel()
    force = float(area @ film.touch.pressure)
    pressed = joint.parameters.grid.radius**2 * joint.assembly.area
    carried = float(np.sum(pressed * np.maximum(joint.assembly.at_points(state.pressure)[0], 0.0)))
    true = contact.surfaces.asperities.contact_share(thickness)
    beyond = thickness < PUBLISHED * contact.surfaces.roughness
    rates = {
        "contact_force_N": force,
        "contact_share": force / (force + carried) if force else 0.0,
        "contact_area_share": float(area @ true / pressed.sum()),
        "unpublished_share": float(area @ beyond / pressed.sum()),
    }
    if contact.friction:
        rates["contact_power_W"] = film.rubbed
    return rates


class ContactRecord:
    """Contact of one joint over a run, or over its last cycle.

    Attributes
    ----------
    contact
        The joint's.
    slid
        ``int p_c |U| dt`` at the Gauss points, shape (g,) [Pa m].
    """

    def __init__(self, contact: JointContact, place: FilmPlace):
        self.contact = contact
        self._points = place.film.film.points
        self._time = np.nan
        self._last = np.zeros(len(contact.area))
        self.restart()

    @classmethod
    def of_all(cls, equations: StepEquations) -> dict[str, ContactRecord]:
        """Of every joint with rough surfaces, by its name."""
        if equations.contacts is None:
            return {}
        joints = zip(equations.system.films, equations.contacts.joints, strict=True)
        return {place.name: cls(own, place) for place, own in joints if own is not None}

    def restart(self) -> None:
        """Forget what was, but for the last step."""
        self.slid = np.zeros(len(self.contact.area))
        self._largest = self._largest_time = 0.0

    def add(self, time: float, since: float, film: FilmIntegrals) -> dict[str, float]:
        """Account for a step at a time, `since` the cycle began [s]; its column."""
        pressure = film.touch.pressure
        now = pressure * np.abs(film.state.gap.sliding_velocity.ravel())
        if np.isfinite(self._time):
            self.slid = self.slid + 0.5 * (time - self._time) * (self._last + now)
        self._time, self._last = time, now
        largest = float(pressure.max())
        if largest > self._largest:
            self._largest, self._largest_time = largest, since
        return {"max_contact_pressure_Pa": largest}

    def figures(self) -> dict[str, float]:
        """What ``summary.json`` has of it."""
        worst = int(np.argmax(self.slid))
        angle = self._points.angle.ravel()[worst]
        return {
            "max_contact_pressure_Pa": self._largest,
            "max_contact_pressure_time_s": self._largest_time,
            "contact_sliding_Pa_m": float(self.slid[worst]),
            "contact_sliding_angle_deg": float(
                np.degrees(np.mod(angle + np.pi, 2 * np.pi) - np.pi)
            ),
            "contact_sliding_height_m": float(self._points.height.ravel()[worst]),
        }

    def stored_state(self) -> dict[str, Any]:
        """All that it knows, for `load_state`."""
        figures = np.array([self._time, self._largest, self._largest_time])
        return {"figures": figures, "last": self._last, "slid": self.slid}

    def load_state(self, stored: Mapping[str, Any]) -> None:
        """Go on where another one was."""
        self._time, self._largest, self._largest_time = map(float, stored["figures"])
        self._last, self.slid = np.array(stored["last"]), np.array(stored["slid"])
