"""Verdict on a run: complete, or the reason for rejecting its results.

Results are rejected if a known error exceeds its limit, if a film is too thin for its mesh, or if
the energy balance error exceeds both its limit and the time-stepping error. If the error budget
does not contain the error of a film's mesh, the mesh is judged by the spacing of its nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.newton import unresolved
from fenics_ehd.multibody.notices import resting_films
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.trust import COMPONENTS, ENERGY_LIMIT, KEYS, NOT_ESTIMATED, QUANTITIES

#: Verdict on a run whose results are accepted.
COMPLETE = "complete"


def verdict(summary: RunSummary, limit: float = np.inf) -> str:
    """Verdict on a run: `COMPLETE`, or the reason for rejecting its results.

    Parameters
    ----------
    summary
        Summary of a run that has ended, with its error budget if one was estimated.
    limit
        Largest accepted relative error of peak pressure and smallest film thickness [-].
    """
    films = summary.recorder.system.films
    if films and len(resting_films(summary.recorder.system, summary.peaks)) == len(films):
        return COMPLETE  # relative errors of round-off are meaningless
    reason = exceeding_limit(summary.error_budget, limit)
    if not reason and reported_error(summary.error_budget, "film_mesh") is None:
        reason = _unresolved_film(summary)
    return reason or _energy_defect(summary) or COMPLETE


def _unresolved_film(summary: RunSummary) -> str:
    """Reason for rejecting the first film that is too thin for its mesh; empty if none is."""
    for binding in summary.recorder.system.films:
        thickness = summary.extremes[binding.name]["min_film_thickness"][0]
        reason = too_coarse(binding, thickness)
        reason = reason or unresolved(binding, summary.steepest_thickening(binding))
        if reason:
            return reason
    return ""


def _energy_defect(summary: RunSummary) -> str:
    """Reason for rejecting a run by its energy balance error; empty if it is accepted.

    The limit of this error is the larger one of `ENERGY_LIMIT` and, if known, the time-stepping
    error.
    """
    steps = reported_error(summary.error_budget, "step_size") or 0.0
    limit = max(steps, ENERGY_LIMIT)
    error = summary.energy_error
    if error <= limit:
        return ""
    return (
        f"untrustworthy: energy balance error {100 * error:.2g} % of the energy exchanged, "
        f"above {100 * limit:.2g} %: lower time.tolerance or time.largest_step"
    )


def reported_error(error_budget: Mapping[str, Any], component: str) -> float | None:
    """Largest error due to one component of the error budget, over the cycle and all joints.

    The error is relative [-]. The result is None if the error of a joint is not known.
    """
    errors = [
        budget["largest_over_cycle"][quantity][component]
        for budget in error_budget.values()
        for quantity in QUANTITIES
    ]
    if not errors or NOT_ESTIMATED in errors:
        return None
    return max((error for error in errors if not isinstance(error, str)), default=0.0)


def exceeding_limit(error_budget: Mapping[str, Any], limit: float) -> str:
    """Reason for rejecting a run whose largest known error exceeds the limit; else empty."""
    errors: dict[tuple[str, str], float] = {}
    for joint, budget in error_budget.items():
        for quantity in QUANTITIES:
            known = budget[quantity]["known"]
            if not isinstance(known, str):
                errors[joint, quantity] = known
    if not errors or max(errors.values()) <= limit:
        return ""
    joint, quantity = max(errors, key=errors.__getitem__)
    figure = error_budget[joint][quantity]
    estimated = [key for key in COMPONENTS if not isinstance(figure[key], str)]
    worst = max(estimated, key=figure.__getitem__)
    of_joint = f"joints.{joint}." if worst == "film_mesh" else ""
    return (
        f"untrustworthy: {quantity} of joints.{joint} is off by {100 * figure['known']:.3g} %, "
        f"above output.error_limit = {100 * limit:g} %, most of it by the "
        f"{worst.replace('_', ' ')}: see {of_joint}{KEYS[worst]}"
    )


#: Largest distance of adjacent nodes around, over the angle over which the film is thin. At this
#: limit the error of the load at a fixed position is 2 % on quadratic cells and 6 % on bilinear
#: ones, and that of the smallest film of an orbit is smaller; at 0.8 the error of the load is 15 %.
NODE_SPACING = 0.5


def too_coarse(binding: FilmBinding, thickness: float) -> str:
    """Reason for rejecting a film whose nodes are too far apart for its smallest thickness [m].

    The reason is empty if the spacing is fine enough, or if a surface is elastic.
    """
    if binding.film.elastic:
        return ""
    angles = np.unique(binding.film.film.parameters.grid.node_positions[:, 0].round(9))
    spacing = np.degrees(np.diff(angles, append=angles[0] + 2 * np.pi).max())
    # The film is thin where the gap h = c (1 - eps cos phi) is below twice its minimum.
    length = float(binding.film.lengths(np.array([thickness]))[0])
    bend = binding.film.clearance + sum(
        surface.largest_second_derivative for surface in binding.film.surfaces
    )
    thin = np.degrees(np.sqrt(2 * length / bend))
    if spacing <= NODE_SPACING * thin:
        return ""
    return (
        f"untrustworthy: joints.{binding.name}.cells put nodes {spacing:.3g} degrees apart, above "
        f"half of the {thin:.3g} degrees over which a film of {thickness * 1e6:.3g} um is thin: "
        "use more cells around"
    )
