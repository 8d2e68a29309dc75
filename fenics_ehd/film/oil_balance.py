"""Oil balance of a film that may be partly empty, with limited transport of the void.

**Transport** of the empty part of the gap by the moving surfaces is of second order, and limited.
The nodes of one height form a strip around the bore. With the shape function ``N_i = A_i(phi)
Z(z)`` of node i of a strip, the full-film Couette term of the weak form is a difference of flows
between neighbours,

    -int rho H V dN_i/dphi = F_i - F_(i-1),   F_i = -int rho H V dN_i/dphi behind node i,

"behind": over the cells between i and the following node. Where the gap is empty to
the void fraction s, a flow carries the fraction c at the middle of its cell,

    t(s)_i = F_i c_i - F_(i-1) c_(i-1) + d/dt (int rho H N_i) s_i.

In a full film (s = 0) the term is zero; in an empty film (s = 1) it cancels the Couette term to
round-off. No oil is lost between nodes, and strips do not mix.

**Limiter.** c is extrapolated from the upstream node u of the flow, by the harmonic mean of
the slopes on both sides of it (van Leer, J. Comput. Phys. 14, 1974, 361). With b the node before u
and a the node after u in the direction of the flow, and l the lengths of their cells,

    c = s_u + x y / (x + y)  where x y > 0, else s_u;   x = (s_u - s_b) l_a / l_b,   y = s_a - s_u.

Second order where s is smooth, first order at its extremes; c lies between s_u and s_a, so that no
oil flows out of an empty node, and no more than its content out of a full node. In the form of
Harten (J. Comput. Phys. 49, 1983, 357), ``F (c_i - c_(i-1)) = C F (s_i - s_(i-1))`` with C >= 0:
implicit Euler adds no variation and no extreme, for any step.

**Derivative.** With the upstream node of a flow held, and with kinks of c where x y = 0,

    dc = ds_u + (y / (x + y))^2 dx + (x / (x + y))^2 dy,

so that second neighbours belong to the pattern, too.

**Balance** (Jakobsson and Floberg 1957, Olsson 1965). The gap holds oil to the fraction
``theta = 1 - s``; where the film is full, s = 0, and elsewhere the pressure is the cavitation
pressure, p = 0. Per node i, dimensionless as in `fenics_ehd.film.weak_form`, the oil is conserved,

    int k grad p . grad N_i - rho H V dN_i/dphi + (M_i - M_i^old) / dt - t(s)_i = 0,

where ``M_i = int rho H N_i`` is the oil content of a full gap and ``M_i^old`` the content before.
Time is integrated by implicit Euler or a formula of several steps. That is ``r(p) = t(s)`` with
``0 <= p`` complementary to ``s >= 0``. The rate of the gap is the difference of two contents, never
`Gap.thickness_rate`, because only the difference conserves oil from step to step.

``t^-1(r(p)) >= 0`` as a function of p alone is not used: t transports along the film, so that the
sign of one component depends on all the nodes upstream. With p and s as variables SNES-VI solves

    p >= 0   complementary to   s + gamma d >= 0,      d = r(p) - t(s) = 0.

``gamma d`` vanishes at the solution. During the iteration it empties a full node whose Newton
update was negative and was cut off at p = 0: the void fraction of this node is zero, and only its
defect d has the right sign. Each Newton step then solves

    A_I p_I - T_C s_C = b,    A = dr/dp,  T = dt/ds,

on the full nodes I and the others C, one sparse system of one pattern
(`ActiveSetSystem`), and moves between I and C the nodes with a wrong sign.

If the fractions c are held, t is linear. No entry off the diagonals of A and t is positive, and no
column sum is negative. The same is true of every matrix that has the columns of full nodes from A
and the others from t. All these matrices are M-matrices: theta is not below 0. For A this requires
bilinear cells, strictly no longer than 1.4 times their width; in practice cells 9 times as long
have theta > 0, too. 9-node cells are excluded: theta is -0.1 next to the ends of a short groove.

Nodes with a given pressure above cavitation, and grooves and holes at any pressure, are reservoirs:
theta = 1 and oil flows in or out. A side at cavitation pressure is no reservoir: its unknown is the
outflow, positive only where the film is full, and zero elsewhere. The flow of
`FilmParameters.feeds` into the film, ``w kappa (p_s - p)``, is ``w kappa p_s`` at empty nodes. This
flow is lumped at the nodes, and all matrices stay M-matrices.

The oil content of an empty region converges with second order in the mesh, the position of its
front with first order: a front lies between two nodes, one of which has no void.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.assembly import Assembly, Pattern, with_weights
from fenics_ehd.film.cavitation import Complementarity
from fenics_ehd.film.film import Film
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.parameters import FeedTerm

if TYPE_CHECKING:
    from fenics_ehd.film.weak_form import Flow, Inputs

#: Rate of the contents below which a source counts as zero.
SMALLEST_SOURCE = 1e-6

#: Nodes of a bilinear cell at its smaller angle, lower one first.
LEFT = [0, 2]

#: Nodes of a bilinear cell at its larger angle, lower one first.
RIGHT = [1, 3]


class Strips:
    """Flows along the strips of a film mesh.

    Parameters
    ----------
    assembly
        Gauss points of a bilinear mesh.
    unknown
        Nodes with an unknown, along which t is differentiated.

    Attributes
    ----------
    assembly, unknown
        As given.
    following, preceding, second
        Node after and before every node of its strip, and the one after the next, shape (nodes,).
    passing
        Nodes whose flows pass the nodes of every cell, ascending, shape (c, k).
    ratio
        Length of a flow's cell over the length of the cell upstream, for flows in either direction.
    pattern
        Pattern of the derivative of t on the unknown nodes, second neighbours included.
    places
        Indices of the entries of every flow in two rows of the pattern; rows of other nodes have
        the index after the last one.
    """

    def __init__(self, assembly: Assembly, unknown: np.ndarray):
        nodes = assembly.grid.cell_nodes
        around, along = assembly.grid.cell_sizes
        self.assembly = assembly
        self.unknown = unknown
        self._length = along[:, None]
        #: Flow through the lower and upper half of a cell, from every Gauss point.
        self._flow = -assembly.slopes_around[:, LEFT]
        self._from = nodes[:, LEFT]
        ascending = np.argsort(nodes, axis=1)
        self.passing = np.take_along_axis(nodes[:, [0, 0, 2, 2]], ascending, axis=1)
        self._own = np.arange(assembly.size)
        self.following = np.empty(assembly.size, dtype=int)
        self.following[self._from] = nodes[:, RIGHT]
        self.preceding = np.empty_like(self.following)
        self.preceding[self.following] = self._own
        self.second = self.following[self.following]
        length = np.empty(assembly.size)
        length[self._from] = around[:, None]
        self.ratio = length / length[self.preceding], length / length[self.following]
        self._number_entries()

    def _number_entries(self) -> None:
        """The pattern, and the indices of the entries of every flow in two of its rows."""
        n = len(self.unknown)
        number = np.full(self.assembly.size, -1)
        number[self.unknown] = np.arange(n)
        cells = self.assembly.pattern(self.unknown)
        rows = number[np.stack([self._own, self.following])][:, None]
        columns = number[np.stack([self.preceding, self._own, self.following, self.second])]
        codes = np.where((rows < 0) | (columns < 0), -1, rows * n + columns)
        every = np.union1d(cells.rows * n + cells.indices, codes[codes >= 0])
        starts = np.searchsorted(every, n * np.arange(n + 1))
        self.pattern = Pattern(starts.astype(np.int32), (every % n).astype(np.int32))
        self.places = np.where(codes < 0, len(every), np.searchsorted(every, codes))

    def flows(self, transport: np.ndarray) -> np.ndarray:
        """Full-film flow ``F_i`` from every node to the following one, shape (nodes,).

        `transport` is ``rho H V`` at the Gauss points, shape (c, q).
        """
        element = (transport * self._length) @ self._flow
        return np.bincount(self._from.ravel(), element.ravel(), self.assembly.size)


@dataclass(frozen=True, eq=False)
class Transport:
    """Transport of one void fraction by given flows.

    Attributes
    ----------
    strips
        Strips of the film.
    flows, storage
        ``F_i`` and ``int rho H N_i`` over the time step, shape (nodes,) each.
    void
        s, shape (nodes,).
    """

    strips: Strips
    flows: np.ndarray
    storage: np.ndarray
    void: np.ndarray

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """``s_u``, x, y over x + y (0 if x y <= 0); and a mask: flow to the following node."""
        on = self.flows > 0
        void = self.void
        strips = self.strips
        start = np.where(on, void, void[strips.following])
        behind = np.where(on, void[strips.preceding], void[strips.second])
        x = np.where(on, *strips.ratio) * (start - behind)
        y = np.where(on, void[strips.following], void) - start
        rising = x * y > 0
        share = np.divide(y, x + y, out=np.zeros_like(y), where=rising)
        return start, x, share, on

    @cached_property
    def carried(self) -> np.ndarray:
        """Void fraction c carried by every flow, shape (nodes,)."""
        start, x, share, _ = self._slopes
        return start + x * share

    @property
    def nodal(self) -> np.ndarray:
        """``t(s)`` at all nodes."""
        carried = self.flows * self.carried
        return carried - carried[self.strips.preceding] + self.storage * self.void

    @property
    def values(self) -> np.ndarray:
        """``t(s)`` at the unknown nodes."""
        return self.nodal[self.strips.unknown]

    @cached_property
    def entries(self) -> np.ndarray:
        """Entries of ``dt/ds`` on these, in the order of `Strips.pattern`."""
        strips = self.strips
        (_, x, share, on) = self._slopes
        behind = -np.where(on, *strips.ratio) * share**2
        ahead = np.where(share > 0, 1.0 - share, 0.0) ** 2
        start = 1.0 - behind - ahead
        none = np.zeros_like(x)
        columns = np.where(on, [behind, start, ahead, none], [none, ahead, start, behind])
        values = np.stack([self.flows * columns, -self.flows * columns])
        count = len(strips.pattern.indices)
        entries = np.bincount(strips.places.ravel(), values.ravel(), count + 1)[:count]
        entries[strips.pattern.diagonal] += self.storage[strips.unknown]
        return entries


@dataclass(frozen=True, eq=False)
class OilStep:
    """One time step, dimensionless.

    The nominal `gap` at its end, and the `flow` there of a film without pressure; its `length`;
    what the weak form is assembled with for flows (`driven`) and for derivatives, contents included
    (`inputs`); the full-film `flows` from node to node, and, over the length, the `full` contents
    of the pressureless gap and the `former` contents; what supplies add, None without any. Of a
    formula with several steps the length is one over its shift, and `former` minus the rate of
    contents that are zero at the end.
    """

    gap: Gap
    flow: Flow
    driven: Inputs
    inputs: Inputs
    length: float
    flows: np.ndarray
    full: np.ndarray
    former: np.ndarray
    feed: FeedTerm | None = None


class OilBalance:
    """Balance of one film.

    Parameters
    ----------
    film
        Film on a bilinear mesh.
    oil_outside
        Whether oil surrounds sides at cavitation pressure, too.

    Attributes
    ----------
    unknown
        Nodes with an unknown: pressure or void fraction where the pressure is
        free, outflow or void fraction at a side at cavitation pressure.
    dry
        Mask of the unknown nodes at such a side.
    pattern
        Pattern of the derivatives along pressure and void fraction.
    """

    def __init__(self, film: Film, *, oil_outside: bool = False):
        self.film = film
        # Nodes of given pressure that are no reservoirs.
        empty = (film.equation.given == 0.0) & ~film.supplied_nodes & (not oil_outside)
        dry = np.setdiff1d(np.flatnonzero(empty), film.free)
        self.unknown = np.union1d(film.free, dry)
        self.dry = np.isin(self.unknown, dry)
        self.assembly = film.assembly
        self.strips = Strips(self.assembly, self.unknown)
        self.pattern = self.strips.pattern
        self._places = film.equation.forms.places(self.pattern, self.unknown)
        self._dry_column = self.dry[self.pattern.indices]

    @property
    def volume_scale(self) -> float:
        """``c R^2`` [m^3], the unit of oil contents."""
        p = self.film.parameters
        return p.clearance * p.grid.radius**2

    def ending(self, gap: Gap, length: float, former: np.ndarray) -> OilStep:
        """A step of a length that ends with a gap, see `OilStep`."""
        equation = self.film.equation
        flow = equation.flow(gap)
        return OilStep(
            gap,
            flow,
            equation.inputs(gap, squeeze=0.0, supplied=False),
            equation.inputs(gap, squeeze=0.0, storage=1.0 / length, supplied=False),
            length,
            flows=self.strips.flows(flow.density * flow.thickness * flow.velocity),
            full=self.assembly.source(flow.density * flow.thickness) / length,
            former=former,
            feed=equation.fed(gap, flow, lumped=True),
        )

    def problem(self, step: OilStep) -> Complementarity:
        """``r`` of the unknown nodes; the unknown of a dry side is its outflow."""

        def residual(values: np.ndarray) -> np.ndarray:
            defect = self.full_film(step, self.nodal(values))[self.unknown]
            return defect + np.where(self.dry, values, 0.0)

        def entries(values: np.ndarray) -> np.ndarray:
            entries_of_all = self.film.equation.forms.matrix(step.inputs, self.nodal(values))
            # The pattern without second neighbours does not contain all entries.
            matrix = np.append(entries_of_all, 0.0)[self._places]
            if step.feed is not None:
                lumped = self.assembly.source(step.feed.conductance.sum(axis=0))
                matrix[self.pattern.diagonal] += lumped[self.unknown]
            matrix[self._dry_column] = 0.0
            matrix[self.pattern.diagonal[self.dry]] = 1.0
            return matrix

        unit = np.ones(len(self.unknown))
        first = cache(partial(entries, np.zeros_like(unit)))
        return Complementarity(
            residual,
            (lambda p: first()) if self.film.parameters.lubricant.linear else entries,
            unit,
            SMALLEST_SOURCE,
        )

    def transport(self, step: OilStep, void: np.ndarray) -> Transport:
        """Transport of the void fractions of the unknown nodes, shape (m,); others have none."""
        nodal = np.zeros(self.assembly.size)
        nodal[self.unknown] = void
        return Transport(self.strips, step.flows, step.full, nodal)

    def rows(self, step: OilStep, problem: Complementarity) -> np.ndarray:
        """Size of the equations of a nearly full film, shape (m,)."""
        carried = self.transport(step, problem.zero)
        both = problem.unit * problem.entries(problem.zero) + carried.entries
        return both[self.pattern.diagonal]

    def nodal(self, values: np.ndarray) -> np.ndarray:
        """Dimensionless pressures at all nodes."""
        nodal = self.film.equation.given.copy()
        nodal[self.unknown] = np.where(self.dry, 0.0, values)
        return nodal

    def full_film(self, step: OilStep, nodal: np.ndarray) -> np.ndarray:
        """Balance at all nodes without the void fraction."""
        # Contents are summed in one way only: two sums differ by round-off, by which oil would be
        # lost in every step.
        full = step.full
        if not self.film.parameters.lubricant.density_law.constant:
            density = self.film.equation.flow(step.gap, nodal).density
            full = self.assembly.source(density * step.flow.thickness) / step.length
        lost = self.film.equation.balance(step.driven, nodal) + full - step.former
        return lost if step.feed is None else lost + step.feed.lumped(self.assembly, nodal)

    def outflow(
        self, step: OilStep, nodal: np.ndarray, values: np.ndarray, transport: Transport
    ) -> np.ndarray:
        """Flow through the ends of the film, zero at other nodes, shape (nodes,).

        Parameters
        ----------
        step, nodal, transport
            One time step, pressures of all nodes, and the transport of their void fractions.
        values
            Unknowns of the nodes: pressures, at dry sides outflows.
        """
        outflow = transport.nodal - self.full_film(step, nodal)
        outflow[self.film.free] = 0.0
        outflow[self.unknown[self.dry]] = values[self.dry]
        return outflow

    def gap_derivatives(
        self, step: OilStep, nodal: np.ndarray, carried: Transport
    ) -> tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix | None]:
        """Derivatives of the balance with upstream nodes held, see `ReynoldsEquation`."""
        slope = step.flow.slope / self.film.parameters.clearance
        slope = np.broadcast_to(slope, step.gap.thickness.shape)
        full = self.film.equation.gap_derivatives(step.gap, nodal, inputs=step.inputs)
        if carried.void.any():
            share = carried.carried[self.strips.passing][:, None, :]
            for along, dragged in zip(full, self._dragged(step, slope), strict=True):
                if along is not None:
                    along.data -= (dragged * share).ravel()
            lost = (slope * step.flow.density / step.length)[:, :, None]
            stored = lost * self.assembly.by_nodes(carried.void)
            full[0].data -= with_weights(self.assembly.tested, stored).data
        if step.feed is not None:
            fed = slope * step.feed.along_thickness
            full[0].data += step.feed.lumped_change(self.assembly, fed, nodal).data
        return full

    def _dragged(self, step: OilStep, slope: np.ndarray) -> list[np.ndarray | None]:
        """Derivatives along the gap of the Couette term of a film without pressure.

        Entries of the matrices of `Assembly.tested`, shape (c, q, k).
        """
        equation = self.film.equation
        flow = step.flow
        drag = self.assembly.drag
        if equation.laws.dragging:
            none = np.zeros_like(equation.given)
            derivatives = equation.gap_derivatives(step.gap, none, inputs=step.driven)
            return [None if d is None else d.data.reshape(drag.shape) for d in derivatives]
        # Between surfaces of one roughness the flow is a product of thickness and mean velocity.
        speed = self.film.parameters.rate * self.film.parameters.grid.radius
        along = slope * flow.velocity, flow.thickness / speed
        return [(flow.density * slope)[:, :, None] * drag for slope in along] + [None]

    def along_turn(self, step: OilStep, nodal: np.ndarray) -> np.ndarray:
        """Change of the balance with the journal's angle, shape (nodes,) [1/rad]."""
        assert step.feed is not None
        return step.feed.lumped(self.assembly, nodal, step.feed.along_turn)


def require_monotone(family: str, key: str = "film.element") -> None:
    """Refuse elements whose matrices are no M-matrices.

    Raises
    ------
    SettingsError
        The message contains the setting.
    """
    if family != "bilinear":
        raise SettingsError(
            f"{key} = '{family}' cannot conserve mass without negative fluid fractions: "
            "cavitation = 'mass-conserving' needs element = 'bilinear'"
        )
