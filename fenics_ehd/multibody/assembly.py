"""Positions and velocities that satisfy every constraint, from a rough pose."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.system import Instant, System

#: Newton's method on positions, and the largest defect it may leave [m], [rad].
MAX_ITERATIONS, TOLERANCE = 50, 1e-12

#: Distance of a constraint's gradient from the span of the others, as a share of its length.
INDEPENDENT = 1e-9


def assemble(
    system: System, time: float = 0.0, rough: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and rates nearest to the rough ones, shape (n,) each.

    Frames move, eccentricities and elastic coordinates stay as far as they can. The rough
    coordinates are those of the bodies if none are given.

    Raises
    ------
    SettingsError
        The constraints cannot be met from there, or contradict or repeat each other.
    """
    instant = system.at(time, system.start if rough is None else rough)
    rates = system.start_rates
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
        trial = instant.system.at(instant.time, instant.z + 0.5**halving * change)
        if np.abs(trial.defect).max() < before:
            break
    return trial


def _correction(system: System, instant: Instant, defect: np.ndarray) -> np.ndarray:
    """Smallest weighted change of coordinates that takes a defect away, shape (n,)."""
    gradients = (instant.jacobian * system.weights).T
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
    return -system.weights * (q @ linalg.solve_triangular(r, given, trans="T"))
