"""Quantities of a lubricated joint at the end of a step: one function for each, with its unit.

`quantity` registers the functions in the order of the columns. Histories, summaries, pictures and
derivatives all use them. The argument ``mean`` marks quantities whose mean over a run, or a cycle,
is in the summary. Quantities of models that a joint does not have are not computed.

Angles are those in the bore's frame, from its x axis, positive from x to y, in -180..180 degrees: a
point at rest in the bore, such as a groove, has a constant angle. Heights are counted from
mid-width.

The film acts on both bodies at the journal's centre, with a force F on the journal and opposite
torques about this point: those of the oil's shear, and of the pressure on a journal that is not
round. About the bore's own axis, about which the friction of a bearing is measured on its housing,
the torque differs by the couple of the eccentric force,

    T_bore = T - (e x F)_z.

T brakes the journal, and T_bore drags the bore along; if journal and bore exchange their names,
they exchange these torques. By squeeze and shear the bodies supply the film with the power

    P = -int p dh/dt dA - Q . xi' - T_shear Omega,

and oil that enters under pressure with the power P_s. Both powers become heat: the discrete
Reynolds equation tested with its own pressure gives

    P + P_s = int h^3 / (12 eta) |grad p|^2 + theta eta U^2 / h dA

at every instant, to the residual of Newton's method. With 8-node elements, whose complementarity
is not that of pressure and flux at a node (11), it holds to the discretisation error.

Laws of wear depend on ``int p_c |U| dt``, the contact pressure times the sliding distance. It is
integrated at every Gauss point of the bore, over the run or the cycle, by the trapezoidal rule.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fenics_ehd.base.arguments import require_callable, require_class
from fenics_ehd.base.columns import with_unit
from fenics_ehd.base.described import Described
from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.film.film import Film, FilmState
from fenics_ehd.film.forces import FilmFlows, under_pressure
from fenics_ehd.film.rough_surfaces import PUBLISHED, AsperityContact
from fenics_ehd.multibody.contact import JointContact
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.step_equations import FilmFriction, StepEquations, film_friction
from fenics_ehd.multibody.surface import observed_positions

#: Relative difference up to which two values count as equal. A film without misalignment has its
#: extreme at two mirrored points: the upper one is reported, because round-off decides which is
#: larger.
EQUAL = 1e-9


@renamed_attributes(place="binding")
@dataclass(frozen=True, eq=False)
class JointStep(Described):
    """Lubricated joint at the end of a step.

    Integrals over its film are evaluated at first use, so that integrals that no model of the joint
    needs are not computed.

    Attributes
    ----------
    binding
        Binding of the film to the mechanism.
    state
        State of the film.
    contact
        Asperity contact of the joint; None between smooth surfaces.
    x, rate
        State of the mechanism in the time integration, and its rate, shape (n,) each.
    force
        Force of the film on the journal in the frame at rest, shape (2,) [N]; if the journal tilts,
        two torques follow, shape (4,) [N m].
    gap
        Film thickness at the g Gauss points, then at the k nodes, shape (g + k,) [m].
    """

    binding: FilmBinding
    state: FilmState
    contact: JointContact | None
    x: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    gap: np.ndarray

    @property
    def film(self) -> Film:
        """Film of the joint."""
        return self.binding.film.film

    @property
    def nodes(self) -> np.ndarray:
        """Angle [rad] and height [m] of the film's k nodes, shape (k, 2)."""
        return self.film.parameters.grid.node_positions

    @property
    def rows(self) -> FilmRows:
        """Nodes of the film in rows around the bore, between which extremes are interpolated."""
        return self.film.parameters.grid.rows

    @property
    def pressure(self) -> np.ndarray:
        """Pressure at the film's nodes, shape (k,) [Pa]."""
        return self.state.pressure

    @cached_property
    def flows(self) -> FilmFlows:
        """Oil flows of the film, and their powers."""
        return FilmFlows(self.film, self.state)

    @cached_property
    def powers(self) -> tuple[float, float]:
        """Power lost to pressure-driven flow, and power of the surfaces' drag on the oil [W].

        See `Film.powers`.
        """
        return self.film.powers(self.state)

    @cached_property
    def friction(self) -> FilmFriction:
        """Forces, torque and power loss of the oil's shear."""
        return film_friction(self.binding.film, self.state)

    @property
    def rough(self) -> JointContact:
        """Asperity contact of a joint with rough surfaces."""
        assert self.contact is not None
        return self.contact

    @cached_property
    def touch(self) -> AsperityContact:
        """Pressure of asperity contact, its slope and its potential at the Gauss points."""
        return self.rough.at_gap(self.state.gap.thickness)

    @cached_property
    def rubbed(self) -> float:
        """Power lost to boundary friction, even if this friction does not act on the bodies [W]."""
        if self.contact is None:
            return 0.0
        return self.contact.friction_power(self.touch, self.state.gap)

    @property
    def dissipated(self) -> float:
        """Power that becomes heat, whether friction acts on the bodies or not [W].

        It is lost to pressure-driven flow, to shear of the oil in full film and cavities, and to
        boundary friction.
        """
        return self.powers[0] + self.friction.sheared + self.rubbed

    @property
    def towards(self) -> float:
        """Direction of the journal's load on the bore, in the bore's frame [rad]."""
        # `force` acts on the journal: the load on the bore is its opposite.
        load = np.arctan2(-self.force[1], -self.force[0])
        return float(load - self.binding.angles(self.x)[1] - self.binding.surfaces[0].mounted)

    @cached_property
    def journal(self) -> np.ndarray:
        """Displacement of the journal's centre from that of the deformed bore, shape (2,) [m].

        The centre of a bore that is not round is that of its least-squares circle.
        """
        return self.binding.film.circle @ self.gap[-len(self.nodes) :]

    @cached_property
    def thinnest(self) -> tuple[float, float]:
        """Angle [rad] and height [m] of the thinnest film among Gauss points and nodes."""
        return upper_most(np.column_stack(observed_positions(self.film)), self.gap)

    @cached_property
    def load(self) -> np.ndarray:
        """Force of pressure, shear and contact on the journal in the bore's frame, (2,) [N]."""
        load = self.binding.film.load[:2] @ self.pressure + self.friction.on_xi[:2]
        if self.contact is None:
            return load
        return load + self.contact.forces(self.touch, self.state.gap)[:2]

    @cached_property
    def braking(self) -> float:
        """Friction torque that brakes the journal about its own axis [N m]."""
        # All torques that brake the journal are added here.
        torque = -self.friction.torque
        rows = self.binding.turning_rows(self.x, self.rate)
        if rows is not None:
            torque -= float(rows.load[-1] @ self.pressure)
        if self.contact is not None:
            torque += self.contact.friction_torque(self.touch, self.state.gap)
            if rows is not None:
                torque -= float(self.contact.area @ (self.touch.pressure * rows.gap[:, -1]))
        return torque

    @property
    def dragging(self) -> float:
        """Friction torque that drags the bore along about its own axis [N m]."""
        e = self.x[self.binding.xi[:2]]
        return self.braking - float(e[0] * self.load[1] - e[1] * self.load[0])

    @property
    def speeds(self) -> tuple[float, float]:
        """Angular speeds of journal and bore in the frame at rest [rad/s]."""
        return self.binding.angles(self.rate)


def joint_steps(
    equations: StepEquations,
    films: Sequence[FilmState],
    multipliers: np.ndarray,
    x: np.ndarray,
    rate: np.ndarray,
    gaps: Sequence[np.ndarray],
) -> list[JointStep]:
    """Make `JointStep` for all lubricated joints, from states and gaps of their films."""
    each = zip(equations.system.films, films, equations.contacts.joints, gaps, strict=True)
    return [
        JointStep(binding, state, contact, x, rate, multipliers[binding.rows], gap)
        for binding, state, contact, gap in each
    ]


Value = Callable[[JointStep], float]
Condition = Callable[[JointStep], bool]


@dataclass(frozen=True)
class Output:
    """Registered quantity of a lubricated joint.

    Attributes
    ----------
    column, meaning
        Name of the column with unit, and description.
    value, where
        Functions of a joint at a step: the first computes the quantity, the second decides whether
        the joint has it.
    mean
        Whether the summary contains the mean.
    reported
        Function that decides whether a joint without the quantity at its steps has it in the
        output, computed from the recorded rows (`fenics_ehd.multibody.reported_rows`).
    """

    column: str
    meaning: str
    value: Value
    where: Condition
    mean: bool
    reported: Condition


def everywhere(_: JointStep) -> bool:
    """Condition that holds for every joint."""
    return True


def nowhere(_: JointStep) -> bool:
    """Condition that holds for no joint."""
    return False


def with_friction(joint: JointStep) -> bool:
    """Whether the oil's shear acts on the bodies of a joint."""
    return joint.binding.film.friction


def with_contact(joint: JointStep) -> bool:
    """Whether a joint has rough surfaces."""
    return joint.contact is not None


def with_oil(joint: JointStep) -> bool:
    """Whether a joint has mass-conserving cavitation."""
    return joint.state.content is not None


#: All registered quantities, in the order of the columns.
OUTPUTS: list[Output] = []


def quantity(
    name: str,
    unit: str,
    where: Condition = everywhere,
    *,
    mean: bool = False,
    reported: Condition = nowhere,
) -> Callable[[Value], Value]:
    """Make a decorator that registers a function as a quantity of joints.

    The docstring of the function is the description of the quantity.

    Parameters
    ----------
    name, unit
        Name and unit, which are joined by an underscore in the column's name.
    where, mean, reported
        Condition on joints at a step, whether the summary has the mean, and condition on joints in
        the output, see `Output`.
    """
    require_class("name", name, str)
    require_class("unit", unit, str)
    require_callable("where", where)
    require_callable("reported", reported)

    def register(value: Value) -> Value:
        meaning = (value.__doc__ or "").rstrip(".")
        OUTPUTS.append(Output(with_unit(name, unit), meaning, value, where, mean, reported))
        return value

    return register


def joint_row(joint: JointStep, *, reported: bool = False) -> dict[str, float]:
    """Values of all quantities that a joint has at a step, by column.

    With `reported`, quantities that the joint has only in the output are included.
    """
    row: dict[str, float] = {}
    for output in OUTPUTS:
        if output.where(joint) or (reported and output.reported(joint)):
            if output.value is side_flow:
                row |= feed_flows(joint)
            row[output.column] = float(output.value(joint))
    return row


def joints_row(joints: Iterable[JointStep], *, reported: bool = False) -> dict[str, float]:
    """Values of all quantities of several joints at a step, by path, see `joint_row`."""
    return {
        f"joints/{joint.binding.name}/{column}": value
        for joint in joints
        for column, value in joint_row(joint, reported=reported).items()
    }


def averaged(row: Mapping[str, Any]) -> dict[str, Any]:
    """Select the columns of a row whose mean over time is in the summary."""
    means = {output.column for output in OUTPUTS if output.mean} | {FLOW}
    return {column: value for column, value in row.items() if column.rpartition(".")[2] in means}


#: Column of the flow of a supply, after the name of the supply.
FLOW = "flow_m3_per_s"


def feed_flows(joint: JointStep) -> dict[str, float]:
    """Flow of every supply into the film of a joint, by column [m3/s]."""
    flows = joint.flows.balance.feeds
    return {f"{name}.{FLOW}": flow for name, flow in flows.items()}


@quantity("max_pressure", "Pa")
def max_pressure(joint: JointStep) -> float:
    """Peak oil film pressure (POFP), interpolated between the nodes."""
    return joint.rows.largest(joint.pressure[None])[0][0]


@quantity("min_film_thickness", "m")
def min_film_thickness(joint: JointStep) -> float:
    """Minimum oil film thickness (MOFT), interpolated over nodes; nominal gap in rough joints."""
    return -joint.rows.largest(-joint.gap[None, -len(joint.nodes) :])[0][0]


@quantity("max_pressure_angle", "deg")
def max_pressure_angle(joint: JointStep) -> float:
    """Angle of the node with the largest pressure."""
    return in_degrees(joint.nodes[np.argmax(joint.pressure), 0])


@quantity("eccentricity_x", "m")
def eccentricity_x(joint: JointStep) -> float:
    """Displacement of the journal's centre from that of the undeformed bore, along x."""
    return joint.x[joint.binding.xi[0]]


@quantity("eccentricity_y", "m")
def eccentricity_y(joint: JointStep) -> float:
    """Displacement of the journal's centre from that of the undeformed bore, along y."""
    return joint.x[joint.binding.xi[1]]


@quantity("force_x", "N")
def force_x(joint: JointStep) -> float:
    """Force of the film on the journal along x, in the frame at rest."""
    return joint.force[0]


@quantity("force_y", "N")
def force_y(joint: JointStep) -> float:
    """Force of the film on the journal along y, in the frame at rest."""
    return joint.force[1]


@quantity("force", "N")
def force(joint: JointStep) -> float:
    """Size of the force of the film on the journal."""
    return np.hypot(joint.force[0], joint.force[1])


@quantity("specific_load", "Pa")
def specific_load(joint: JointStep) -> float:
    """Specific load F / (2 R B): force over the projected area of the bore."""
    grid = joint.film.parameters.grid
    return force(joint) / (2.0 * grid.radius * grid.width)


@quantity("force_angle", "deg")
def force_angle(joint: JointStep) -> float:
    """Direction of the journal's load on the bore, in the bore's frame."""
    return in_degrees(joint.towards)


@quantity("eccentricity_in_bore_x", "m")
def eccentricity_in_bore_x(joint: JointStep) -> float:
    """Displacement of the journal's centre from that of the deformed bore, along x."""
    return joint.journal[0]


@quantity("eccentricity_in_bore_y", "m")
def eccentricity_in_bore_y(joint: JointStep) -> float:
    """Displacement of the journal's centre from that of the deformed bore, along y."""
    return joint.journal[1]


@quantity("eccentricity_ratio", "1")
def eccentricity_ratio(joint: JointStep) -> float:
    """Eccentricity of the journal in the deformed bore, over the clearance."""
    return np.hypot(*joint.journal) / joint.binding.film.clearance


@quantity("attitude_angle", "deg")
def attitude_angle(joint: JointStep) -> float:
    """Angle from the load to the eccentricity of the journal in the deformed bore."""
    return in_degrees(np.arctan2(joint.journal[1], joint.journal[0]) - joint.towards)


@quantity("max_pressure_height", "m")
def max_pressure_height(joint: JointStep) -> float:
    """Height, from mid-width, of the node with the largest pressure."""
    return upper_most(joint.nodes, -joint.pressure)[1]


@quantity("min_film_angle", "deg")
def min_film_angle(joint: JointStep) -> float:
    """Angle at which the film is thinnest."""
    return in_degrees(joint.thinnest[0])


@quantity("min_film_height", "m")
def min_film_height(joint: JointStep) -> float:
    """Height, from mid-width, at which the film is thinnest."""
    return joint.thinnest[1]


@quantity("min_lambda_ratio", "1", with_contact)
def min_lambda_ratio(joint: JointStep) -> float:
    """Minimum oil film thickness over the combined roughness (lambda ratio)."""
    return min_film_thickness(joint) / joint.rough.surfaces.roughness


@quantity("max_contact_pressure", "Pa", with_contact)
def max_contact_pressure(joint: JointStep) -> float:
    """Largest contact pressure, interpolated between the Gauss points."""
    return joint.film.points.rows.largest(joint.touch.pressure[None])[0][0]


@quantity("friction_torque", "N m", with_friction, mean=True, reported=everywhere)
def friction_torque(joint: JointStep) -> float:
    """Torque T that brakes the journal about its own axis."""
    return joint.braking


@quantity("bore_friction_torque", "N m", with_friction, mean=True, reported=everywhere)
def bore_friction_torque(joint: JointStep) -> float:
    """Torque T_bore that drags the bore along about its own axis."""
    return joint.dragging


@quantity("friction_power", "W", with_friction, mean=True, reported=everywhere)
def friction_power(joint: JointStep) -> float:
    """Power lost in the film, independent of which body is called the journal."""
    return joint.dissipated


@quantity("journal_friction_power", "W", with_friction, mean=True, reported=everywhere)
def journal_friction_power(joint: JointStep) -> float:
    """Power that the journal supplies: friction torque times angular speed of the journal."""
    return joint.braking * joint.speeds[0]


@quantity("bore_friction_power", "W", with_friction, mean=True, reported=everywhere)
def bore_friction_power(joint: JointStep) -> float:
    """Power that the bore supplies: minus friction torque times angular speed of the bore."""
    return -joint.dragging * joint.speeds[1]


@quantity("film_power", "W", with_friction, mean=True)
def film_power(joint: JointStep) -> float:
    """Power P that the two bodies supply to the film by squeeze and shear."""
    binding = joint.binding
    friction = joint.friction
    opening = joint.film.pressure_areas.T @ joint.state.gap.thickness_rate.ravel()
    squeezed = -float(joint.pressure @ opening)
    speed = binding.relative_speed(joint.rate)
    sheared = -float(friction.on_xi @ joint.rate[binding.xi]) - friction.torque * speed
    return squeezed + sheared + joint.rubbed


@quantity(
    "dissipated_power",
    "W",
    lambda joint: with_friction(joint) or joint.binding.joint.heat is not None,
    mean=True,
)
def dissipated_power(joint: JointStep) -> float:
    """Power that becomes heat in the film."""
    return joint.dissipated


@quantity(
    "supply_power",
    "W",
    lambda joint: with_friction(joint) and under_pressure(joint.film),
    mean=True,
)
def supply_power(joint: JointStep) -> float:
    """Power P_s that oil brings into the film because it enters under pressure."""
    return joint.flows.work


@quantity("contact_force", "N", with_contact, mean=True)
def contact_force(joint: JointStep) -> float:
    """Normal force of asperity contact."""
    return joint.rough.area @ joint.touch.pressure


@quantity("contact_share", "1", with_contact, mean=True)
def contact_share(joint: JointStep) -> float:
    """Share of asperity contact in the total normal force."""
    film = joint.film
    in_contact = contact_force(joint)
    pressed = film.parameters.grid.radius**2 * film.assembly.area
    positive = np.maximum(film.assembly.at_points(joint.pressure)[0], 0.0)
    in_film = float(np.sum(pressed * positive))
    return in_contact / (in_contact + in_film) if in_contact else 0.0


def _share_of_bore(joint: JointStep, at_points: np.ndarray) -> float:
    """Mean over the bore of a quantity with the values `at_points` at the Gauss points, (g,)."""
    film = joint.film
    area = film.parameters.grid.radius**2 * film.assembly.area.sum()
    return joint.rough.area @ at_points / area


@quantity("contact_area_share", "1", with_contact, mean=True)
def contact_area_share(joint: JointStep) -> float:
    """Share of the bore in true contact."""
    surfaces = joint.rough.surfaces
    return _share_of_bore(joint, surfaces.contact_share(joint.state.gap.thickness.ravel()))


@quantity("unpublished_share", "1", with_contact, mean=True)
def unpublished_share(joint: JointStep) -> float:
    """Share of the bore where the gap is too small for the published flow factors."""
    least = PUBLISHED * joint.rough.surfaces.roughness
    return _share_of_bore(joint, joint.state.gap.thickness.ravel() < least)


@quantity(
    "contact_power",
    "W",
    lambda joint: joint.contact is not None and bool(joint.contact.friction),
    mean=True,
    reported=lambda joint: with_contact(joint) and joint.rough.surfaces.boundary_friction > 0.0,
)
def contact_power(joint: JointStep) -> float:
    """Power lost to boundary friction of asperities."""
    return joint.rubbed


@quantity("oil_content", "m3", with_oil, mean=True)
def oil_content(joint: JointStep) -> float:
    """Volume of oil in the film, at ambient density."""
    assert joint.state.content is not None
    return joint.state.content.sum()


@quantity(
    "side_flow",
    "m3/s",
    lambda joint: with_oil(joint) or bool(joint.film.parameters.feeds),
    mean=True,
    reported=everywhere,
)
def side_flow(joint: JointStep) -> float:
    """Flow out of the film at both sides."""
    return joint.flows.balance.side


@quantity("leaving_flow", "m3/s", lambda joint: joint.binding.joint.heat is not None, mean=True)
def leaving_flow(joint: JointStep) -> float:
    """Flow of the oil that leaves the film and carries heat away."""
    return joint.flows.leaving


@quantity(
    "supply_flow",
    "m3/s",
    lambda joint: with_oil(joint) and bool(joint.film.parameters.regions),
    mean=True,
)
def supply_flow(joint: JointStep) -> float:
    """Flow into the film through grooves and holes of given pressure."""
    return joint.flows.balance.supply


def upper_most(positions: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Angle [rad] and height [m] of the point with the smallest value, the highest if several.

    Parameters
    ----------
    positions, values
        Angle and height of every point, shape (k, 2), and value at every point, shape (k,).
    """
    least = values.min()
    equal = np.flatnonzero(values <= least + EQUAL * abs(least))
    angle, height = positions[equal[np.argmax(positions[equal, 1])]]
    return float(angle), float(height)


def in_degrees(angle: float) -> float:
    """Convert an angle from radians to degrees, from -180 up to 180."""
    return float(np.degrees((angle + np.pi) % (2 * np.pi) - np.pi))


def rubbing(joint: JointStep) -> np.ndarray:
    """Contact pressure times sliding speed at the Gauss points, shape (g,) [Pa m/s]."""
    return joint.touch.pressure * np.abs(joint.state.gap.sliding_velocity.ravel())


def wear(binding: FilmBinding, slid: np.ndarray) -> dict[str, float]:
    """Entries of ``summary.json`` about wear: largest contact pressure times sliding distance.

    `slid` has this product at the Gauss points of a joint's film, shape (g,) [Pa m]. The angle and
    the height of the point with the largest product are entries, too.
    """
    worst = int(np.argmax(slid))
    points = binding.film.film.points
    return {
        "contact_sliding_Pa_m": float(slid[worst]),
        "contact_sliding_angle_deg": in_degrees(points.angle.ravel()[worst]),
        "contact_sliding_height_m": float(points.height.ravel()[worst]),
    }


#: Columns of the oil content, and of the flow out of the sides.
CONTENT = "oil_content_m3"
SIDE_FLOW = "side_flow_m3_per_s"


def oil_balance(start: float, end: float, totals: Mapping[str, float]) -> dict[str, float]:
    """Entries of ``summary.json`` about the oil of a joint with mass-conserving cavitation.

    `start` and `end` are the oil contents at the start and the end of the time span [m^3], `totals`
    the integrals of the flows over it by column [m^3]. The defect is the change of the content less
    the net inflow, divided by the sum of the supplied oil and the larger one of the two contents.
    It is the error of the integrals over time, because every step conserves oil.
    """
    # The column of all supplies exists only with a supply of given pressure.
    fed = sum(flow for name, flow in totals.items() if name.endswith(f".{FLOW}"))
    supplied = totals.get("supply_flow_m3_per_s", fed)
    held = max(start, end) + abs(supplied)
    lost = abs(end - start - (supplied - totals[SIDE_FLOW]))
    return {
        "oil_content_at_start_m3": start,
        "oil_content_at_end_m3": end,
        "oil_balance_defect": lost / held if held else 0.0,
    }
