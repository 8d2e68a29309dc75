"""Error of M4's flexibility under pressures of a run, by static responses of the part.

A body of M4 is exact for the pressures of a family, and verified with others before any run. After
a run its own pressures are known. If the part is at hand, static responses to eight of them show
the error of the run's displacements: one factorisation of the part, and one block of solves.

Imports inside functions: runs without an elastic part do without static responses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from fenics_ehd.analysis.replay import Trajectory
from fenics_ehd.multibody.body import FlexibleBody
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.trust import surface_loads

if TYPE_CHECKING:
    from fenics_ehd.reduction.family_responses import Responses

#: Number of pressures of a run that are checked.
CHECKED = 8

#: Pressures below this share of the run's largest are not checked: their displacements are small.
LEAST = 0.05

#: Verified error below which a body is exact: every nodal pressure was solved for.
EXACT = 1e-9

#: Static responses of a part to nodal pressures on its bores, shape (k, r) [Pa].
Responding = Callable[[np.ndarray], "Responses"]


def checked_errors(
    system: System, trajectory: Trajectory, parts: Mapping[str, Responding]
) -> dict[str, float]:
    """Largest relative error of the bores' displacements of each body, by its name.

    Parameters
    ----------
    system
        The mechanism.
    trajectory
        Trajectory of the run.
    parts
        Static responses of the parts that are at hand, by name of the body.
    """
    from fenics_ehd.reduction.family_responses import largest_error

    errors = {}
    for name, responding in parts.items():
        body = system.mechanism.bodies[name]
        assert isinstance(body, FlexibleBody)
        if not body.reduced.flexibility_error > EXACT:  # nan: not to be estimated
            continue
        pressures = _pressures(system, trajectory, name)
        if pressures.shape[1]:
            errors[name] = largest_error(responding(pressures), body.reduced)
    return errors


def _pressures(system: System, trajectory: Trajectory, name: str) -> np.ndarray:
    """Pressures on all bores of a body at some steps of a run, shape (k, at most `CHECKED`) [Pa].

    Among them are those with the peak pressures and the thinnest films.
    """
    films = list(trajectory.pressures.values())
    mine = [
        i
        for i, binding in enumerate(system.films)
        if any(bound.body == name for bound in binding.surfaces)
    ]
    if not mine:
        return np.zeros((0, 0))
    peaks = np.max([films[i].max(axis=1) for i in mine], axis=0)
    loaded = np.flatnonzero(peaks > LEAST * peaks.max())
    (largest, thinnest) = trajectory.extremes
    chosen = {int(np.argmax(largest[:, i])) for i in mine}
    chosen |= {int(loaded[np.argmin(thinnest[loaded, i])]) for i in mine}
    even = loaded[np.linspace(0, len(loaded) - 1, CHECKED).astype(int)]
    steps = [*chosen, *(int(step) for step in even if int(step) not in chosen)][:CHECKED]
    each = [
        surface_loads(system, [film[step] for film in films], trajectory.x[step])[name]
        for step in sorted(steps)
    ]
    return np.column_stack(each)
