"""Stiffness, damping and the speed at which a bearing's rotor becomes unstable.

``k_ij = -dF_i / dx_j`` and ``b_ij = -dF_i / dv_j`` of the film's pressure force on the
shaft, x along the load, y a quarter turn on in direction of rotation: the exact
derivatives of the discrete force, its active set held. They jump, by up to 1 % on 64 x 12
cells, whenever the edge of the film moves on by a row of nodes; the mean over four
meshes with slightly different cells cancels most of that. A line without pressure at the
maximum film turns with the eccentricity, or stays where it is (`line_held`).

A rigid rotor of mass M on ``M x'' + b x' + k x = 0`` is about to whirl when a solution
``exp(i nu t)`` exists. Separating real and imaginary parts,

    M nu^2 = kappa = (k_xx b_yy + k_yy b_xx - k_xy b_yx - k_yx b_xy) / (b_xx + b_yy)
    nu^2 = ((k_xx - kappa) (k_yy - kappa) - k_xy k_yx) / (b_xx b_yy - b_xy b_yx)

It is stable for masses below ``kappa / nu^2``, and at every mass when there is no
such nu (``nu^2 <= 0``).
"""

from __future__ import annotations

from dataclasses import dataclass

import attrs
import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.bearing.equilibrium import carries
from fenics_ehd.bearing.film import BearingFilm, Operation

#: Cells around that the other three meshes have more.
EXTRA_CELLS = (2, 4, 6)


@dataclass(frozen=True, eq=False)
class DynamicCoefficients:
    """Linear dynamics of a shaft in its bearing.

    Attributes
    ----------
    stiffness
        k, shape (2, 2) [N/m].
    damping
        b, shape (2, 2) [N s/m].
    critical_mass
        M at the threshold [kg], None when every mass is stable; 0 when none is.
    whirl_ratio
        nu over the speed of the shaft there [-]; None without threshold.
    threshold
        ``omega sqrt(c M / W)``: the speed ``omega_th sqrt(c / g)`` at which a rotor whose
        weight is the load becomes unstable [-], read at this Sommerfeld number;
        None when it never does.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    critical_mass: float | None
    whirl_ratio: float | None
    threshold: float | None


def coefficients(bearing: BearingFilm, operation: Operation) -> DynamicCoefficients:
    """Coefficients of a bearing in operation.

    Raises
    ------
    SettingsError
        There is no force or no eccentricity: no derivative exists. Or the oil is compressible:
        the rate of its density is not in the derivatives.
    """
    load = float(np.hypot(*operation.force))
    settings = bearing.settings
    if settings.density_law != "constant":
        raise SettingsError(
            f"density_law = '{settings.density_law}': the damping of compressible oil is not "
            "known: coefficients need density_law = 'constant'"
        )
    if not carries(bearing, operation) or not np.any(operation.position):
        raise SettingsError(
            "coefficients need a film with pressure and an eccentricity above 0: the cavitating "
            "film of a centred shaft has no derivative"
        )
    held = settings.line_held
    derivatives = [bearing.derivatives(operation, line_held=held)]
    for extra in EXTRA_CELLS:
        other = attrs.evolve(settings, cells_around=settings.cells_around + extra)
        film = BearingFilm(other, operation.position)
        derivatives.append(film.derivatives(film.operate(operation.position), line_held=held))
    stiffness, damping = -np.mean(derivatives, axis=0)
    mass, whirl = stability(stiffness, damping)
    speed = abs(settings.speed)
    threshold = None if mass is None else speed * float(np.sqrt(settings.clearance * mass / load))
    ratio = None if whirl is None or not speed else whirl / speed
    return DynamicCoefficients(stiffness, damping, mass, ratio, threshold)


def stability(stiffness: np.ndarray, damping: np.ndarray) -> tuple[float | None, float | None]:
    """Critical mass [kg] and whirl frequency [rad/s] of a rigid rotor; None when always stable."""
    # Scaled, or the products of small ones vanish.
    sizes = float(np.abs(stiffness).max()), float(np.abs(damping).max())
    k, b = stiffness / sizes[0], damping / sizes[1]
    kappa = (
        k[0, 0] * b[1, 1] + k[1, 1] * b[0, 0] - k[0, 1] * b[1, 0] - k[1, 0] * b[0, 1]
    ) / np.trace(b)
    square = ((k[0, 0] - kappa) * (k[1, 1] - kappa) - k[0, 1] * k[1, 0]) / np.linalg.det(b)
    if kappa <= 0:
        return 0.0, None
    if square <= 0:
        return None, None
    rate = sizes[0] / sizes[1]
    return float(kappa / square * sizes[1] / rate), float(np.sqrt(square) * rate)
