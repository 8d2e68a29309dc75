"""Flexibility errors of bodies reduced by M4, under pressures of a run, from static responses.

If a body was reduced by the method M4, its displacements are exact for the family of film pressures
that the reduction used. Before any run, they are verified for other pressures. Pressures of a run
differ from both. If the part itself is in memory, its static responses to eight pressures of the
run show the error of the body's displacements. This takes one factorisation of the stiffness matrix
and one solve with eight right-hand sides.

Imports inside functions: runs without an elastic part do without static responses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fenics_ehd.analysis.replay import Trajectory
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.trust import surface_loads

if TYPE_CHECKING:
    from fenics_ehd.reduction.body import ReducedBody
    from fenics_ehd.reduction.family_responses import Responses

#: Number of pressures of a run that are checked.
CHECKED = 8

#: Pressures below this share of the run's largest are not checked: their displacements are small.
LEAST = 0.05

#: Verified error below which a body is exact: every nodal pressure was solved for.
EXACT = 1e-9


@dataclass(frozen=True, eq=False)
class PartInMemory:
    """A part whose assembled structure is still in memory after a run, with its reduced body.

    Attributes
    ----------
    reduced
        The reduced body of the part.
    respond
        Function that computes static responses of the part to nodal pressures on its bores. The
        pressures have the shape (nodes, patterns) [Pa].
    """

    reduced: ReducedBody
    respond: Callable[[np.ndarray], Responses]


def checked_errors(
    system: System, trajectory: Trajectory, parts: Mapping[str, PartInMemory]
) -> dict[str, float]:
    """Largest relative error of a body's displacements in its bores under pressures of a run.

    The errors are listed by body. Bodies are not listed if the reduction estimated no error of
    their flexibility, or if this error is zero.

    Parameters
    ----------
    system
        The mechanism.
    trajectory
        Trajectory of the run.
    parts
        Parts in memory, by the name of their body.
    """
    from fenics_ehd.reduction.family_responses import largest_error

    errors = {}
    for name, part in parts.items():
        if not part.reduced.flexibility_error > EXACT:  # nan: not to be estimated
            continue
        pressures = _pressures(system, trajectory, name)
        if pressures.shape[1]:
            errors[name] = largest_error(part.respond(pressures), part.reduced)
    return errors


def _pressures(system: System, trajectory: Trajectory, name: str) -> np.ndarray:
    """Nodal pressures on all bores of a body at some steps of a run, shape (nodes, steps) [Pa].

    There are at most `CHECKED` steps, among them the steps with the peak pressures and the minimum
    film thicknesses of the body's films.
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
