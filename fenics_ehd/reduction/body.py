"""The reduced body: everything the time simulation needs, and no part-size array."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction.bore import BoreSurface, all_outward, only
from fenics_ehd.reduction.inertia import ELASTIC, InertiaIntegrals
from fenics_ehd.reduction.rigid_motion import rigid_fields


@dataclass(frozen=True, eq=False)
class ResidualFlexibility:
    """Bore flexibility beyond the coordinates, answered at once (M4).

    Attributes
    ----------
    displacement
        Of the nodes of all bores for unit amplitudes of the r patterns, shape (m, 3, r) [m/Pa].
    patterns
        Orthonormal pressure patterns over all bores, shape (r, k): the amplitudes of nodal
        pressures w are ``patterns @ w`` [Pa].
    stiffness
        Energy of unit amplitudes, twice: diagonal of ``V^T J^T G_res J V``, shape (r,),
        [J/Pa^2]. The generalised force of a pressure on an amplitude is this times the
        amplitude of the pressure.
    mass
        Mass matrix of the patterns' displacements, shape (r, r) [kg m^2/Pa^2]: neglected by the
        method, known for its error estimate; empty when not computed.
    """

    displacement: np.ndarray
    patterns: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray

    @property
    def rank(self) -> int:
        """Number r of patterns."""
        return len(self.stiffness)


@dataclass(frozen=True)
class ModeRecord:
    """One line of the mode inventory.

    Attributes
    ----------
    kind
        What sort of mode.
    frequency
        Natural frequency of the mode taken alone [Hz], infinite without mass.
    participation
        Its share of the bore's flexibility, the trace of ``J^T G J``; of the flexibility
        listed when the whole is not known.
    dropped
        Why it was left out, empty when it was kept.
    """

    kind: str
    frequency: float
    participation: float
    dropped: str = ""


def unknown() -> np.ndarray:
    """A matrix that was not given."""
    return np.zeros((0, 0))


class BoreRows(NamedTuple):
    """One of a body's bores and where its nodes and pressure nodes are among those of all."""

    name: str
    surface: BoreSurface
    nodes: slice
    pressures: slice


@dataclass(frozen=True, eq=False)
class ReducedBody:
    """A part described by ``n`` modal coordinates.

    Attributes
    ----------
    method
        Reduction method: ``"m1"`` to ``"m4"``, ``"full"`` or ``"rigid"``.
    frame
        Floating frame: ``"mean-axis"``, ``"bore-centre"`` or, of a part held by its
        support, ``"clamped"``.
    stiffness, mass
        ``T^T K T`` [N/m] and ``T^T M T`` [kg], shape (n, n). Damping is ``zeta`` times the
        stiffness with the zeta of the scene.
    frequencies
        Natural frequency of each coordinate taken alone [Hz], shape (n,).
    kinds
        ``"vibration"``, ``"fixed-boundary"``, ``"constraint"`` or ``"static"`` for each
        coordinate.
    bores
        Surface of every bore by name; m nodes and k pressure nodes are those of all of them,
        one bore after the other. The frame's origin is the centre of the first.
    bore_basis
        Displacement of the bore nodes for unit coordinates, shape (m, 3, n).
    load_projection
        ``B^T J``, shape (3 + n, k): generalised force of nodal pressures on the
        fields of `InertiaIntegrals`.
    spin_load_projection
        ``(S B)^T J``, same shape: their moment about z.
    inertia
        Inertia integrals of plane motion.
    points
        Mean displacement of each boundary point for the same fields, shape (3, 3 + n).
    missing_flexibility
        Outward bore displacement per nodal pressure that the basis cannot
        follow, shape (m, k) [m/Pa]; empty when not computed.
    mesh_flexibility
        Outward displacement of the bore nodes that the part has more than its mesh under smooth
        pressures, see `fenics_ehd.reduction.mesh_error`, shape (m, s) [m/Pa]; empty when unknown.
    rigid_mass, rigid_coupling
        ``R^T M R``, shape (6, 6), and ``R^T M T``, shape (6, n), of the unit translations
        and rotations R about the bore's centre; empty when unknown.
    rigid_load
        ``R^T J``, shape (6, k): force and moment of nodal pressures; empty when unknown.
    residual
        Flexibility that M4 adds without coordinates, None for the other methods.
    inventory
        Every mode kept and dropped.
    accuracy
        Figures of the reduction: rank, dropped columns, residuals.
    provenance
        What the body was made from, text by name.
    columns
        The part-size basis T, rows owned by this rank, when it was asked for; not in the
        body's file (see `save_basis`).
    """

    method: str
    frame: str
    stiffness: np.ndarray
    mass: np.ndarray
    frequencies: np.ndarray
    kinds: tuple[str, ...]
    bores: Mapping[str, BoreSurface]
    bore_basis: np.ndarray
    load_projection: np.ndarray
    spin_load_projection: np.ndarray
    inertia: InertiaIntegrals
    points: Mapping[str, np.ndarray]
    missing_flexibility: np.ndarray
    mesh_flexibility: np.ndarray = field(default_factory=unknown)
    rigid_mass: np.ndarray = field(default_factory=unknown)
    rigid_coupling: np.ndarray = field(default_factory=unknown)
    rigid_load: np.ndarray = field(default_factory=unknown)
    residual: ResidualFlexibility | None = None
    inventory: tuple[ModeRecord, ...] = ()
    accuracy: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    columns: np.ndarray | None = None

    def __post_init__(self) -> None:
        # Products round differently for another memory order; a body read from a file is
        # row-major, and must give the same run to the last bit.
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, np.ndarray) and f.name != "columns":
                object.__setattr__(self, f.name, np.ascontiguousarray(value))

    @property
    def modes(self) -> int:
        """Number of elastic coordinates n."""
        return len(self.frequencies)

    @property
    def bore(self) -> BoreSurface:
        """The bore of a body that has one.

        Raises
        ------
        SettingsError
            The body has several.
        """
        return only(self.bores, "reduced body")

    @property
    def bore_nodes(self) -> np.ndarray:
        """Positions of the nodes of the one bore, shape (m, 3) [m]."""
        return self.bore.coordinates

    @property
    def pressure_nodes(self) -> np.ndarray:
        """Positions of the pressure nodes of the one bore, shape (k, 3) [m]."""
        return self.bore.pressure_coordinates

    def each_bore(self) -> Iterator[BoreRows]:
        """The bores, one after the other."""
        nodes = pressures = 0
        for name, bore in self.bores.items():
            last, end = nodes + len(bore.coordinates), pressures + len(bore.pressure_coordinates)
            yield BoreRows(name, bore, slice(nodes, last), slice(pressures, end))
            nodes, pressures = last, end

    def rows_of(self, name: str) -> BoreRows:
        """One of the bores.

        Raises
        ------
        SettingsError
            There is none of this name.
        """
        for rows in self.each_bore():
            if rows.name == name:
                return rows
        raise SettingsError(f"the reduced body has no bore {name!r}: {', '.join(self.bores)}")

    def places(self, *, of_pressures: bool = False) -> np.ndarray:
        """Positions of nodes or pressure nodes of all bores, from the origin, (m or k, 3) [m]."""
        name = "pressure_coordinates" if of_pressures else "coordinates"
        return np.vstack([bore.centre + getattr(bore, name) for bore in self.bores.values()])

    def at_bore(self, name: str) -> ReducedBody:
        """The body with one of its bores alone: what a film there sees of it.

        Raises
        ------
        SettingsError
            It has no such bore.
        """
        _, surface, nodes, pressures = self.rows_of(name)
        if len(self.bores) == 1:
            return self
        r = self.residual
        if r is not None:
            r = replace(r, displacement=r.displacement[nodes], patterns=r.patterns[:, pressures])
        missing = self.missing_flexibility
        return replace(
            self,
            bores={name: surface},
            bore_basis=self.bore_basis[nodes],
            load_projection=self.load_projection[:, pressures],
            spin_load_projection=self.spin_load_projection[:, pressures],
            missing_flexibility=missing[nodes, pressures] if missing.size else missing,
            rigid_load=self.rigid_load[:, pressures] if self.rigid_load.size else self.rigid_load,
            residual=r,
        )

    def outward(self, displacements: np.ndarray) -> np.ndarray:
        """Radial component at the nodes of all bores, shape (m, 3, n) to (m, n)."""
        return all_outward(self.bores, displacements)

    def basis_flexibility(self) -> np.ndarray:
        """Outward bore displacement per nodal pressure that the body follows, (m, k) [m/Pa].

        Of a free part: to pressures made self-equilibrated by its rigid inertia,
        less the rigid motion, whatever its frame.
        """
        return self.outward(self.bore_flexibility())

    def bore_flexibility(self) -> np.ndarray:
        """The same with all three components, shape (m, 3, k) [m/Pa]."""
        m = len(self.bore_basis)
        shape, load = self.bore_basis.reshape(3 * m, -1), self.load_projection[ELASTIC]
        if self.frame != "clamped" and self.rigid_mass.size:
            share = np.linalg.solve(self.rigid_mass, self.rigid_coupling)
            shape = shape - rigid_fields(self.places()) @ share
            load = load - share.T @ self.rigid_load
        response = shape @ np.linalg.solve(self.stiffness, load)
        if self.residual is not None:
            r = self.residual
            response = response + r.displacement.reshape(3 * m, -1) @ r.patterns
        return response.reshape(m, 3, -1)


def bore_fields(body: ReducedBody) -> np.ndarray:
    """Displacement of all bores' nodes, of coordinates and patterns, shape (m, 3, n + r)."""
    if body.residual is None:
        return body.bore_basis
    return np.concatenate([body.bore_basis, body.residual.displacement], axis=2)
