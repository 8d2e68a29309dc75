"""Reduced bodies: all data of a part that a time simulation needs, without part-size arrays.

A body is stored bit for bit in one HDF5 file, or exported to other programs as a NumPy ``.npz``.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile, ZipFile

import numpy as np

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.described import Described, Named, names_or_none
from fenics_ehd.base.errors import BodyFileError, SettingsError, StructureError
from fenics_ehd.base.files import Kind, write_whole
from fenics_ehd.base.layout import Group, Value, read_declared
from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.base.sealed_file import (
    UNREADABLE,
    digest,
    named,
    open_sealed,
    save_tree,
    stored_as,
)
from fenics_ehd.reduction.bore import (
    SAMPLED_NODES,
    SMOOTH,
    BoreSurface,
    all_outward,
    make_row_major,
    only,
    rigid_fields,
    surface_layout,
)
from fenics_ehd.reduction.structure import check_surface

#: Indices of the unit translations among the fields of a body, see `InertiaIntegrals`.
TRANSLATIONS = slice(1, 3)

#: Indices of the elastic modes among the fields of a body.
ELASTIC = slice(3, None)


@dataclass(frozen=True, eq=False)
class InertiaIntegrals(Described):
    """Inertia integrals of a body in a planar floating frame, from the finite-element mass matrix.

    The columns of ``B`` are 3 + n fields of all dofs: the position relative to the centre of the
    first bore, the unit translations along x and y, and the n elastic modes. ``S u`` is the cross
    product ``e_z x u`` at every node.

    Attributes
    ----------
    mass
        ``B^T M B`` with the mass matrix M of the part, symmetric, shape (3 + n, 3 + n).
    spin
        ``B^T M S B``, antisymmetric, shape (3 + n, 3 + n); for Coriolis and Euler accelerations.
    centrifugal
        ``(S B)^T M (S B)``, symmetric, shape (3 + n, 3 + n); for centrifugal accelerations.
    """

    mass: np.ndarray
    spin: np.ndarray
    centrifugal: np.ndarray

    @property
    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The matrices `mass`, `spin` and `centrifugal` as a tuple."""
        return self.mass, self.spin, self.centrifugal

    @property
    def total_mass(self) -> float:
        """Mass of the part [kg]."""
        return float(self.mass[1, 1])

    @property
    def centre_of_mass(self) -> np.ndarray:
        """Centre of mass relative to the centre of the first bore, x and y [m]; 0 without mass."""
        return self.mass[0, TRANSLATIONS] / (self.total_mass or 1.0)

    @property
    def polar_inertia(self) -> float:
        """Moment of inertia about the axis along z through the centre of mass [kg m^2]."""
        offset = self.centre_of_mass
        return float(self.centrifugal[0, 0] - self.total_mass * offset @ offset)


@dataclass(frozen=True, eq=False)
class ResidualFlexibility(Described):
    """Quasi-static flexibility of the bores that M4 adds to that of the elastic coordinates.

    The bores have m nodes and k pressure nodes.

    Attributes
    ----------
    displacement
        Displacement of the nodes of all bores due to unit amplitudes of the r pressure patterns,
        shape (m, 3, r) [m/Pa].
    patterns
        Orthonormal pressure patterns over all bores, shape (r, k): nodal pressures w have the
        amplitudes ``patterns @ w`` [Pa].
    stiffness
        Twice the strain energy for a unit amplitude of each pattern, shape (r,) [J/Pa^2]. The
        generalised force of nodal pressures on a pattern is their amplitude times this value.
    mass
        Mass matrix of the displacements due to the patterns, shape (r, r) [kg m^2/Pa^2]; empty
        if not computed. The method neglects this mass; the error estimate uses it.
    """

    displacement: np.ndarray
    patterns: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray

    @property
    def rank(self) -> int:
        """Number r of pressure patterns."""
        return len(self.stiffness)


@dataclass(frozen=True)
class ModeRecord(Described):
    """Record of one mode in the inventory of the kept and the dropped modes of a body.

    Attributes
    ----------
    kind
        Kind of the mode, one of `ReducedBody.kinds`.
    frequency
        Natural frequency of the mode with all other modes held at zero [Hz]; infinite for a mode
        without mass.
    participation
        Share of the mode in the flexibility ``J^T G J`` of the bores, both measured by the trace
        over the pressures `Reductor.measure`. If the flexibility of the bores was not computed,
        share of the mode in the sum over all modes of the inventory.
    dropped
        Reason why the mode was dropped; empty for a mode that was kept.
    """

    kind: str
    frequency: float
    participation: float
    dropped: str = ""


def unknown() -> np.ndarray:
    """Return an empty matrix, which represents an unknown matrix."""
    return np.zeros((0, 0))


class BoreRows(NamedTuple):
    """A bore of a body, and the ranges of its nodes and pressure nodes in arrays of all bores."""

    name: str
    surface: BoreSurface
    nodes: slice
    pressures: slice


@renamed_attributes(places="positions")
@dataclass(frozen=True, eq=False, repr=False)
class ReducedBody(Described):
    """A part described by ``n`` modal coordinates.

    Attributes
    ----------
    method
        Reduction method: ``"m1"`` to ``"m4"``, ``"full"`` or ``"rigid"``.
    frame
        Floating frame: ``"mean-axis"``, ``"bore-centre"``, or ``"clamped"`` for a part with a
        fixed support.
    stiffness, mass
        Reduced stiffness ``T^T K T`` [N/m] and mass ``T^T M T`` [kg], shape (n, n). The damping
        matrix is the stiffness times ``zeta``, a setting of the scene.
    frequencies
        Natural frequency of each coordinate with the others held at zero [Hz], shape (n,).
    kinds
        Kind of each coordinate: ``"vibration"``, ``"fixed-boundary"``, ``"constraint"`` or
        ``"static"``.
    bores
        Surface of every bore by name. Arrays over m nodes or k pressure nodes contain all bores,
        one after the other. The origin of the frame is the centre of the first bore.
    bore_basis
        Displacement of the bore nodes for unit coordinates, shape (m, 3, n).
    load_projection
        Generalised forces ``B^T J`` due to unit nodal pressures, for the fields B of
        `InertiaIntegrals`, shape (3 + n, k).
    spin_load_projection
        Generalised forces ``(S B)^T J`` due to unit nodal pressures, for the fields ``S B`` of
        `InertiaIntegrals`, shape (3 + n, k).
    inertia
        Inertia integrals of plane motion.
    points
        One array of shape (3, 3 + n) for each boundary point, by the name of the point: column 0
        is the mean position of the point, the other columns are its mean displacements in the
        other 2 + n fields of `InertiaIntegrals`.
    missing_flexibility
        Outward displacement of the bores per nodal pressure, exact minus reduced, shape (m, k)
        [m/Pa]. The difference is exact for the pressures of a family, see
        `fenics_ehd.reduction.family_responses`. Empty if not computed, and for M4, which has
        `flexibility_error` instead.
    mesh_flexibility
        Estimated error of the outward bore displacement due to the mesh, see
        `fenics_ehd.reduction.mesh_error`: displacement of the exact part minus that of the meshed
        part. Shape (p, s + 2 b), empty if unknown. Rows belong to p nodes of the `SAMPLED` cells
        of all bores. Columns belong to s smooth unit pressures [m/Pa], then to unit forces along
        x and y on each of the b boundary points [m/N].
    rigid_mass, rigid_coupling
        ``R^T M R``, shape (6, 6), and ``R^T M T``, shape (6, n); the columns of R are the unit
        translations and rotations about the centre of the first bore. Empty if unknown.
    rigid_load
        Force and moment of unit nodal pressures, ``R^T J``, shape (6, k); empty if unknown.
    residual
        Flexibility that M4 adds without coordinates; None for other methods.
    inventory
        Records of all modes, kept and dropped.
    accuracy
        Accuracy figures of the reduction by name: rank, dropped columns, residuals.
    provenance
        Texts by name that describe the model and the settings of the reduction.
    columns
        Part-size basis T, rows of this rank; None unless requested. It is not stored in the
        body's file, see `save_basis`.
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
        make_row_major(self)
        for name in ("bores", "points"):
            object.__setattr__(self, name, Named(getattr(self, name), f"body.{name}"))

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield method, coordinates, frequencies, mass, bores and points."""
        yield "ReducedBody", f"method {self.method}, frame {self.frame}"
        kinds = (f"{self.kinds.count(kind)} {kind}" for kind in dict.fromkeys(self.kinds))
        yield "coordinates", f"{self.modes}: {', '.join(kinds)}" if self.modes else "0"
        if self.residual is not None:
            yield "patterns", f"{self.residual.rank} residual patterns"
        if self.modes:
            lowest = np.min(self.frequencies)
            highest = np.max(self.frequencies)
            yield "frequencies", f"{lowest:.4g} to {highest:.4g} Hz"
        yield "mass", f"{self.inertia.total_mass:.5g} kg"
        for name, bore in self.bores.items():
            yield f"bore {name}", f"{len(bore.coordinates)} nodes"
        yield "points", names_or_none(self.points)

    @property
    def modes(self) -> int:
        """Number of elastic coordinates n."""
        return len(self.frequencies)

    @property
    def bore(self) -> BoreSurface:
        """Surface of the bore, if the body has exactly one.

        Raises
        ------
        SettingsError
            If the body has no bore or several bores.
        """
        return only(self.bores, "reduced body")

    @property
    def bore_nodes(self) -> np.ndarray:
        """Positions of the nodes of the only bore, relative to its centre, shape (m, 3) [m]."""
        return self.bore.coordinates

    @property
    def pressure_nodes(self) -> np.ndarray:
        """Positions of the only bore's pressure nodes, relative to its centre, shape (k, 3) [m]."""
        return self.bore.pressure_coordinates

    def each_bore(self) -> Iterator[BoreRows]:
        """Iterate over the bores, each with its ranges of nodes and pressure nodes."""
        nodes = pressures = 0
        for name, bore in self.bores.items():
            last = nodes + len(bore.coordinates)
            end = pressures + len(bore.pressure_coordinates)
            yield BoreRows(name, bore, slice(nodes, last), slice(pressures, end))
            nodes = last
            pressures = end

    def rows_of(self, name: str) -> BoreRows:
        """Return the bore of a name with its ranges of nodes and pressure nodes.

        Raises
        ------
        SettingsError
            If the body has no bore of this name; the message lists the bores.
        """
        for rows in self.each_bore():
            if rows.name == name:
                return rows
        raise SettingsError(
            f"the reduced body has no bore {name!r}: its bores are {', '.join(self.bores)}"
        )

    def positions(self, *, of_pressures: bool = False) -> np.ndarray:
        """Positions of the nodes of all bores relative to the origin, shape (m, 3) [m].

        With `of_pressures`, positions of the pressure nodes, shape (k, 3).
        """
        name = "pressure_coordinates" if of_pressures else "coordinates"
        return np.vstack([bore.centre + getattr(bore, name) for bore in self.bores.values()])

    def at_bore(self, name: str) -> ReducedBody:
        """Copy the body with only one of its bores, for a film in this bore.

        Raises
        ------
        SettingsError
            If the body has no bore of this name.
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
        """Outward radial components, (m, n), of displacements of all bore nodes, (m, 3, n)."""
        return all_outward(self.bores, displacements)

    def basis_flexibility(self) -> np.ndarray:
        """Outward static displacement of the bores per nodal pressure, shape (m, k) [m/Pa].

        See `bore_flexibility`.
        """
        return self.outward(self.bore_flexibility())

    @property
    def flexibility_error(self) -> float:
        """Verified relative error of the bores' displacement under pressure, for M4.

        The result is nan for other methods, and if the error was not estimated.
        """
        verified = self.residual is not None and self.residual.mass.size > 0
        return self.accuracy.get("flexibility_error", np.nan) if verified else np.nan

    def missing_flexibility_at(self, bore: str) -> np.ndarray:
        """Error of the outward displacement of one bore per nodal pressure: exact minus reduced.

        For M4, only the relative error of the displacement is known; the result is then this error
        times the displacement of the reduced body.

        Returns
        -------
        numpy.ndarray
            Displacement of the m nodes of this bore per pressure at the k pressure nodes of all
            bores, shape (m, k) [m/Pa]; empty if unknown.
        """
        nodes = self.rows_of(bore).nodes
        if self.missing_flexibility.size or not np.isfinite(self.flexibility_error):
            return self.missing_flexibility[nodes]
        return self.flexibility_error * self.basis_flexibility()[nodes]

    def bore_flexibility(self) -> np.ndarray:
        """Static displacement of the bore nodes per nodal pressure, shape (m, 3, k) [m/Pa].

        See `pressure_responses`.
        """
        return self.pressure_responses(np.eye(self.load_projection.shape[1]))[0]

    def pressure_responses(self, pressures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Static displacements u under pressures, and the work of unit nodal pressures on u.

        For a free part, the pressures are in equilibrium with the inertia forces of the rigid
        acceleration, and the rigid motion is subtracted. The results do not depend on the frame.

        Parameters
        ----------
        pressures
            Nodal pressures on all bores, shape (k, c) [Pa].

        Returns
        -------
        displacement, work : numpy.ndarray
            Displacement of the bore nodes, shape (m, 3, c) [m]; ``J^T u``, shape (k, c) [m^3].
        """
        m = len(self.bore_basis)
        shape = self.bore_basis.reshape(3 * m, -1)
        load = self.load_projection[ELASTIC]
        if self.frame != "clamped" and self.rigid_mass.size:
            share = np.linalg.solve(self.rigid_mass, self.rigid_coupling)
            shape = shape - rigid_fields(self.positions()) @ share
            load = load - share.T @ self.rigid_load
        coordinates = np.linalg.solve(self.stiffness, load @ pressures)
        displacement = shape @ coordinates
        work = load.T @ coordinates
        if self.residual is not None:
            r = self.residual
            amplitudes = r.patterns @ pressures
            displacement = displacement + r.displacement.reshape(3 * m, -1) @ amplitudes
            work = work + r.patterns.T @ (r.stiffness[:, None] * amplitudes)
        return displacement.reshape(m, 3, -1), work


def bore_fields(body: ReducedBody) -> np.ndarray:
    """Displacement of all bore nodes per coordinate and residual pattern, shape (m, 3, n + r)."""
    if body.residual is None:
        return body.bore_basis
    return np.concatenate([body.bore_basis, body.residual.displacement], axis=2)


#: Name of the file format of bodies.
FORMAT = "fenics_ehd reduced body"
FORMAT_VERSION = 5

#: Layouts of a square matrix of the fields of `InertiaIntegrals`, and of nodal pressures on them.
_FIELDS = Value("float", ("n + 3", "n + 3"))
_LOADS = Value("float", ("n + 3", "k"))

#: Layout of a stored `BoreSurface`.
_SURFACE = Group(surface_layout("float", attribute=False))

#: Layout of stored `InertiaIntegrals`.
_INERTIA = Group({"mass": _FIELDS, "spin": _FIELDS, "centrifugal": _FIELDS})

#: Layout of a stored `ResidualFlexibility`.
_RESIDUAL = Group(
    {
        "displacement": Value("float", ("m", 3, "r")),
        "patterns": Value("float", ("r", "k")),
        "stiffness": Value("float", ("r",), least=0.0),
        "mass": Value("float", ("r", "r"), empty=True),
    },
    required=False,
)

#: Layout of the mode inventory, one row for each `ModeRecord`.
_INVENTORY = Group(
    {
        "kind": Value("text", ("records",)),
        "frequency": Value("float", ("records",), finite=False),
        "participation": Value("float", ("records",), finite=False),
        "dropped": Value("text", ("records",)),
    }
)

#: Layout of a stored `ReducedBody`, with n coordinates, r residual patterns, m nodes and k pressure
#: nodes of all bores.
LAYOUT = Group(
    {
        "method": Value("text"),
        "frame": Value("text"),
        "stiffness": Value("float", ("n", "n")),
        "mass": Value("float", ("n", "n")),
        "frequencies": Value("float", ("n",), finite=False),
        "kinds": Value("text", ("n",)),
        "bore_names": Value("text", ("bores",)),
        "bores": Group(each=_SURFACE),
        "bore_basis": Value("float", ("m", 3, "n")),
        "load_projection": _LOADS,
        "spin_load_projection": _LOADS,
        "inertia": _INERTIA,
        "points": Group(each=Value("float", (3, "n + 3"))),
        "missing_flexibility": Value("float", ("m", "k"), empty=True),
        "mesh_flexibility": Value("float", ("sampled", "loads"), empty=True, required=False),
        "rigid_mass": Value("float", (6, 6), empty=True, required=False),
        "rigid_coupling": Value("float", (6, "n"), empty=True, required=False),
        "rigid_load": Value("float", (6, "k"), empty=True, required=False),
        "residual": _RESIDUAL,
        "inventory": _INVENTORY,
        "accuracy": Group(each=Value("float", finite=False), required=False),
        "provenance": Group(each=Value("text"), required=False),
    }
)


def save_body(body: ReducedBody, path: str | Path) -> None:
    """Write a body to a file atomically: an existing file is replaced by a complete one."""
    require_class("body", body, ReducedBody)
    require_class("path", path, str, Path)
    save_tree(path, _tree(body), FORMAT, FORMAT_VERSION)


def body_digest(body: ReducedBody) -> str:
    """SHA-256 checksum of the contents of a body; storing and reading do not change it."""
    return digest(_tree(body))


def _tree(body: ReducedBody) -> dict[str, Any]:
    """Contents of a body's file, by the keys of `LAYOUT`."""
    records = body.inventory
    inventory = {
        "kind": tuple(record.kind for record in records),
        "frequency": np.array([record.frequency for record in records], dtype=float),
        "participation": np.array([record.participation for record in records], dtype=float),
        "dropped": tuple(record.dropped for record in records),
    }
    return LAYOUT.tree(
        body,
        # bore_names has the order of the nodes; groups in a file are sorted by name.
        bore_names=tuple(body.bores),
        accuracy={name: float(value) for name, value in body.accuracy.items()},
        inventory=inventory,
    )


def load_body(path: str | Path) -> ReducedBody:
    """Read a body written by `save_body`.

    Raises
    ------
    BodyFileError
        If the file is missing, is not HDF5, was changed after it was written, or does not contain
        a reduced body of this format version.
    """
    with named(BodyFileError, f"body file {path}"):
        with open_sealed(path, FORMAT, FORMAT_VERSION, remedy="reduce the part again") as file:
            tree = read_declared(file, LAYOUT)
        names = tree.pop("bore_names")
        if sorted(names) != sorted(tree["bores"]):
            raise ValueError(
                f"bore_names {', '.join(names)} differ from the groups of /bores, "
                f"{', '.join(sorted(tree['bores']))}"
            )
        surfaces = tree["bores"]
        tree["bores"] = {name: BoreSurface(**_SURFACE.arguments(surfaces[name])) for name in names}
        tree["inertia"] = InertiaIntegrals(**_INERTIA.arguments(tree["inertia"]))
        if "residual" in tree:
            tree["residual"] = ResidualFlexibility(**_RESIDUAL.arguments(tree["residual"]))
        tree["inventory"] = _inventory(tree["inventory"])
        body = ReducedBody(**LAYOUT.arguments(tree))
        _require_sound(body)
        return body


#: Largest round-off accepted in a stored matrix that is scaled to a unit diagonal: difference from
#: its transpose, and magnitude of negative eigenvalues. Matrices that this package writes are
#: exactly symmetric and have no negative eigenvalues.
ROUND_OFF = 1e-9


def _require_sound(body: ReducedBody) -> None:
    """Refuse a body whose arrays have the right shapes, but values that no part can have.

    Raises
    ------
    ValueError
        If the numbers of nodes of bores and bases differ, if stiffness or a mass matrix is not
        symmetric positive semidefinite, if a bore's nodes are not on its cylinder, or if the mass
        is not above 0.
    """
    every = list(body.each_bore())
    counts = (every[-1].nodes.stop, every[-1].pressures.stop) if every else (0, 0)
    wanted = len(body.bore_basis), body.load_projection.shape[1]
    if counts != wanted:
        raise ValueError(
            f"the bores have {counts[0]} nodes and {counts[1]} pressure nodes, but /bore_basis has "
            f"{wanted[0]} nodes and /load_projection {wanted[1]} pressure nodes"
        )
    shape = SAMPLED_NODES * len(every), SMOOTH * len(every) + 2 * len(body.points)
    mesh = body.mesh_flexibility
    if mesh.size and mesh.shape != shape:
        raise ValueError(f"/mesh_flexibility has shape {mesh.shape}, not {shape}")
    for name, bore in body.bores.items():
        try:
            check_surface(bore, f"bores/{name}")
        except StructureError as error:
            raise ValueError(str(error)) from None
    matrices = {"stiffness": body.stiffness, "mass": body.mass, "inertia/mass": body.inertia.mass}
    for name, matrix in matrices.items():
        _require_semidefinite(matrix, name)
    if not body.inertia.total_mass > 0.0:
        raise ValueError(f"/inertia/mass: a mass of {body.inertia.total_mass:g} kg is not above 0")


def _require_semidefinite(matrix: np.ndarray, name: str) -> None:
    """Refuse a matrix that is not symmetric positive semidefinite.

    Raises
    ------
    ValueError
        If the matrix is not symmetric, or not positive semidefinite; the message names the matrix.
    """
    diagonal = np.diag(matrix)
    if diagonal.min(initial=0.0) < 0.0:
        raise ValueError(f"/{name} is not positive semidefinite: diagonal entry {diagonal.min():g}")
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrix / scale / scale[:, None]
    defect = np.abs(scaled - scaled.T).max(initial=0.0)
    if defect > ROUND_OFF:
        raise ValueError(
            f"/{name} is not symmetric: relative defect {defect:.1e}, limit {ROUND_OFF:.0e}"
        )
    try:
        # A Cholesky factorisation takes a sixth of the time that eigenvalues would take.
        np.linalg.cholesky(scaled + ROUND_OFF * np.eye(len(scaled)))
    except np.linalg.LinAlgError:
        raise ValueError(
            f"/{name} is not positive semidefinite: relative eigenvalue below -{ROUND_OFF:.0e}"
        ) from None


def _inventory(columns: Mapping[str, Any]) -> tuple[ModeRecord, ...]:
    """Make the records of modes from the arrays of a file, whose keys are those of `_INVENTORY`."""
    rows = zip(
        columns["kind"],
        columns["frequency"],
        columns["participation"],
        columns["dropped"],
        strict=True,
    )
    return tuple(
        ModeRecord(kind, float(frequency), float(share), dropped)
        for kind, frequency, share, dropped in rows
    )


#: Text in an export that names its format.
EXPORT_FORMAT = "fenics_ehd reduced body, exported"
EXPORT_VERSION = 2

#: Largest size of the format label of an export [bytes]; a larger member is not read.
_LABEL = 4096


def _is_export(path: Path) -> bool:
    """Whether a file is a body that `export_npz` wrote."""
    try:
        with ZipFile(path) as archive:
            label = archive.getinfo("format.npy")
            if label.file_size > _LABEL:
                return False
            return str(np.load(BytesIO(archive.read(label)), allow_pickle=False)) == EXPORT_FORMAT
    except (*UNREADABLE, EOFError, BadZipFile, zlib.error):  # encrypted, cut off, another method
        return False


#: Kinds of files that commands recognise: stored bodies and exported ones.
BODY_KIND = stored_as("a reduced body", FORMAT)
EXPORT_KIND = Kind("an exported reduced body", _is_export)


def export_npz(body: ReducedBody, path: str | Path) -> Path:
    """Write a body as one ``.npz`` file of plain arrays, which ``numpy.load`` reads without pickle.

    With n modes, m bore nodes, k pressure nodes and r residual patterns, the file contains the
    following arrays in SI units:

    ``format``, ``format_version``
        Text that names the format, and version number.
    ``method``, ``frame``, ``kinds``
        Texts as in `ReducedBody`; `kinds` has shape (n,).
    ``stiffness``, ``mass``
        Reduced stiffness ``T^T K T`` [N/m] and mass ``T^T M T`` [kg], shape (n, n).
    ``frequencies``
        Natural frequency of each coordinate with the others held at zero, shape (n,) [Hz].
    ``bore_names``, ``bore_radius``, ``bore_width``, ``bore_centre``, ``bore_sizes``
        Data of every bore: name, radius [m], width [m], centre relative to the origin, shape (3,)
        [m], and numbers of its nodes and pressure nodes. Bores follow one another in arrays over
        the m nodes or k pressure nodes.
    ``bore_nodes``, ``pressure_nodes``
        Positions relative to the origin, with the bores' axes along z, shapes (m, 3), (k, 3) [m].
    ``bore_basis``
        Displacement of the bore nodes for unit coordinates, shape (m, 3, n).
    ``bore_cells``, ``bore_family``, ``pressure_cells``, ``pressure_family``
        Surface meshes of bore and pressure nodes as in `BoreSurface`; empty if unknown.
    ``load_projection``
        Generalised forces due to unit nodal pressures, ``T^T J``, shape (n, k) [m^2].
    ``rigid_mass``, ``rigid_coupling``, ``rigid_load``
        ``R^T M R``, ``R^T M T`` and ``R^T J``, shapes (6, 6), (6, n) and (6, k); the columns of R
        are the unit translations [m] and rotations [rad] about the origin. The mass matrix of the
        free part is ``[[R^T M R, R^T M T], [T^T M R, T^T M T]]``. Missing if unknown.
    ``inertia_mass``, ``inertia_spin``, ``inertia_centrifugal``
        `InertiaIntegrals` of plane motion, shape (3 + n, 3 + n).
    ``points``, ``point_position``, ``point_basis``
        Names of the b boundary points, their mean positions, shape (b, 3) [m], and mean
        displacements for unit coordinates, shape (b, 3, n).
    ``residual_displacement``, ``residual_patterns``, ``residual_stiffness``, ``residual_mass``
        `ResidualFlexibility`, shapes (m, 3, r) [m/Pa], (r, k), (r,) [J/Pa^2] and (r, r)
        [kg m^2/Pa^2] or empty; only for bodies reduced by M4. For coordinates q and pressures p,
        the displacement of the bores is
        ``bore_basis @ q + residual_displacement @ residual_patterns @ p``.

    Parameters
    ----------
    body
        Reduced body to be exported.
    path
        Path of the file; ``.npz`` is appended if the name does not end with it. An existing file
        is replaced.

    Returns
    -------
    pathlib.Path
        Path of the file that was written.
    """
    path = Path(path)
    if path.suffix != ".npz":
        path = path.with_name(path.name + ".npz")
    content = BytesIO()
    np.savez(content, **contents(body))
    write_whole(path, content.getbuffer())
    return path


def contents(body: ReducedBody) -> dict[str, np.ndarray]:
    """Arrays of an exported body, by the names that `export_npz` lists."""
    every = list(body.each_bore())
    bores = list(body.bores.values())
    points = np.array(list(body.points.values())).reshape(-1, 3, 3 + body.modes)
    arrays = {
        "format": EXPORT_FORMAT,
        "format_version": EXPORT_VERSION,
        "method": body.method,
        "frame": body.frame,
        "kinds": np.array(body.kinds, dtype=str),
        "stiffness": body.stiffness,
        "mass": body.mass,
        "frequencies": body.frequencies,
        "bore_names": list(body.bores),
        "bore_radius": [bore.radius for bore in bores],
        "bore_width": [bore.width for bore in bores],
        "bore_centre": [bore.centre for bore in bores],
        "bore_sizes": [(len(b.coordinates), len(b.pressure_coordinates)) for b in bores],
        "bore_nodes": body.positions(),
        "bore_basis": body.bore_basis,
        "bore_cells": np.vstack([r.nodes.start + r.surface.cells for r in every]),
        "bore_family": bores[0].family,
        "pressure_nodes": body.positions(of_pressures=True),
        "pressure_cells": np.vstack([r.pressures.start + r.surface.pressure_cells for r in every]),
        "pressure_family": bores[0].pressure_family,
        "load_projection": body.load_projection[ELASTIC],
        "points": np.array(list(body.points), dtype=str),
        "point_position": points[:, :, 0],
        "point_basis": points[:, :, 3:],
        "inertia_mass": body.inertia.mass,
        "inertia_spin": body.inertia.spin,
        "inertia_centrifugal": body.inertia.centrifugal,
    }
    if body.rigid_mass.size:
        arrays |= {
            "rigid_mass": body.rigid_mass,
            "rigid_coupling": body.rigid_coupling,
            "rigid_load": body.rigid_load,
        }
    residual = body.residual
    if residual is not None:
        arrays |= {
            "residual_displacement": residual.displacement,
            "residual_patterns": residual.patterns,
            "residual_stiffness": residual.stiffness,
            "residual_mass": residual.mass,
        }
    return {name: np.asarray(value) for name, value in arrays.items()}
