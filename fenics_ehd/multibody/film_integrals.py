"""What one joint's film takes, loses and lets through at an accepted step."""

from __future__ import annotations

from functools import cached_property

from fenics_ehd.film import FilmState
from fenics_ehd.film.asperities import Touch
from fenics_ehd.film.flow import FilmFlows
from fenics_ehd.multibody.friction import FilmFriction, film_friction
from fenics_ehd.multibody.joint_contact import JointContact
from fenics_ehd.multibody.lubricated_joint import JointFilm


class FilmIntegrals:
    """Integrals over a film, each evaluated once, when it is first asked for.

    Columns of the history, heat and energy balance read them: what no model of the joint asks for
    is not computed.

    Parameters
    ----------
    joint, state
        The film and its solution.
    contact
        In the joint, None between smooth surfaces.

    Attributes
    ----------
    flows
        Of its oil.
    """

    def __init__(self, joint: JointFilm, state: FilmState, contact: JointContact | None = None):
        self._joint, self.state, self.contact = joint, state, contact
        self.flows = FilmFlows(joint.film, state)

    @cached_property
    def powers(self) -> tuple[float, float]:
        """See `Film.powers`."""
        return self._joint.film.powers(self.state)

    @cached_property
    def friction(self) -> FilmFriction:
        """Of the oil's shear."""
        return film_friction(self._joint, self.state)

    @cached_property
    def touch(self) -> Touch:
        """Of rough surfaces."""
        assert self.contact is not None
        return self.contact.touch(self.state.gap.thickness)

    @cached_property
    def rubbed(self) -> float:
        """Power lost by boundary friction, whether it acts on the bodies or not [W]."""
        if self.contact is None:
            return 0.0
        return self.contact.rubbing_power(self.touch, self.state.gap)

    @property
    def dissipated(self) -> float:
        """Power that becomes heat [W], whether friction acts on the bodies or not.

        Pressure-driven flow, shear of the oil in full film and cavities, asperities that rub.
        """
        return self.powers[0] + self.friction.sheared + self.rubbed
