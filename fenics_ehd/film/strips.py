"""Transport of the empty part of the gap by the moving surfaces, first-order upwind.

The nodes of one height form a strip around the bore. With the shape function
``N_i = A_i(phi) Z(z)`` of node i of a strip, the full-film Couette term of the
weak form is a difference of flows between neighbours,

    -int rho H V dN_i/dphi = F_i - F_(i-1),   F_i = -int rho H V dN_i/dphi behind node i,

"behind": over the cells between i and the following node. Where the gap is empty to
the void fraction s, a flow carries that of the node it comes from,

    (T s)_i = F_i s_up - F_(i-1) s_up + d/dt (int rho H N_i) s_i.

A full film is not touched (s = 0), an empty one stands still (s = 1 cancels the
Couette term to round-off), nothing is lost between nodes, strips do not mix, and
T has positive diagonal, no positive entry beside it and column sums that are the
storage alone: an M-matrix.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.film.assembly import Assembly

#: Nodes of a bilinear cell, in pairs around.
LEFT, RIGHT = [0, 2], [1, 3]


class Strips:
    """Flows along the strips of a film mesh.

    Parameters
    ----------
    assembly
        Of a bilinear mesh; its pattern is that of the matrices made here.

    Attributes
    ----------
    following, preceding
        Node after and before every node of its strip, shape (nodes,).
    """

    def __init__(self, assembly: Assembly):
        nodes = assembly.grid.cell_nodes
        self._assembly = assembly
        self._length = assembly.grid.cell_sizes[1][:, None]
        #: Flow through the lower and upper half of a cell, from every Gauss point.
        self._flow = -assembly.tensors.flux_around[:, LEFT]
        self._from = nodes[:, LEFT]
        self.following = np.empty(assembly.size, dtype=int)
        self.following[self._from] = nodes[:, RIGHT]
        self.preceding = np.empty_like(self.following)
        self.preceding[self.following] = np.arange(assembly.size)
        self._number_entries()

    def _number_entries(self) -> None:
        """Places of diagonal and neighbours in the pattern, -1 where a neighbour is not in it."""
        a = self._assembly
        n = len(a.free)
        number = np.full(a.size, -1)
        number[a.free] = np.arange(n)
        codes = a.pattern.rows * n + a.pattern.indices

        def places(columns: np.ndarray) -> np.ndarray:
            known = np.searchsorted(codes, np.arange(n) * n + np.maximum(columns, 0))
            return np.where(columns >= 0, known, -1)

        self._diagonal = places(np.arange(n))
        self._after = places(number[self.following[a.free]])
        self._before = places(number[self.preceding[a.free]])

    def flows(self, transport: np.ndarray) -> np.ndarray:
        """Full-film flow ``F_i`` from every node to the following one, shape (nodes,).

        `transport` is ``rho H V`` at the Gauss points, shape (c, q).
        """
        element = (transport * self._length) @ self._flow
        return np.bincount(self._from.ravel(), element.ravel(), self._assembly.size)

    def upwind(self, flows: np.ndarray, void: np.ndarray) -> np.ndarray:
        """Void fraction carried by every flow: that of the node it comes from, shape (nodes,)."""
        return np.where(flows > 0, void, void[self.following])

    def apply(self, flows: np.ndarray, storage: np.ndarray, void: np.ndarray) -> np.ndarray:
        """``T s`` at all nodes; `storage` is ``int rho H N_i`` over the time step."""
        carried = flows * self.upwind(flows, void)
        return carried - carried[self.preceding] + storage * void

    def matrix(self, flows: np.ndarray, storage: np.ndarray) -> np.ndarray:
        """Entries of T on the assembly's free nodes, in the order of its pattern."""
        free = self._assembly.free
        out, into = flows[free], flows[self.preceding[free]]
        entries = np.zeros(len(self._assembly.pattern.indices))
        entries[self._diagonal] = np.maximum(out, 0) + np.maximum(-into, 0) + storage[free]
        for place, value in ((self._after, out), (self._before, -into)):
            known = place >= 0
            entries[place[known]] = np.minimum(value[known], 0)
        return entries

    def elements(self, coefficient: np.ndarray, carried: np.ndarray) -> np.ndarray:
        """Derivative of ``T s`` without storage, the upwind side held.

        Element data (c, q, k) for `Assembly.gather`.

        Parameters
        ----------
        coefficient
            Derivative of ``rho H V`` along a direction's value, (c, q).
        carried
            Void fraction carried by every flow, from `upwind`.
        """
        weights = (coefficient * self._length)[:, :, None] * self._flow
        weights *= carried[self._from][:, None, :]
        element = np.empty((*coefficient.shape, len(LEFT + RIGHT)))
        element[:, :, LEFT] = weights
        element[:, :, RIGHT] = -weights
        return element
