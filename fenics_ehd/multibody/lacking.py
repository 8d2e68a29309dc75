"""Gaps that a run lacks along its course: flexibility that its basis or its parts' meshes miss."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.basis_error import BasisErrorEstimate, bore_body, bore_loads, estimate_at
from fenics_ehd.multibody.course import Course
from fenics_ehd.multibody.disturbance import Disturbance
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.system import FilmPlace, System
from fenics_ehd.reduction.mesh_error import smooth_part


def lacking_in_basis(system: System) -> dict[str, BasisErrorEstimate]:
    """What bases lack, by joint.

    Raises
    ------
    SettingsError
        Their missing flexibility is not known.
    """
    estimates = {
        place.name: estimate_at(bore_body(system, place), place.bore)
        for place in system.films
        if place.bore
    }
    for name, estimate in estimates.items():
        if np.isnan(estimate.largest):
            raise SettingsError(f"{name}: reduction.estimate_error is off")
    return estimates


def lacking_in_mesh(system: System) -> dict[str, BasisErrorEstimate]:
    """What meshes of parts lack, by joint.

    Raises
    ------
    SettingsError
        Of a part's mesh nothing is known.
    """
    found = {}
    for place in system.films:
        if place.bore:
            body = bore_body(system, place)
            missing = body.reduced.mesh_flexibility
            if not missing.size:
                raise SettingsError(
                    f"{place.bore_body}: no other mesh of the part is known, see "
                    "output.part_mesh_error"
                )
            error = missing[body.reduced.rows_of(place.bore).nodes]
            error = error @ smooth_part(body.reduced.bores)
            found[place.name] = BasisErrorEstimate(error, body.damping_time)
    return found


def lacking_gaps(
    equations: StepEquations,
    course: Course,
    began: float,
    estimates: Mapping[str, BasisErrorEstimate],
    periodic: bool,
) -> Disturbance:
    """What gaps lack along a course that began at a time [s], by what joints' flexibility lacks."""
    system = equations.system
    rows = range(len(course.times))
    loads = [bore_loads(system, [p[k] for p in course.pressures]) for k in rows]
    steps = np.diff(course.times, prepend=began)
    fields: dict[str, list[np.ndarray]] = {}
    # Twice, as the memory of the structure is that of the cycle before.
    for _ in range(2 if periodic else 1):
        fields = {name: [] for name in estimates}
        for k in rows:
            for place in system.films:
                if place.bore:
                    own = equations.responses.of_body(place.bore_body)
                    estimate, load = estimates[place.name], loads[k][place.bore_body]
                    starts = not periodic and course.times[k] - began <= estimate.start
                    moved = None if starts else course.accelerations[k][own]
                    fields[place.name].append(estimate.field(steps[k], load, moved))
    observed = [
        _observed(system, place, np.array(fields[place.name])) if place.bore else None
        for place in system.films
    ]
    return Disturbance(
        course.times, observed, [len(place.film.thickness) for place in system.films]
    )


def _observed(system: System, place: FilmPlace, outward: np.ndarray) -> np.ndarray:
    """Change of the gap where it is observed, of outward displacements of the bore's nodes."""
    bore = place.film.bore
    assert bore is not None
    part = bore_body(system, place).reduced.at_bore(place.bore)
    radial = part.bore_nodes * [1.0, 1.0, 0.0]
    radial /= np.linalg.norm(radial, axis=1)[:, None]
    fields = outward[:, :, None] * radial
    return np.asarray((bore.observed_normal @ fields.reshape(len(outward), -1).T).T)
