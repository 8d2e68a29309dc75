"""Positions and velocities that satisfy every constraint, from a rough pose."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.motion import Instant, Motion
from fenics_ehd.multibody.system import System

#: Newton's method on positions, and the largest defect it may leave [m], [rad].
MAX_ITERATIONS, TOLERANCE = 50, 1e-12

#: Distance of a constraint's gradient from the span of the others, as a share of its length.
INDEPENDENT = 1e-9

#: A motion that meets less than this share of any inertia, spring or joint meets none.
NOTHING = 1e-10


def assemble(
    system: System,
    time: float = 0.0,
    rough: np.ndarray | None = None,
    rates: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and rates nearest to the rough ones, shape (n,) each.

    Frames move, shafts as a whole too; eccentricities and elastic coordinates stay as far as they
    can. The rough coordinates and rates are those of the bodies if none are given.

    Raises
    ------
    SettingsError
        The constraints cannot be met from there, or contradict or repeat each other.
    """
    instant = Instant(system, time, system.start if rough is None else rough)
    rates = system.start_rates if rates is None else rates
    unknown = ~np.isfinite(instant.defect)
    if unknown.any():
        name, _ = system.worst(unknown.astype(float))
        raise SettingsError(f"joint {name}: the places of its bodies must be finite numbers")
    # Joints that repeat each other do so in any pose, the rough one too.
    _correction(system, instant, instant.defect)
    for _ in range(MAX_ITERATIONS):
        if np.abs(instant.defect).max(initial=0.0) <= TOLERANCE:
            return instant.z, rates + _correction(system, instant, instant.rate_defect(rates))
        try:
            instant = _closer(instant, _correction(system, instant, instant.defect))
        except SettingsError:
            break
    name, defect = system.worst(instant.defect)
    raise SettingsError(
        f"the mechanism cannot be assembled from its rough pose: joint {name} stays open by "
        f"{defect:.3g} (m or rad); check lengths, or give positions nearer to those meant"
    )


def _closer(instant: Instant, change: np.ndarray) -> Instant:
    """A Newton step, halved until the joints are less open than before."""
    before = np.abs(instant.defect).max()
    for halving in range(MAX_ITERATIONS):
        trial = Instant(instant.system, instant.time, instant.z + 0.5**halving * change)
        if np.abs(trial.defect).max() < before:
            break
    return trial


def _correction(system: System, instant: Instant, defect: np.ndarray) -> np.ndarray:
    """Smallest weighted change of coordinates that takes a defect away, shape (n,)."""
    weights = system.mobility
    gradients = (instant.jacobian * weights).T
    lengths = np.linalg.norm(gradients, axis=0)
    if not lengths.all():
        name, _ = system.worst((lengths == 0.0).astype(float))
        raise SettingsError(f"joint {name} connects nothing that can move")
    q, r, order = linalg.qr(gradients / lengths, mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(r)) > INDEPENDENT))
    if rank < len(order):
        name, _ = system.worst(np.arange(len(order)) == order[rank])
        raise SettingsError(
            f"joint {name} repeats or contradicts other joints: drop one of them, or let it turn "
            "or slide; a linkage at a change point has to be assembled elsewhere"
        )
    given = (defect / lengths)[order]
    return -weights * (q @ linalg.solve_triangular(r, given, trans="T"))


def check_inertia(system: System, z: np.ndarray) -> None:
    """Refuse a motion of a frame that no constraint, inertia, spring, damper or film resists.

    The oil's shear is none: its derivative is left out of a step's equations.

    Raises
    ------
    SettingsError
        Naming the body.
    """
    frames = np.flatnonzero(system.weights == 1.0)
    rest, instant = np.zeros(system.n), Instant(system, 0.0, z)
    forces = Motion(instant, rest, rest, np.zeros(system.m)).derivatives()
    blocks = [
        instant.jacobian[:, frames],
        *(part[np.ix_(frames, frames)] for part in vars(forces).values()),
    ]
    _, sizes, motions = linalg.svd(np.vstack([_directions(block) for block in blocks]))
    if len(frames) and (len(sizes) < len(frames) or sizes[-1] < NOTHING * sizes[0]):
        free = np.zeros(system.n)
        free[frames] = np.abs(motions[-1])
        name = max(system.bodies, key=lambda n: free[system.bodies[n]].max(initial=0.0))
        raise SettingsError(
            f"body {name} can move or turn freely without inertia: give it mass and inertia, or a "
            "joint or drive that holds it"
        )


def _directions(rows: np.ndarray) -> np.ndarray:
    """Rows of length 1, without those that are nothing but round-off."""
    lengths = np.linalg.norm(rows, axis=1)
    kept = lengths > 1e-14 * lengths.max(initial=0.0)
    return rows[kept] / lengths[kept, None]
