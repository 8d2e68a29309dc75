"""Bore flexibility that answers the film's pressure at once (M4).

    u_bore = Psi q + sum_i d_i y_i,    y + zeta y' = V p

with the residual patterns ``d_i`` of a `ReducedBody` and V their share of nodal
pressures. Structural damping gives y a memory but no inertia: an implicit step
``y' = alpha y + past`` leaves ``y = (V p - zeta past) / (1 + zeta alpha)``, so that the
patterns add no unknowns to those of the film.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.multibody.bore_film import BoreFilm


@dataclass(frozen=True, eq=False)
class BoreCompliance:
    """Residual patterns of one bore as its film sees them.

    Attributes
    ----------
    outward
        Outward displacement at the film's Gauss points for unit amplitudes, shape (g, r) [m/Pa].
    watched
        The same where the gap is watched, shape (w, r).
    patterns
        V, shape (r, nodes), from the film's own integrals: gap and force are conjugate.
    stiffness
        Energy of unit amplitudes, twice, shape (r,) [J/Pa^2].
    damping_time
        zeta [s].
    """

    outward: np.ndarray
    watched: np.ndarray
    patterns: np.ndarray
    stiffness: np.ndarray
    damping_time: float

    @classmethod
    def of(cls, bore: BoreFilm, stiffness: np.ndarray, damping_time: float) -> BoreCompliance:
        """The last ``r`` fields of a bore are its residual patterns."""
        r = len(stiffness)
        outward = bore.outward.reshape(-1, bore.outward.shape[-1])
        fields = slice(outward.shape[1] - r, None)
        patterns = bore.load[len(bore.load) - r :] / stiffness[:, None]
        return cls(
            np.ascontiguousarray(outward[:, fields]),
            np.ascontiguousarray(bore.watched[:, fields]),
            patterns,
            stiffness,
            damping_time,
        )

    @property
    def size(self) -> int:
        """Number r of patterns."""
        return len(self.stiffness)

    def answer(self, shift: float, past: np.ndarray) -> tuple[float, np.ndarray]:
        """Share s and rest ``y_0`` of ``y = s V p + y_0`` at the end of an implicit step.

        Parameters
        ----------
        shift, past
            ``y' = shift y + past``.
        """
        share = 1.0 / (1.0 + self.damping_time * shift)
        return share, -share * self.damping_time * past

    def energy(self, amplitudes: np.ndarray) -> float:
        """Strain energy [J]."""
        return float(0.5 * self.stiffness @ amplitudes**2)

    def dissipation(self, rates: np.ndarray) -> float:
        """Power lost in the structure [W]."""
        return float(self.damping_time * self.stiffness @ rates**2)
