"""Stiffness and damping of a journal bearing, and the stability of a rigid rotor in it.

A rigid rotor of mass M on a bearing of stiffness k and damping b moves by
``M x'' + b x' + k x = 0``. It is at the threshold of whirl if a solution ``exp(i nu t)`` exists:

    M nu^2 = kappa = (k_xx b_yy + k_yy b_xx - k_xy b_yx - k_yx b_xy) / (b_xx + b_yy),
    kappa = tr k - tr (k b) / tr b,
    nu^2 = det (k - kappa) / det b.

The rotor is stable for masses below ``kappa / nu^2``. If there is no such nu (``nu^2 <= 0``), it
is stable for every mass.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.described import Described, first_sentence
from fenics_ehd.base.printed import scatter_text


@dataclass(frozen=True, eq=False)
class DynamicCoefficients(Described):
    """Stiffness, damping and stability of a shaft in its bearing, with x along the load.

    Attributes
    ----------
    stiffness
        Stiffness k, shape (2, 2) [N/m].
    damping
        Damping b, shape (2, 2) [N s/m].
    critical_mass
        Mass M of a rigid rotor at the threshold [kg]; None if every mass is stable, 0 if none is.
    whirl_ratio
        Whirl frequency nu at the threshold over the speed of the shaft [-]; None without a
        threshold.
    threshold
        Stability threshold ``omega sqrt(c M / W)`` [-]: dimensionless speed above which a rotor
        whose weight is the load W is unstable; None if every mass is stable.
    stiffness_scatter, damping_scatter
        Half the range of stiffness and damping over the film meshes, shape (2, 2) [N/m, N s/m];
        None for a single mesh.
    critical_mass_scatter, whirl_ratio_scatter, threshold_scatter
        Half the range of these values over the film meshes, in their units; None for a single mesh,
        or without the value on a mesh.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    critical_mass: float | None
    whirl_ratio: float | None
    threshold: float | None
    stiffness_scatter: np.ndarray | None = None
    damping_scatter: np.ndarray | None = None
    critical_mass_scatter: float | None = None
    whirl_ratio_scatter: float | None = None
    threshold_scatter: float | None = None

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield stiffness, damping and stability, each with its scatter over the film meshes."""
        yield "DynamicCoefficients", first_sentence(type(self))
        yield "stiffness", _matrix_text(self.stiffness, self.stiffness_scatter, 1e-6, "MN/m")
        yield "damping", _matrix_text(self.damping, self.damping_scatter, 1e-3, "kN s/m")
        if self.critical_mass is None:
            yield "stability", "stable for every mass"
            return
        if self.critical_mass == 0.0:
            yield "stability", "unstable for every mass"
            return
        mass = _with_scatter(self.critical_mass, self.critical_mass_scatter)
        whirl = ""
        if self.whirl_ratio is not None:
            whirl = f", whirl ratio {_with_scatter(self.whirl_ratio, self.whirl_ratio_scatter)}"
        yield "stability", f"critical mass {mass} kg{whirl}"


def _with_scatter(value: float, scatter: float | None) -> str:
    """Text of a value, with its scatter if there is one."""
    return f"{value:.4g}{scatter_text(scatter, sign='±')}"


def _matrix_text(matrix: np.ndarray, scatter: np.ndarray | None, factor: float, unit: str) -> str:
    """Text of the entries xx, xy, yx and yy of a matrix times a factor, and the largest scatter."""
    entries = ", ".join(f"{factor * entry:.4g}" for entry in matrix.ravel())
    largest = None if scatter is None else factor * float(scatter.max())
    return f"xx, xy, yx, yy: {entries}{scatter_text(largest, sign='±')} {unit}"


def stability(stiffness: np.ndarray, damping: np.ndarray) -> tuple[float | None, float | None]:
    """Critical mass [kg] and whirl frequency [rad/s] of a rigid rotor in its bearing.

    A value that does not exist, because the rotor is always stable or always unstable, is None.
    """
    # The matrices are scaled, because products of small entries would underflow.
    sizes = float(np.abs(stiffness).max()), float(np.abs(damping).max())
    k = stiffness / sizes[0]
    b = damping / sizes[1]
    kappa = np.trace(k) - np.trace(k @ b) / np.trace(b)
    square = np.linalg.det(k - kappa * np.eye(2)) / np.linalg.det(b)
    if kappa <= 0:
        return 0.0, None
    if square <= 0:
        return None, None
    rate = sizes[0] / sizes[1]
    return float(kappa / square * sizes[1] / rate), float(np.sqrt(square) * rate)
