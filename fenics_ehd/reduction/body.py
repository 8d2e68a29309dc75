"""The reduced body: all data of a part that the time simulation needs, without part-size arrays.

A body is stored bit for bit in one HDF5 file, and exported to other programs as NumPy's ``.npz``.
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

#: Positions of the unit translations and of the elastic modes among the fields of a body.
TRANSLATIONS = slice(1, 3)
ELASTIC = slice(3, None)


@dataclass(frozen=True, eq=False)
class InertiaIntegrals:
    """Inertia coupling of a planar floating frame, exact for the finite-element mass matrix.

    Fields, in order: the position x (from the bore centre), the unit
    translations along x and y, the elastic modes; ``B`` holds them as columns,
    ``S`` rotates a field, ``e_z x`` node by node.

    Attributes
    ----------
    mass
        ``B^T M B``, shape (3 + n, 3 + n).
    spin
        ``B^T M S B``, antisymmetric: Coriolis and Euler accelerations.
    centrifugal
        ``(S B)^T M (S B)``, symmetric.
    """

    mass: np.ndarray
    spin: np.ndarray
    centrifugal: np.ndarray

    @property
    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All three matrices, in the order of the constructor."""
        return self.mass, self.spin, self.centrifugal

    @property
    def total_mass(self) -> float:
        """Mass of the part [kg]."""
        return float(self.mass[1, 1])

    @property
    def centre_of_mass(self) -> np.ndarray:
        """Centre of mass from the bore centre, x and y [m]."""
        return self.mass[0, TRANSLATIONS] / self.total_mass

    @property
    def polar_inertia(self) -> float:
        """Moment of inertia about the z axis through the centre of mass [kg m^2]."""
        offset = self.centre_of_mass
        return float(self.centrifugal[0, 0] - self.total_mass * offset @ offset)


@dataclass(frozen=True, eq=False)
class ResidualFlexibility:
    """Bore flexibility beyond the coordinates, which follows the pressure quasi-statically (M4).

    Attributes
    ----------
    displacement
        Displacement of the nodes of all bores for unit amplitudes of the r patterns, shape
        (m, 3, r) [m/Pa].
    patterns
        Orthonormal pressure patterns over all bores, shape (r, k): the amplitudes of nodal
        pressures w are ``patterns @ w`` [Pa].
    stiffness
        Twice the energy of unit amplitudes: diagonal of ``V^T J^T G_res J V``, shape (r,),
        [J/Pa^2]. The generalised force of a pressure on an amplitude is this times the
        amplitude of the pressure.
    mass
        Mass matrix of the patterns' displacements, shape (r, r) [kg m^2/Pa^2]. The method neglects
        this mass, the error estimate uses it; empty if it was not computed.
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
    """Entry of the mode inventory.

    Attributes
    ----------
    kind
        ``"vibration"``, ``"static"`` and others, see `ReducedBody`.
    frequency
        Natural frequency of the mode alone [Hz], infinite without mass.
    participation
        Share of the mode in the bore's flexibility, the trace of ``J^T G J``; in the sum of the
        listed flexibilities if that of the part is not known.
    dropped
        Reason why the mode was dropped; empty for a mode that is kept.
    """

    kind: str
    frequency: float
    participation: float
    dropped: str = ""


def unknown() -> np.ndarray:
    """An empty matrix in place of an unknown one."""
    return np.zeros((0, 0))


class BoreRows(NamedTuple):
    """A bore of a body, with the ranges of its nodes and pressure nodes among those of all."""

    name: str
    surface: BoreSurface
    nodes: slice
    pressures: slice


@renamed_attributes(places="positions")
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
        Surface of every bore by name. The numbers m of nodes and k of pressure nodes count all
        bores, one after the other. The origin of the frame is the centre of the first bore.
    bore_basis
        Displacement of the bore nodes for unit coordinates, shape (m, 3, n).
    load_projection
        ``B^T J``, shape (3 + n, k): generalised force of nodal pressures on the
        fields of `InertiaIntegrals`.
    ``(S B)^T J``, shape (3 + n, k): generalised moment of nodal pressures about z.
        ``(S B)^T J``, same shape: their moment about z.
    inertia
        Inertia integrals of plane motion.
    points
        Mean displacement of each boundary point for unit fields of `InertiaIntegrals`, shape
        (3, 3 + n).
    missing_flexibility
        Outward bore displacement per nodal pressure that the basis does not contain, shape
        (m, k) [m/Pa]; empty if not computed.
    mesh_flexibility
        Outward displacement of the part in excess of that of its mesh, under smooth pressures and
        forces on its points, see `fenics_ehd.reduction.mesh_error`. At the nodes of `SAMPLED`
        cells of every bore, k in all: shape (k, s + 2 a) [m/Pa], [m/N]; empty when unknown.
    rigid_mass, rigid_coupling
        ``R^T M R``, shape (6, 6), and ``R^T M T``, shape (6, n), of the unit translations
        and rotations R about the bore's centre; empty when unknown.
    rigid_load
        ``R^T J``, shape (6, k): force and moment of nodal pressures; empty when unknown.
    residual
        Flexibility that M4 adds without coordinates, None for the other methods.
    inventory
        Records of all modes, kept and dropped.
    accuracy
        Figures of the reduction by name: rank, dropped columns, residuals.
    provenance
        Model and settings of the reduction, texts by name.
    columns
        Part-size basis T, rows owned by this rank, if requested; not stored in the body's file (see
        `save_basis`).
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

    @property
    def modes(self) -> int:
        """Number of elastic coordinates n."""
        return len(self.frequencies)

    @property
    def bore(self) -> BoreSurface:
        """The bore of a body with exactly one bore.

        Raises
        ------
        SettingsError
            The body has several bores.
        """
        return only(self.bores, "reduced body")

    @property
    def bore_nodes(self) -> np.ndarray:
        """Positions of the nodes of the only bore, shape (m, 3) [m]."""
        return self.bore.coordinates

    @property
    def pressure_nodes(self) -> np.ndarray:
        """Positions of the pressure nodes of the only bore, shape (k, 3) [m]."""
        return self.bore.pressure_coordinates

    def each_bore(self) -> Iterator[BoreRows]:
        """Every bore with its ranges of nodes and pressure nodes, in turn."""
        nodes = pressures = 0
        for name, bore in self.bores.items():
            last = nodes + len(bore.coordinates)
            end = pressures + len(bore.pressure_coordinates)
            yield BoreRows(name, bore, slice(nodes, last), slice(pressures, end))
            nodes = last
            pressures = end

    def rows_of(self, name: str) -> BoreRows:
        """One bore with its ranges of nodes and pressure nodes.

        Raises
        ------
        SettingsError
            The body has no bore of this name.
        """
        for rows in self.each_bore():
            if rows.name == name:
                return rows
        raise SettingsError(f"the reduced body has no bore {name!r}: {', '.join(self.bores)}")

    def positions(self, *, of_pressures: bool = False) -> np.ndarray:
        """Positions of nodes or pressure nodes of all bores, from the origin, (m or k, 3) [m]."""
        name = "pressure_coordinates" if of_pressures else "coordinates"
        return np.vstack([bore.centre + getattr(bore, name) for bore in self.bores.values()])

    def at_bore(self, name: str) -> ReducedBody:
        """The body with only one of its bores, as a film in this bore needs it.

        Raises
        ------
        SettingsError
            The body has no such bore.
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
        """Outward bore displacement of the body per nodal pressure, shape (m, k) [m/Pa].

        The pressures on a free part are in equilibrium with its rigid inertia, and the rigid
        motion is subtracted, independent of the frame.
        """
        return self.outward(self.bore_flexibility())

    def bore_flexibility(self) -> np.ndarray:
        """Bore displacement of the body per nodal pressure, shape (m, 3, k) [m/Pa]."""
        m = len(self.bore_basis)
        shape = self.bore_basis.reshape(3 * m, -1)
        load = self.load_projection[ELASTIC]
        if self.frame != "clamped" and self.rigid_mass.size:
            share = np.linalg.solve(self.rigid_mass, self.rigid_coupling)
            shape = shape - rigid_fields(self.positions()) @ share
            load = load - share.T @ self.rigid_load
        response = shape @ np.linalg.solve(self.stiffness, load)
        if self.residual is not None:
            r = self.residual
            response = response + r.displacement.reshape(3 * m, -1) @ r.patterns
        return response.reshape(m, 3, -1)


def bore_fields(body: ReducedBody) -> np.ndarray:
    """Displacement of all bores' nodes per coordinate and pattern, shape (m, 3, n + r)."""
    if body.residual is None:
        return body.bore_basis
    return np.concatenate([body.bore_basis, body.residual.displacement], axis=2)


FORMAT = "fenics_ehd reduced body"
FORMAT_VERSION = 5

_FIELDS = Value("float", ("n + 3", "n + 3"))
_LOADS = Value("float", ("n + 3", "k"))

#: Layout of the surface of a stored body's bore.
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

#: Layout of a stored `ReducedBody`: n coordinates, m nodes and k pressure nodes of all bores, r
#: residual patterns.
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
    """Write a body to a file, atomically: a former file stays until the new one is complete."""
    require_class("body", body, ReducedBody)
    require_class("path", path, str, Path)
    save_tree(path, _tree(body), FORMAT, FORMAT_VERSION)


def body_digest(body: ReducedBody) -> str:
    """SHA-256 of all numbers of a body, the same before it is stored and after it is read."""
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
        # The order of the bores is that of their nodes; groups of a file are sorted by name.
        bore_names=tuple(body.bores),
        accuracy={name: float(value) for name, value in body.accuracy.items()},
        inventory=inventory,
    )


def load_body(path: str | Path) -> ReducedBody:
    """Read a body written by `save_body`.

    Raises
    ------
    BodyFileError
        The file is missing, is not HDF5, changed since it was written, or holds no reduced body
        of this format.
    """
    with named(BodyFileError, f"body file {path}"):
        with open_sealed(path, FORMAT, FORMAT_VERSION, remedy="reduce the part again") as file:
            tree = read_declared(file, LAYOUT)
        names = tree.pop("bore_names")
        if sorted(names) != sorted(tree["bores"]):
            raise ValueError(f"bore_names {', '.join(names)} are not those of /bores")
        surfaces = tree["bores"]
        tree["bores"] = {name: BoreSurface(**_SURFACE.arguments(surfaces[name])) for name in names}
        tree["inertia"] = InertiaIntegrals(**_INERTIA.arguments(tree["inertia"]))
        if "residual" in tree:
            tree["residual"] = ResidualFlexibility(**_RESIDUAL.arguments(tree["residual"]))
        tree["inventory"] = _inventory(tree["inventory"])
        body = ReducedBody(**LAYOUT.arguments(tree))
        _require_sound(body)
        return body


#: Largest difference of a stored matrix from its transpose, and largest size of a negative
#: eigenvalue due to round-off, both of the matrix scaled by its diagonal; stored matrices have 0
#: and none.
ROUND_OFF = 1e-9


def _require_sound(body: ReducedBody) -> None:
    """Refuse a body whose arrays have the right shapes but cannot be those of a part.

    Raises
    ------
    ValueError
        Bores have other numbers of nodes than bases and loads, stiffness or a mass matrix is not
        symmetric positive semidefinite, nodes of a bore are not on its cylinder, or there is no
        mass.
    """
    every = list(body.each_bore())
    counts = (every[-1].nodes.stop, every[-1].pressures.stop) if every else (0, 0)
    wanted = len(body.bore_basis), body.load_projection.shape[1]
    if counts != wanted:
        raise ValueError(
            f"bores have {counts[0]} nodes and {counts[1]} pressure nodes, the bases {wanted[0]} "
            f"and {wanted[1]}"
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
        The message has the name of the matrix.
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
        # A sixth of the work of eigenvalues.
        np.linalg.cholesky(scaled + ROUND_OFF * np.eye(len(scaled)))
    except np.linalg.LinAlgError:
        raise ValueError(
            f"/{name} is not positive semidefinite: relative eigenvalue below -{ROUND_OFF:.0e}"
        ) from None


def _inventory(columns: Mapping[str, Any]) -> tuple[ModeRecord, ...]:
    """Mode inventory of a file, read by the keys of `_INVENTORY`."""
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


EXPORT_FORMAT = "fenics_ehd reduced body, exported"
EXPORT_VERSION = 2

#: Most bytes of the label of an export.
_LABEL = 4096


def _is_export(path: Path) -> bool:
    """True of a file that `export_npz` wrote."""
    try:
        with ZipFile(path) as archive:
            label = archive.getinfo("format.npy")
            if label.file_size > _LABEL:
                return False
            return str(np.load(BytesIO(archive.read(label)), allow_pickle=False)) == EXPORT_FORMAT
    except (*UNREADABLE, EOFError, BadZipFile, zlib.error):  # encrypted, cut off, another method
        return False


#: Kinds of output files.
BODY_KIND = stored_as("a reduced body", FORMAT)
EXPORT_KIND = Kind("an exported reduced body", _is_export)


def export_npz(body: ReducedBody, path: str | Path) -> Path:
    """Write a body as one ``.npz`` of plain arrays, read by ``numpy.load`` without pickles.

    With n modes, m bore nodes, k pressure nodes and r residual patterns it holds, in SI units:

    ``format``, ``format_version``
        Text and number.
    ``method``, ``frame``, ``kinds``
        Text as in `ReducedBody`; `kinds` has shape (n,).
    ``stiffness``, ``mass``
        ``T^T K T`` [N/m] and ``T^T M T`` [kg], shape (n, n).
    ``frequencies``
        Natural frequency of each coordinate taken alone, shape (n,) [Hz].
    ``bore_names``, ``bore_radius``, ``bore_width``, ``bore_centre``, ``bore_sizes``
        Data of every bore: name, radius [m], width [m], centre relative to the origin, shape (3,)
        [m], and numbers of its nodes and pressure nodes among the m and k of all.
    ``bore_nodes``, ``pressure_nodes``
        Positions relative to the origin, with the bores' axes along z, shapes (m, 3), (k, 3) [m].
    ``bore_basis``
        Displacement of the bore nodes for unit coordinates, shape (m, 3, n).
    ``bore_cells``, ``bore_family``, ``pressure_cells``, ``pressure_family``
        Surface meshes of bore and pressure nodes as in `BoreSurface`; without cells and with an
        empty name when unknown.
    ``load_projection``
        ``T^T J``: generalised force of nodal pressures, shape (n, k) [m^2].
    ``rigid_mass``, ``rigid_coupling``, ``rigid_load``
        ``R^T M R``, ``R^T M T`` and ``R^T J`` of the unit translations [m] and rotations
        [rad] R about the origin, shapes (6, 6), (6, n) and (6, k); the free part has
        the mass matrix ``[[R^T M R, R^T M T], [T^T M R, T^T M T]]``.
    ``inertia_mass``, ``inertia_spin``, ``inertia_centrifugal``
        `InertiaIntegrals` of plane motion, shape (3 + n, 3 + n).
    ``points``, ``point_position``, ``point_basis``
        Names of the b boundary points, their mean positions, shape (b, 3) [m], and mean
        displacements for unit coordinates, shape (b, 3, n).
    ``residual_displacement``, ``residual_patterns``, ``residual_stiffness``, ``residual_mass``
        `ResidualFlexibility` (M4), shapes (m, 3, r) [m/Pa], (r, k), (r,) [J/Pa^2] and (r, r)
        [kg m^2/Pa^2] or empty: the bores' displacement is ``bore_basis @ q +
        residual_displacement @ residual_patterns @ p`` of coordinates q and pressures p. Only of
        bodies with residual flexibility.

    Parameters
    ----------
    body
        Reduced body to be exported.
    path
        Path of the file; ``.npz`` is appended to another extension. An existing file is replaced.

    Returns
    -------
    pathlib.Path
        The file.
    """
    path = Path(path)
    if path.suffix != ".npz":
        path = path.with_name(path.name + ".npz")
    content = BytesIO()
    np.savez(content, **contents(body))
    write_whole(path, content.getbuffer())
    return path


def contents(body: ReducedBody) -> dict[str, np.ndarray]:
    """Arrays of an export by the names of `export_npz`."""
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
