"""Notices of rotor maps: no force, large orbits, films without load or with turbulence.

The linear response to an unbalance holds for small orbits. Stiffness and damping of a film without
load depend on round-off, and those of a turbulent film are not computed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from fenics_ehd.analysis.unbalance import UnbalanceResponse, larger_axes
from fenics_ehd.multibody.mechanism import System

#: Results of the films in equilibrium by column, see `MapPoint.figures`, by speed [rad/s].
FilmFigures = Mapping[float, Mapping[str, float]]

#: Orbit of a journal, as a share of the clearance, up to which its linear response is reported
#: without a notice.
LARGEST_ORBIT = 0.3

#: Share of the clearance and pressure over ``eta |Omega| (R / c)^2`` below which a film carries
#: almost no load.
SMALL_ECCENTRICITY = 1e-3
SMALL_PRESSURE = 1e-2

#: Taylor's limit of laminar flow in a bearing: the Reynolds number over ``sqrt(R / c)``.
TAYLOR = 41.0


def response_notices(system: System, response: UnbalanceResponse) -> Iterator[str]:
    """Notices of a response to unbalances: without a force, or with large orbits."""
    if response.excited:
        yield from _large_orbits(system, response)
        return
    points = ", ".join(dict.fromkeys(each.point for each in response.unbalances))
    why = "cancel each other" if any(each.magnitude for each in response.unbalances) else "are 0"
    yield f"the unbalances at {points} {why}: no force acts, and the response is zero"


def _large_orbits(system: System, response: UnbalanceResponse) -> Iterator[str]:
    """Notices of journals whose orbits are too large for the linear response to an unbalance."""
    vibration = response.interpolated
    for binding in system.films:
        clearance = binding.film.film.parameters.clearance
        amplitudes = larger_axes(vibration.journals[binding.name])
        n = int(np.argmax(amplitudes))
        share = amplitudes[n] / clearance
        if share > LARGEST_ORBIT:
            yield (
                f"joints.{binding.name}: at {abs(vibration.speeds[n]):.5g} rad/s the unbalance "
                f"moves the journal by {1e6 * amplitudes[n]:.4g} um, {share:.3g} "
                f"of the clearance of {1e6 * clearance:.4g} um: the linear response holds for "
                f"orbits below {LARGEST_ORBIT} of the clearance: run the scene for its orbit"
            )


def unloaded_films(system: System, figures: FilmFigures) -> Iterator[str]:
    """Notices of films that carry almost no load in equilibrium.

    The pressure of such a film is almost zero: which part of it cavitates is left to round-off.
    """
    for binding in system.films:
        parameters = binding.film.film.parameters
        ratio = parameters.grid.radius / parameters.clearance
        for speed, columns in figures.items():
            pressure, eccentricity, force = (
                columns[f"{binding.name}.{column}"]
                for column in ("max_pressure_Pa", "eccentricity_ratio", "force_N")
            )
            scale = parameters.lubricant.viscosity * abs(speed) * ratio**2
            if pressure < SMALL_PRESSURE * scale and eccentricity < SMALL_ECCENTRICITY:
                yield (
                    f"joints.{binding.name}: at {abs(speed):.5g} rad/s its film carries "
                    f"{force:.3g} N at {eccentricity:.2g} of the "
                    "clearance: stiffness and damping of a film without load are not unique: load "
                    "the bearing, for instance by gravity"
                )
                break


def turbulent_films(system: System, figures: FilmFigures) -> Iterator[str]:
    """Notices of films whose Reynolds number exceeds Taylor's limit of laminar flow."""
    for binding in system.films:
        parameters = binding.film.film.parameters
        limit = TAYLOR * np.sqrt(parameters.grid.radius / parameters.clearance)
        numbers = {speed: row[f"{binding.name}.reynolds_number"] for speed, row in figures.items()}
        beyond = [speed for speed, number in numbers.items() if number > limit]
        if beyond:
            yield (
                f"joints.{binding.name}: from {abs(beyond[0]):.5g} rad/s on, the Reynolds number "
                f"of its film, {numbers[beyond[0]]:.4g}, is above Taylor's limit of laminar flow, "
                f"41 sqrt(R / c) = {limit:.4g}: coefficients at these speeds are those of a "
                "laminar film"
            )
