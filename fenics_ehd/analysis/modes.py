"""Modes of small motions about an equilibrium: roots, shapes, whirl direction, and following.

A mode of ``M q'' + D q' + K q = 0`` is a motion ``q = x exp(lambda t)`` with the root
``lambda = sigma + i nu``. With the state ``(q, q')`` the roots are the eigenvalues of the pencil

    A = [[0, I], [-K, -D]],    B = [[I, 0], [0, M]],    A X = lambda B X,    Y^H A = lambda Y^H B,

with right and left eigenvectors X and Y, scaled so that ``Y^H B X = 1``. If M is singular, as with
massless journals, some roots are infinite and are not included. Real roots belong to motions
without oscillation; a pair of real roots belongs to an overdamped motion.

The dynamic stiffness H(s) of a machine with residual patterns of elastic bores is interpolated, and
its roots and null vectors x and y are those of `fenics_ehd.analysis.film_memory`. States of a mode
are ``X = (x, lambda x)`` and ``Y = (Y_1, y)`` with ``Y_1^H = y^H (H'(lambda) - lambda M)``. For
``H = s^2 M + s D + K`` these are the eigenvectors of the pencil.

- Damping ratio ``-sigma / |lambda|``, logarithmic decrement ``-2 pi sigma / |nu|``.
- Whirl direction of the deflections (u, v) of k points, u along x and v along y, at nu > 0:
  ``kappa = -2 Im sum conj(u) v / sum (|u|^2 + |v|^2)`` times the sign of the speed. It is +1 if all
  points move on circles in the sense of rotation (forward whirl), -1 if they move on circles in the
  opposite sense (backward whirl), and 0 if they move on straight lines.
- If the dynamic stiffness changes by ``dH(s)``, the root changes by ``-y^H dH(lambda) x`` to first
  order. The scatter of a root over film meshes follows from the differences between their dynamic
  stiffness and its mean. The scatter of damping ratio and decrement follows from that of the root.
- Modes i and j at neighbouring speeds 1 and 2 are the same if their overlap
  ``sqrt |Y_1i^H B_1 X_2j  Y_2j^H B_2 X_1i|`` is near 1. The overlap does not depend on scales.

Imports inside functions: `scipy.optimize` is slow to import, and only followed modes need it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from fenics_ehd.analysis.equilibrium import Linearisation
from fenics_ehd.analysis.film_memory import SampledStiffness, finite_roots
from fenics_ehd.base.described import Described
from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.joints import require_point
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.shaft import ShaftBody, require_shaft_point

#: Imaginary part over the absolute value of a root below which the root is real (round-off of a
#: double root: the square root of the machine's).
REAL = 1e-7


#: Absolute value of the whirl direction below which points move almost on straight lines.
STRAIGHT = 0.05


@dataclass(frozen=True, eq=False)
class Modes(Described):
    """The r modes of small motions in k coordinates: finite roots and their eigenvectors.

    Attributes
    ----------
    roots
        Roots lambda, the least stable root first, shape (r,) [1/s].
    eigenvectors, left_eigenvectors
        Right eigenvectors X and left eigenvectors Y of the states, as columns, shape (2 k, r).
    mass
        Mass matrix M, shape (k, k).
    """

    roots: np.ndarray
    eigenvectors: np.ndarray
    left_eigenvectors: np.ndarray
    mass: np.ndarray

    @property
    def shapes(self) -> np.ndarray:
        """Motions x of the r modes in the k coordinates q, as columns, shape (k, r)."""
        return self.eigenvectors[: len(self.mass)]

    @cached_property
    def _dual(self) -> np.ndarray:
        """Matrix ``Y^H B`` with one row for each mode, shape (r, 2 k)."""
        size = len(self.mass)
        dual = self.left_eigenvectors.conj().T
        return np.hstack([dual[:, :size], dual[:, size:] @ self.mass])

    def overlaps(self, other: Modes) -> np.ndarray:
        """Overlaps of the r modes with the s modes at a neighbouring speed, shape (r, s)."""
        forth = self._dual @ other.eigenvectors
        back = other._dual @ self.eigenvectors
        return np.asarray(np.sqrt(np.abs(forth * back.T)))


def modes_of(linear: Linearisation) -> Modes:
    """Compute the modes of small motions about an equilibrium."""
    if linear.sampled is not None:
        return _with_memory(linear.sampled, linear.mass)
    size = len(linear.mass)
    # In units of time at which mass and stiffness have the same size, the pencil is well scaled.
    rate = float(np.sqrt(np.linalg.norm(linear.stiffness) / np.linalg.norm(linear.mass)))
    unit = np.eye(size)
    zero = np.zeros((size, size))
    scale = rate**2 * np.linalg.norm(linear.mass)
    stiffness = linear.stiffness / scale
    damping = rate * linear.damping / scale
    mass = rate**2 * linear.mass / scale
    motion = np.block([[zero, unit], [-stiffness, -damping]])
    inertia = linalg.block_diag(unit, mass)
    (above, below), y, x = linalg.eig(
        motion, inertia, left=True, right=True, homogeneous_eigvals=True
    )
    kept = finite_roots(above, below)
    roots = _without_round_off(rate * above[kept] / below[kept])
    x = x[:, kept]
    y = y[:, kept]
    x[size:] *= rate
    y[size:] *= rate / scale
    products = np.einsum("ir,ij,jr->r", y.conj(), linalg.block_diag(unit, linear.mass), x)
    x, y = _normalised(x, y, products)
    order = np.lexsort((-roots.imag, -roots.real))
    return Modes(roots[order], x[:, order], y[:, order], linear.mass)


def _without_round_off(roots: np.ndarray) -> np.ndarray:
    """Roots whose imaginary parts are zero where they are round-off, see `REAL`."""
    return np.where(np.abs(roots.imag) > REAL * np.abs(roots), roots, roots.real)


def _normalised(
    x: np.ndarray, y: np.ndarray, products: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Right and left vectors as columns, scaled so that their `products`, shape (r,), are 1."""
    sizes = np.sqrt(np.abs(products))
    return x / sizes, y / (sizes * np.exp(-1j * np.angle(products)))


def _with_memory(sampled: SampledStiffness, mass: np.ndarray) -> Modes:
    """Modes of small motions with an interpolated dynamic stiffness; `mass` is the matrix M."""
    roots, x, y = sampled.modes(mass)
    roots = _without_round_off(roots)
    slopes = [sampled.derivative(mass, root) for root in roots]
    products = np.array([y[:, i].conj() @ slope @ x[:, i] for i, slope in enumerate(slopes)])
    x, y = _normalised(x, y, products)
    upper = [
        (slope - root * mass).conj().T @ y[:, i]
        for i, (slope, root) in enumerate(zip(slopes, roots, strict=True))
    ]
    order = np.lexsort((-roots.imag, -roots.real))
    right = np.vstack([x, roots * x])
    dual = np.vstack([np.stack(upper, axis=1), y])
    return Modes(roots[order], right[:, order], dual[:, order], mass)


def root_scatter(modes: Modes, mean: Linearisation, parts: Sequence[Linearisation]) -> np.ndarray:
    """Scatter of roots over film meshes to first order, see the module, shape (r,) [1/s].

    Real and imaginary parts are half the ranges of the real and imaginary parts of the roots.

    Parameters
    ----------
    modes, mean
        Modes of the means over the meshes, and the means.
    parts
        Small motions on every mesh, in the same coordinates q.
    """
    scatter = np.zeros(len(modes.roots), dtype=complex)
    if len(parts) == 1:
        return scatter
    lower = modes.left_eigenvectors[len(modes.mass) :]
    for i, root in enumerate(modes.roots):
        stiffness = mean.dynamic_stiffness(root)
        x = modes.shapes[:, i]
        changes = np.array(
            [-lower[:, i].conj() @ (part.dynamic_stiffness(root) - stiffness) @ x for part in parts]
        )
        scatter[i] = 0.5 * (np.ptp(changes.real) + 1j * np.ptp(changes.imag))
    return scatter


def damping_ratio(root: complex) -> float:
    """Damping ratio of a mode with a given root; 1 if the root is real and stable."""
    return float(-root.real / abs(root)) if root else 0.0


def log_decrement(root: complex) -> float | None:
    """Logarithmic decrement of a mode with a given root; None if the root is real."""
    return float(-2 * np.pi * root.real / abs(root.imag)) if root.imag else None


def damping_ratio_scatter(root: complex, scatter: complex) -> float:
    """Scatter of a damping ratio over film meshes, to first order; 0 if the root is real.

    `scatter` is that of the root, see `root_scatter`. Its real and imaginary parts are combined
    with the worst signs, so that the result is at least half the range of the ratio.
    """
    sigma = abs(root.real)
    nu = abs(root.imag)
    return float(nu * (nu * scatter.real + sigma * scatter.imag) / abs(root) ** 3) if nu else 0.0


def log_decrement_scatter(root: complex, scatter: complex) -> float | None:
    """Scatter of a logarithmic decrement, as `damping_ratio_scatter`; None if the root is real."""
    sigma = abs(root.real)
    nu = abs(root.imag)
    return float(2 * np.pi * (nu * scatter.real + sigma * scatter.imag) / nu**2) if nu else None


# Points of a rotor


@dataclass(frozen=True, eq=False)
class Stations(Described):
    """Points of a rotor at which the deflections of modes are computed.

    Attributes
    ----------
    names
        Names of the p points, ``"shaft.disk"``; nodes of the beam mesh are ``"shaft[3]"``.
    bodies
        Name of the body of every point.
    heights
        Position of every point along the axis of its shaft [m], shape (p,); 0 on other bodies.
    rows
        Derivatives of the deflections (u, v) with respect to the coordinates z, shape (p, 2, n).
    """

    names: tuple[str, ...]
    bodies: tuple[str, ...]
    heights: np.ndarray
    rows: np.ndarray

    def deflections(self, linear: Linearisation, motions: np.ndarray) -> np.ndarray:
        """Deflections (u, v) of the p points for motions in coordinates q, shape (p, 2, ...)."""
        return np.asarray(self.rows @ linear.basis @ motions)


def stations_of(system: System, z: np.ndarray) -> Stations:
    """Stations of a mechanism: nodes and points of its shafts, and points of other moving bodies.

    Parameters
    ----------
    system
        Equations of the mechanism.
    z
        Coordinates in equilibrium, shape (n,).
    """
    names: list[str] = []
    bodies: list[str] = []
    heights: list[float] = []
    rows: list[np.ndarray] = []
    for dofs, body, (coordinates,) in system.each_body(z):
        name = next(n for n, other in system.bodies.items() if other == dofs)
        if isinstance(body, ShaftBody):
            nodes = np.linspace(0.0, 1.0, body.elements + 1)
            shares = {f"{name}[{i}]": float(share) for i, share in enumerate(nodes)}
            shares |= {f"{name}.{point}": share for point, share in body.points.items()}
            for label, share in sorted(shares.items(), key=lambda item: item[1]):
                motion = np.zeros((2, system.n))
                motion[:, dofs.start + 1 : dofs.stop] = body.rotor.motion(share)[:2]
                names.append(label)
                heights.append(share * body.length)
                rows.append(motion)
                bodies.append(name)
            continue
        for point in ("", *body.point_names):
            names.append(f"{name}.{point}" if point else name)
            heights.append(0.0)
            rows.append(_rows(system, dofs, body, point, coordinates))
            bodies.append(name)
    return Stations(tuple(names), tuple(bodies), np.array(heights), np.array(rows))


def _rows(
    system: System, dofs: slice, body: Body, point: str, coordinates: np.ndarray
) -> np.ndarray:
    """Derivatives of the deflections (u, v) of a body's point with respect to z, shape (2, n).

    `dofs` are the indices of the body's coordinates in z.
    """
    rows = np.zeros((2, system.n))
    rows[:, dofs] = body.marker(point, coordinates).jacobian[:2]
    return rows


def point_rows(system: System, z: np.ndarray, marker: str) -> np.ndarray:
    """Derivatives of the deflections (u, v) of a point with respect to z, shape (2, n).

    `marker` is the name of the point, ``"body.point"``, and z are the coordinates in equilibrium.

    Raises
    ------
    SettingsError
        No moving body has this name, or the body has no point of this name.
    """
    moving = [body for body, dofs in system.bodies.items() if dofs.stop > dofs.start]
    known = {dofs.start: body.point_names for dofs, body, _ in system.each_body(z)}
    require_point("unbalance", marker, {name: known[system.bodies[name].start] for name in moving})
    name, _, point = marker.partition(".")
    for dofs, body, (coordinates,) in system.each_body(z):
        if dofs == system.bodies[name]:
            require_shaft_point("unbalance", marker, body)
            return _rows(system, dofs, body, point, coordinates)
    raise AssertionError(marker)


def whirl_direction(deflections: np.ndarray, sense: float = 1.0) -> float:
    """Whirl direction kappa of a mode with nu > 0, see the module; 0 without motion.

    `deflections` are the complex deflections (u, v) of p points, shape (p, 2). `sense` is positive
    if the rotor rotates from x to y, else negative.
    """
    u, v = deflections.T
    size = float(np.sum(np.abs(deflections) ** 2))
    if not size:
        return 0.0
    return float(-2 * np.sign(sense) * np.sum(u.conj() * v).imag / size)


def whirl_name(direction: float) -> str:
    """Name of a whirl direction kappa."""
    if abs(direction) <= STRAIGHT:
        return "straight line"
    return "forward whirl" if direction > 0 else "backward whirl"


# Following modes over speeds


def matched(former: Modes, modes: Modes) -> tuple[np.ndarray, np.ndarray]:
    """Find the modes that continue former modes at a neighbouring speed, by the largest overlaps.

    Returns
    -------
    partners, overlaps : numpy.ndarray
        For each of the r former modes: index of the mode that continues it, or -1; and the overlap
        of the two modes. Both have the shape (r,).
    """
    from scipy.optimize import linear_sum_assignment

    values = former.overlaps(modes)
    rows, columns = linear_sum_assignment(-(np.minimum(values, 1.0) ** 2))
    partners = np.full(len(former.roots), -1)
    overlaps = np.zeros(len(former.roots))
    partners[rows] = columns
    overlaps[rows] = values[rows, columns]
    return partners, overlaps


def followed(sequence: Sequence[Modes]) -> tuple[np.ndarray, np.ndarray]:
    """Follow modes over speeds; a track is one mode that is followed.

    Parameters
    ----------
    sequence
        Modes at each of s speeds, in ascending order of the speeds.

    Returns
    -------
    tracks, overlaps : numpy.ndarray
        Index of each track's mode at each speed, -1 if the track has no mode there; and overlap
        of this mode with the track's mode at the former speed, 1 at its first speed. Both have the
        shape (tracks, s).
    """
    tracks = [[i] for i in range(len(sequence[0].roots))]
    overlaps = [[1.0] for _ in tracks]
    for n in range(1, len(sequence)):
        partners, values = matched(sequence[n - 1], sequence[n])
        taken = set()
        for track, value in zip(tracks, overlaps, strict=True):
            last = track[-1]
            track.append(int(partners[last]) if last >= 0 else -1)
            value.append(float(values[last]) if last >= 0 else 0.0)
            taken.add(track[-1])
        for mode in range(len(sequence[n].roots)):
            if mode not in taken:
                tracks.append([-1] * n + [mode])
                overlaps.append([0.0] * n + [1.0])
    return np.array(tracks), np.array(overlaps)
