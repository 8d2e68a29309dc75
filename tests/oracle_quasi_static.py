"""Bore flexibility without inertia (M4) as coordinates that have stiffness and damping alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import fenics_ehd as ehd
from fenics_ehd.reduction.body import InertiaIntegrals


def massless_coordinates(body: ehd.ReducedBody) -> ehd.ReducedBody:
    """A body of which every residual pattern is a coordinate without mass.

    With ``K = V^T J^T G_res J V`` and the damping zeta K of all coordinates, the
    equation of such a coordinate, ``K (y + zeta y') = K V^T P``, is the
    ``w + zeta dw/dt = P`` of M4 for ``y = V^T w``. Amplitudes are scaled to the
    largest displacement of the bore [m].

    Parameters
    ----------
    body
        Any reduced body; one without residual flexibility is returned as it is.
    """
    residual = body.residual
    if residual is None or not residual.rank:
        return body
    size = np.abs(residual.displacement).max(axis=(0, 1))
    r = residual.rank
    stiffness = np.zeros((body.modes + r,) * 2)
    stiffness[: body.modes, : body.modes] = body.stiffness
    stiffness[body.modes :, body.modes :] = np.diag(residual.stiffness / size**2)
    load = (residual.stiffness / size)[:, None] * residual.patterns
    return replace(
        body,
        stiffness=stiffness,
        mass=_padded(body.mass, r),
        frequencies=np.concatenate([body.frequencies, np.full(r, np.inf)]),
        kinds=body.kinds + ("quasi-static",) * r,
        bore_basis=np.concatenate([body.bore_basis, residual.displacement / size], axis=2),
        load_projection=np.vstack([body.load_projection, load]),
        # The moment on a deformation as small as this one does not matter.
        spin_load_projection=np.vstack([body.spin_load_projection, np.zeros_like(load)]),
        inertia=InertiaIntegrals(
            _padded(body.inertia.mass, r),
            _padded(body.inertia.spin, r),
            _padded(body.inertia.centrifugal, r),
        ),
        points={name: np.hstack([rows, np.zeros((3, r))]) for name, rows in body.points.items()},
        rigid_coupling=_wider(body.rigid_coupling, r),
        residual=None,
    )


def _padded(matrix: np.ndarray, count: int) -> np.ndarray:
    return np.pad(matrix, (0, count))


def _wider(matrix: np.ndarray, count: int) -> np.ndarray:
    return np.hstack([matrix, np.zeros((len(matrix), count))]) if matrix.size else matrix
