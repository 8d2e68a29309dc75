"""Mass-conserving cavitation (JFO): oil balance of a film that is partly empty.

**Transport** of the void by the moving surfaces is of second order, with a slope limiter. The nodes
of one height form a strip around the bore. With the shape function ``N_i = A_i(phi) Z(z)`` of node
i of a strip, the full-film Couette term of the weak form is a difference of flows between adjacent
nodes,

    -int rho H V dN_i/dphi = F_i - F_(i-1),   F_i = -int rho H V dN_i/dphi after node i,

the last integral over the cells between node i and the following one. If the void fraction of the
gap is s, a flow carries the void fraction c at the middle of its cell,

    t(s)_i = F_i c_i - F_(i-1) c_(i-1) + d/dt (int rho H N_i) s_i.

In a full film (s = 0) t is zero; in an empty film (s = 1) t cancels the Couette term to round-off.
No oil is lost between nodes, and strips do not exchange void.

**Limiter.** c is extrapolated from the node u upstream of the flow, by the harmonic mean of
the slopes on both sides of u (van Leer, J. Comput. Phys. 14, 1974, 361). With b the node before u
and a the node after u in the direction of the flow, and l the lengths of the cells before and after
u,

    c = s_u + x y / (x + y)  if x y > 0, else s_u;   x = (s_u - s_b) l_a / l_b,   y = s_a - s_u.

The order is two where s is smooth, and one at its extremes. c lies between s_u and s_a, so that no
oil flows out of an empty node, and no more than its content out of a full node. In the form of
Harten (J. Comput. Phys. 49, 1983, 357), ``F (c_i - c_(i-1)) = C F (s_i - s_(i-1))`` with C >= 0:
steps of implicit Euler of any length add no variation and no extreme.

**Derivative.** For fixed upstream nodes, and except at x y = 0, where c has kinks,

    dc = ds_u + (y / (x + y))^2 dx + (x / (x + y))^2 dy,

so that second neighbours belong to the sparsity pattern, too.

**Balance** (Jakobsson and Floberg 1957, Olsson 1965). Oil fills the fraction ``theta = 1 - s`` of
the gap. Either the film is full, s = 0, or the pressure is the cavitation pressure, p = 0. The oil
of every node i is conserved, dimensionless as in `fenics_ehd.film.weak_form`,

    int k grad p . grad N_i - rho H V dN_i/dphi + (M_i - M_i^old) / dt - t(s)_i = 0,

where ``M_i = int rho H N_i`` is the oil content of a full gap and ``M_i^old`` the content at the
start of the step. Time is integrated by implicit Euler or a multistep formula. The balance is
``r(p) = t(s)`` with ``p >= 0`` complementary to ``s >= 0``. The squeeze term is the difference of
two contents, not `Gap.thickness_rate`, because only the difference conserves oil from step to step.

``t^-1(r(p)) >= 0`` as a function of p alone is not used: t transports along the film, so that the
sign of one component depends on all the nodes upstream. With p and s as variables SNES-VI solves

    p >= 0   complementary to   s + gamma d >= 0,      d = r(p) - t(s) = 0.

``gamma d`` vanishes at the solution. During the iteration the Newton update of a full node may be
negative and cut off at p = 0. This node must become empty, but its void fraction is zero: only its
defect d has the right sign. Each Newton step then solves

    A_I p_I - T_C s_C = b,    A = dr/dp,  T = dt/ds,

on the full nodes I and the other nodes C. It is one sparse system with one pattern
(`ActiveSetSystem`). Nodes with a wrong sign then move from I to C, or back.

For fixed ratios ``c / s_u``, t is linear. No entry off the diagonals of A and t is positive,
and no column sum is negative. The same holds for every matrix that consists of the columns of A for
full nodes and of t for the others. All these matrices are M-matrices, so that theta is never
negative. For A the proof requires bilinear cells that are at most 1.4 times as long as wide; in
practice theta is positive on cells 9 times as long as wide, too. 9-node cells are excluded: theta
is -0.1 next to the ends of a short groove.

Nodes with a given pressure above cavitation, and grooves and holes at any pressure, are reservoirs:
theta = 1, and oil flows in or out. A side at cavitation pressure is no reservoir: the unknown of
its nodes is the outflow, which is positive if the film is full there, and zero otherwise. The flow
of `FilmParameters.feeds` into the film, ``w kappa (p_s - p)``, is ``w kappa p_s`` at empty nodes.
This flow is lumped at the nodes, so that all matrices remain M-matrices.

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

#: Dimensionless rate of oil contents below which a source counts as zero.
SMALLEST_SOURCE = 1e-6

#: Numbers in a bilinear cell of the two nodes at its smaller angle, the lower node first.
LEFT = [0, 2]

#: Numbers in a bilinear cell of the two nodes at its larger angle, the lower node first.
RIGHT = [1, 3]


class Strips:
    """Strips of a film mesh, the nodes of one height each, and the flows between their nodes.

    Parameters
    ----------
    assembly
        Shape functions of a bilinear mesh at its Gauss points.
    unknown
        Indices of the nodes with an unknown; the transport of void, t, is differentiated with
        respect to the void fractions of these nodes.

    Attributes
    ----------
    assembly, unknown
        Arguments of the constructor.
    following, preceding, second
        Index of the next node, the previous node and the node after the next one in the strip of
        every node, shape (nodes,) each.
    passing
        For every node of a cell: index of the node at which the flow through the cell in the strip
        of that node starts. Shape (c, k), for the k nodes of c cells in ascending order.
    ratio
        Length of the cell between every node and the following one, over the length of the next
        cell upstream. Two arrays, shape (nodes,): for flow to the following node, and for flow from
        it.
    pattern
        Sparsity pattern of the derivative of t on the unknown nodes, second neighbours included.
    entry_indices
        Indices in `pattern` of the derivatives of the flow after every node, shape (2, 4, nodes).
        The rows are those of the node and of the following node. The columns are those of the
        preceding node, the node, the following node and the node after it. Entries that the pattern
        does not have get the index after the last entry.
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
        """Number the entries of all flows' derivatives: set `pattern` and `entry_indices`."""
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
        self.entry_indices = np.where(codes < 0, len(every), np.searchsorted(every, codes))

    def flows(self, transport: np.ndarray) -> np.ndarray:
        """Flow from every node to the following one in a full film without pressure, (nodes,).

        `transport` is the product ``rho H V`` of density, thickness and mean velocity at the Gauss
        points, shape (c, q).
        """
        element = (transport * self._length) @ self._flow
        return np.bincount(self._from.ravel(), element.ravel(), self.assembly.size)


@dataclass(frozen=True, eq=False)
class Transport:
    """Transport ``t(s)`` of a void fraction s by given flows, dimensionless.

    Attributes
    ----------
    strips
        Strips of the film.
    flows
        Full-film flow ``F_i`` from every node to the following one, shape (nodes,).
    storage
        Full contents ``int rho H N_i`` over the length of the time step, shape (nodes,).
    void
        Void fraction s of the nodes, shape (nodes,).
    """

    strips: Strips
    flows: np.ndarray
    storage: np.ndarray
    void: np.ndarray

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Terms of the slope limiter for the flow after every node, four arrays (nodes,).

        The first two are the void fraction ``s_u`` of the upstream node, and the slope x before
        this node. The third is the ratio ``y / (x + y)`` with the slope y after the node; it is 0
        if ``x y <= 0``. The last is a mask of flows to the following node.
        """
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
        """Void fraction c that the flow after every node carries, shape (nodes,)."""
        start, x, share, _ = self._slopes
        return start + x * share

    @property
    def nodal(self) -> np.ndarray:
        """Transport ``t(s)`` of the void fraction s at all nodes, shape (nodes,)."""
        carried = self.flows * self.carried
        return carried - carried[self.strips.preceding] + self.storage * self.void

    @property
    def values(self) -> np.ndarray:
        """Transport ``t(s)`` of the void fraction s at the m nodes with an unknown, (m,)."""
        return self.nodal[self.strips.unknown]

    @cached_property
    def entries(self) -> np.ndarray:
        """Entries of the derivative of the transport ``t(s)`` with respect to the void fraction s.

        Rows and columns are those of the nodes with an unknown, in the order of `Strips.pattern`.
        """
        strips = self.strips
        (_, x, share, on) = self._slopes
        behind = -np.where(on, *strips.ratio) * share**2
        ahead = np.where(share > 0, 1.0 - share, 0.0) ** 2
        start = 1.0 - behind - ahead
        none = np.zeros_like(x)
        columns = np.where(on, [behind, start, ahead, none], [none, ahead, start, behind])
        values = np.stack([self.flows * columns, -self.flows * columns])
        count = len(strips.pattern.indices)
        entries = np.bincount(strips.entry_indices.ravel(), values.ravel(), count + 1)[:count]
        entries[strips.pattern.diagonal] += self.storage[strips.unknown]
        return entries


@dataclass(frozen=True, eq=False)
class OilStep:
    """Data of the oil balance for one time step, dimensionless.

    Attributes
    ----------
    gap
        Nominal gap at the end of the step.
    flow
        Oil and its flow at the end of the step in a film without pressure.
    driven
        Data of the weak form without a source, for the flows through the film.
    inputs
        Data of the weak form whose source is the rate of the oil content, for derivatives.
    length
        Length of the step; for a multistep formula, the inverse of the derivative of the rate with
        respect to the oil content.
    flows
        Full-film flow from every node to the following one, shape (nodes,).
    full
        Oil content of the nodes of a full gap without pressure, over `length`, shape (nodes,).
    former
        Oil content at the start of the step, over `length`, shape (nodes,). For a multistep
        formula, minus the rate that it gives for contents of zero at the end of the step.
    feed
        Term of the supplies; None without supplies.
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
    """Oil balance of one film with mass-conserving cavitation.

    Parameters
    ----------
    film
        Film on a bilinear mesh.
    oil_outside
        Whether oil surrounds the bearing also at sides at cavitation pressure, so that their nodes
        are reservoirs.

    Attributes
    ----------
    unknown
        Indices of the m nodes with an unknown. At nodes of unknown pressure it is the pressure or
        the void fraction. At dry sides (at cavitation pressure, without oil outside) it is the
        outflow or the void fraction.
    dry
        Mask of the nodes of dry sides among `unknown`, shape (m,).
    pattern
        Sparsity pattern of the derivatives with respect to pressure and void fraction, m x m.
    """

    def __init__(self, film: Film, *, oil_outside: bool = False):
        self.film = film
        # `dry` are the nodes of given pressure that are no reservoirs.
        empty = (film.equation.given == 0.0) & ~film.supplied_nodes & (not oil_outside)
        dry = np.setdiff1d(np.flatnonzero(empty), film.free)
        self.unknown = np.union1d(film.free, dry)
        self.dry = np.isin(self.unknown, dry)
        self.assembly = film.assembly
        self.strips = Strips(self.assembly, self.unknown)
        self.pattern = self.strips.pattern
        self._entry_indices = film.equation.forms.entry_indices(self.pattern, self.unknown)
        self._dry_column = self.dry[self.pattern.indices]

    @property
    def volume_scale(self) -> float:
        """Unit of oil contents, ``c R^2`` [m^3]."""
        p = self.film.parameters
        return p.clearance * p.grid.radius**2

    def ending(self, gap: Gap, length: float, former: np.ndarray) -> OilStep:
        """Make the data of a time step from the gap at its end.

        The arguments `length` and `former` are described at the attributes of `OilStep` with these
        names.
        """
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
        """Residual of the oil balance without transport of void, and its derivative.

        The unknowns are pressures, and outflows at dry sides.
        """

        def residual(values: np.ndarray) -> np.ndarray:
            defect = self.full_film(step, self.nodal(values))[self.unknown]
            return defect + np.where(self.dry, values, 0.0)

        def entries(values: np.ndarray) -> np.ndarray:
            entries_of_all = self.film.equation.forms.matrix(step.inputs, self.nodal(values))
            # Entries of second neighbours are missing in the matrix of the forms: they are zero.
            matrix = np.append(entries_of_all, 0.0)[self._entry_indices]
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
        """Transport of the void fractions `void` of the m nodes with an unknown, shape (m,)."""
        nodal = np.zeros(self.assembly.size)
        nodal[self.unknown] = void
        return Transport(self.strips, step.flows, step.full, nodal)

    def rows(self, step: OilStep, problem: Complementarity) -> np.ndarray:
        """Scale of the equation of each of the m unknowns in a nearly full film, shape (m,).

        The scale is the sum of the diagonal entries of the derivatives with respect to scaled
        pressure and to void fraction.
        """
        carried = self.transport(step, problem.zero)
        both = problem.unit * problem.entries(problem.zero) + carried.entries
        return both[self.pattern.diagonal]

    def nodal(self, values: np.ndarray) -> np.ndarray:
        """Dimensionless pressures at all nodes, shape (nodes,), from the unknowns, shape (m,)."""
        nodal = self.film.equation.given.copy()
        nodal[self.unknown] = np.where(self.dry, 0.0, values)
        return nodal

    def full_film(self, step: OilStep, nodal: np.ndarray) -> np.ndarray:
        """Defect of the oil balance of a full film at all nodes, for pressures `nodal`."""
        # Contents are summed in one way only: if two sums differed by round-off, oil would be lost
        # in every step.
        full = step.full
        if not self.film.parameters.lubricant.density_law.constant:
            density = self.film.equation.flow(step.gap, nodal).density
            full = self.assembly.source(density * step.flow.thickness) / step.length
        lost = self.film.equation.balance(step.driven, nodal) + full - step.former
        return lost if step.feed is None else lost + step.feed.lumped(self.assembly, nodal)

    def outflow(
        self, step: OilStep, nodal: np.ndarray, values: np.ndarray, transport: Transport
    ) -> np.ndarray:
        """Flow out of the film at nodes of given pressure, zero at other nodes, shape (nodes,).

        Parameters
        ----------
        step, nodal, transport
            Time step, pressures of all nodes, and transport of their void fractions.
        values
            Unknowns, shape (m,): pressures, and outflows at dry sides.
        """
        outflow = transport.nodal - self.full_film(step, nodal)
        outflow[self.film.free] = 0.0
        outflow[self.unknown[self.dry]] = values[self.dry]
        return outflow

    def gap_derivatives(
        self, step: OilStep, nodal: np.ndarray, carried: Transport
    ) -> tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix | None]:
        """Derivatives of the oil balance with respect to the gap, for fixed upstream nodes.

        The three results have the form of the results of `ReynoldsEquation.gap_derivatives`.
        """
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
        """Derivatives with respect to the gap of the Couette term of a film without pressure.

        The three arrays are the derivatives with respect to thickness, mean velocity and sliding
        velocity. They are entries of matrices of the shape of `Assembly.tested`: shape (c, q, k),
        for c cells with q Gauss points and k nodes.
        """
        equation = self.film.equation
        flow = step.flow
        drag = self.assembly.drag
        if equation.laws.dragging:
            none = np.zeros_like(equation.given)
            derivatives = equation.gap_derivatives(step.gap, none, inputs=step.driven)
            return [None if d is None else d.data.reshape(drag.shape) for d in derivatives]
        # Unless one surface is rougher, the flow is the product of thickness and mean velocity.
        speed = self.film.parameters.rate * self.film.parameters.grid.radius
        along = slope * flow.velocity, flow.thickness / speed
        return [(flow.density * slope)[:, :, None] * drag for slope in along] + [None]

    def along_turn(self, step: OilStep, nodal: np.ndarray) -> np.ndarray:
        """Derivative of the oil balance with respect to the journal's angle [1/rad], (nodes,)."""
        assert step.feed is not None
        return step.feed.lumped(self.assembly, nodal, step.feed.along_turn)


def require_monotone(family: str, key: str = "film.element") -> None:
    """Refuse an element family whose matrices are no M-matrices.

    Raises
    ------
    SettingsError
        If the family is not bilinear; the message names the key.
    """
    if family != "bilinear":
        raise SettingsError(
            f"{key} = '{family}' cannot conserve mass without negative fluid fractions: "
            "cavitation = 'mass-conserving' needs element = 'bilinear'"
        )
