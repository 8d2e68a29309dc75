"""Transport of the empty part of the gap by the moving surfaces, second order and limited.

The nodes of one height form a strip around the bore. With the shape function
``N_i = A_i(phi) Z(z)`` of node i of a strip, the full-film Couette term of the
weak form is a difference of flows between neighbours,

    -int rho H V dN_i/dphi = F_i - F_(i-1),   F_i = -int rho H V dN_i/dphi behind node i,

"behind": over the cells between i and the following node. Where the gap is empty to
the void fraction s, a flow carries the fraction c at the middle of its cell,

    t(s)_i = F_i c_i - F_(i-1) c_(i-1) + d/dt (int rho H N_i) s_i.

A full film is not touched (s = 0), an empty one stands still (s = 1 cancels the
Couette term to round-off), nothing is lost between nodes, and strips do not mix.

**Limiter.** c is extrapolated from the node u that the flow comes from, by the harmonic mean of
the slopes on both sides of it (van Leer, J. Comput. Phys. 14, 1974, 361). With b the node before u
and a the one that the flow goes to, l their cells' lengths,

    c = s_u + x y / (x + y)  where x y > 0, else s_u;   x = (s_u - s_b) l_a / l_b,   y = s_a - s_u.

Second order where s is smooth, first order at its extremes; c lies between s_u and s_a, so that
nothing leaves an empty film and no more than all a full one. In the form of Harten (J. Comput.
Phys. 49, 1983, 357), ``F (c_i - c_(i-1)) = C F (s_i - s_(i-1))`` with C >= 0: implicit Euler adds
no variation and no extreme, whatever the step.

**Derivative.** The node that a flow comes from held, with kinks of c where x y = 0,

    dc = ds_u + (y / (x + y))^2 dx + (x / (x + y))^2 dy,

so that second neighbours belong to the pattern, too.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.film.assembly import Assembly
from fenics_ehd.film.pattern import Pattern

#: Nodes of a bilinear cell, in pairs around.
LEFT, RIGHT = [0, 2], [1, 3]


class Strips:
    """Flows along the strips of a film mesh.

    Parameters
    ----------
    assembly
        Of a bilinear mesh.

    Attributes
    ----------
    following, preceding
        Node after and before every node of its strip, shape (nodes,).
    pattern
        Of the derivative of t on the assembly's free nodes: that of the assembly and second
        neighbours.
    """

    def __init__(self, assembly: Assembly):
        nodes = assembly.grid.cell_nodes
        around, along = assembly.grid.cell_sizes
        self._assembly = assembly
        self._length = along[:, None]
        #: Flow through the lower and upper half of a cell, from every Gauss point.
        self._flow = -assembly.tensors.flux_around[:, LEFT]
        self._from = nodes[:, LEFT]
        self._own = np.arange(assembly.size)
        self.following = np.empty(assembly.size, dtype=int)
        self.following[self._from] = nodes[:, RIGHT]
        self.preceding = np.empty_like(self.following)
        self.preceding[self.following] = self._own
        self._second = self.following[self.following]
        length = np.empty(assembly.size)
        length[self._from] = around[:, None]
        #: Length of a flow's cell over that of the cell behind it, for flows on and back.
        self._ratio = length / length[self.preceding], length / length[self.following]
        self._number_entries()

    def _number_entries(self) -> None:
        """The pattern, and in it the places of what every flow puts into two rows."""
        a, n = self._assembly, len(self._assembly.free)
        number = np.full(a.size, -1)
        number[a.free] = np.arange(n)
        rows = number[np.stack([self._own, self.following])][:, None]
        columns = number[np.stack([self.preceding, self._own, self.following, self._second])]
        codes = np.where((rows < 0) | (columns < 0), -1, rows * n + columns)
        near = a.pattern.rows * n + a.pattern.indices
        every = np.union1d(near, codes[codes >= 0])
        starts = np.searchsorted(every, n * np.arange(n + 1))
        self.pattern = Pattern(starts.astype(np.int32), (every % n).astype(np.int32))
        self._near = np.searchsorted(every, near)
        # Entries of other nodes go to a bin behind the last one.
        self._places = np.where(codes < 0, len(every), np.searchsorted(every, codes))

    def widened(self, entries: np.ndarray) -> np.ndarray:
        """Entries of a matrix of the assembly's pattern in the order of `pattern`."""
        found = np.zeros(len(self.pattern.indices))
        found[self._near] = entries
        return found

    def flows(self, transport: np.ndarray) -> np.ndarray:
        """Full-film flow ``F_i`` from every node to the following one, shape (nodes,).

        `transport` is ``rho H V`` at the Gauss points, shape (c, q).
        """
        element = (transport * self._length) @ self._flow
        return np.bincount(self._from.ravel(), element.ravel(), self._assembly.size)

    def _slopes(
        self, flows: np.ndarray, void: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """``s_u``, x, and y over x + y, 0 where x y <= 0; and where flows lead on."""
        on = flows > 0
        start = np.where(on, void, void[self.following])
        behind = np.where(on, void[self.preceding], void[self._second])
        x = np.where(on, *self._ratio) * (start - behind)
        y = np.where(on, void[self.following], void) - start
        rising = x * y > 0
        share = np.divide(y, x + y, out=np.zeros_like(y), where=rising)
        return start, x, share, on

    def carried(self, flows: np.ndarray, void: np.ndarray) -> np.ndarray:
        """Void fraction c carried by every flow, shape (nodes,)."""
        start, x, share, _ = self._slopes(flows, void)
        return start + x * share

    def apply(self, flows: np.ndarray, storage: np.ndarray, void: np.ndarray) -> np.ndarray:
        """``t(s)`` at all nodes; `storage` is ``int rho H N_i`` over the time step."""
        carried = flows * self.carried(flows, void)
        return carried - carried[self.preceding] + storage * void

    def derivative(self, flows: np.ndarray, storage: np.ndarray, void: np.ndarray) -> np.ndarray:
        """Entries of ``dt/ds`` on the assembly's free nodes, in the order of `pattern`."""
        _, x, share, on = self._slopes(flows, void)
        behind = -np.where(on, *self._ratio) * share**2
        ahead = np.where(share > 0, 1.0 - share, 0.0) ** 2
        start = 1.0 - behind - ahead
        none = np.zeros_like(x)
        columns = np.where(on, [behind, start, ahead, none], [none, ahead, start, behind])
        values = np.stack([flows * columns, -flows * columns])
        count = len(self.pattern.indices)
        entries = np.bincount(self._places.ravel(), values.ravel(), count + 1)[:count]
        entries[self.pattern.diagonal] += storage[self._assembly.free]
        return entries

    def elements(self, coefficient: np.ndarray, carried: np.ndarray) -> np.ndarray:
        """Derivative of ``t(s)`` without storage along the gap, what flows come from held.

        Element data (c, q, k) for `Assembly.gather`.

        Parameters
        ----------
        coefficient
            Derivative of ``rho H V`` along a direction's value, (c, q).
        carried
            From `carried`.
        """
        weights = (coefficient * self._length)[:, :, None] * self._flow
        weights *= carried[self._from][:, None, :]
        element = np.empty((*coefficient.shape, len(LEFT + RIGHT)))
        element[:, :, LEFT] = weights
        element[:, :, RIGHT] = -weights
        return element
