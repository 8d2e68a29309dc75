"""Curves of two runs compared, for every lubricated joint: largest and mean difference.

A run is compared at its own steps: its curves of extremes have kinks between them, where the
extreme moves from one place to the next, that no interpolation meets. The other run, with many
more steps, is interpolated point by point before its extremes are taken. Of periodic runs the
last cycles are compared as functions of the time in the cycle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import attrs
import numpy as np
from mpi4py import MPI
from scipy.integrate import trapezoid
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from fenics_ehd.base.errors import InputError
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.system import System
from fenics_ehd.reduction import load_body
from fenics_ehd.results.load import load_results
from fenics_ehd.results.run_folder import BODY_FILE
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.scene import Scene, lubricated_joints


@dataclass(frozen=True)
class Errors:
    """Differences of two runs in one joint.

    Attributes
    ----------
    pressure_max, pressure_l2
        Of the curves of the peak pressure: largest, over the largest peak; and root mean square
        over time, over that of the curve.
    film_max, film_l2
        Of the curves of the minimum film thickness: largest relative one; and root mean square,
        over that of the curve.
    gap
        Largest difference of the gap anywhere in the bearing [m].
    """

    pressure_max: float
    pressure_l2: float
    film_max: float
    film_l2: float
    gap: float

    def relative(self) -> dict[str, float]:
        """All but the last, by name."""
        return {name: value for name, value in asdict(self).items() if name != "gap"}


@dataclass(frozen=True, eq=False)
class Differences:
    """Differences of two runs in one joint, at the steps of one of them.

    Attributes
    ----------
    pressure
        Of the curves of the peak pressure, over the largest peak, shape (n,).
    film
        Of the curves of the minimum film thickness, relative, shape (n,).
    errors
        What they amount to.
    """

    pressure: np.ndarray
    film: np.ndarray
    errors: Errors


class StoredRun:
    """Curves and coordinates of a run on disk.

    Parameters
    ----------
    directory, scene
        Folder of its results, and what was run.
    start
        Time from which on errors count [s].

    Raises
    ------
    InputError
        A file is missing or damaged, or there is hardly a step after the start.
    """

    #: Whether pressures at all nodes are needed.
    _films = False

    def __init__(self, directory: Path, scene: Scene, start: float):
        self.directory, self.scene = directory, scene
        self.result = load_results(directory, films=self._films)
        self.times = np.asarray(self.result.time)
        self.joints = lubricated_joints(scene)
        self.counted = self.times >= start
        if np.count_nonzero(self.counted) < 2:
            raise InputError(f"{directory}: fewer than two steps after {start:g} s")

    def estimates(self) -> dict[str, float]:
        """Largest error of the gap that the run itself estimates, while errors count [m]."""
        joints = self.result.joints
        return {
            joint: float(joints[joint].basis_error_estimate[self.counted].max(initial=0.0))
            for joint in self.joints
            if "basis_error_estimate" in joints[joint]
        }

    @property
    def states(self) -> np.ndarray:
        """Coordinates and residual amplitudes at every step, shape (steps, n)."""
        return np.hstack([self.result.coordinates, self.result.quasi_static])

    def gaps(self, films: Scene, states: np.ndarray) -> dict[str, np.ndarray]:
        """Gap by joint [m], shape (len(states), points), where films of another scene are."""
        joints = {
            name: attrs.evolve(
                joint, cells=films.joints[name].cells, element=films.joints[name].element
            )
            for name, joint in self.scene.joints_of(schema.LubricatedSettings)
        }
        scene = replace(self.scene, joints={**self.scene.joints, **joints})
        bodies = {
            name: load_body(self.directory / BODY_FILE.format(name))
            for name, body in scene.bodies.items()
            if isinstance(body, schema.FlexibleSettings)
        }
        system = System(build_mechanism(scene, MPI.COMM_SELF, bodies=bodies).mechanism)
        norm = StepNorm(StepEquations(system, dense_limit=0))
        found = [norm.film_gaps(norm.observe(state)) for state in states]
        names = [place.name for place in system.films]
        return {name: np.array([gaps[i] for gaps in found]) for i, name in enumerate(names)}


class Reference(StoredRun):
    """A run that others are compared with."""

    _films = True

    @cached_property
    def _coordinates(self) -> Sequence[CubicHermiteSpline | PchipInterpolator]:
        result = self.result
        found: list[CubicHermiteSpline | PchipInterpolator] = [
            CubicHermiteSpline(self.times, result.coordinates, result.rates)
        ]
        if result.quasi_static.size:
            found.append(PchipInterpolator(self.times, result.quasi_static))
        return found

    @cached_property
    def _nodal(self) -> Mapping[str, PchipInterpolator]:
        """Of nodal pressures."""
        joints = self.result.joints
        return {name: PchipInterpolator(self.times, joints[name].film.pressure) for name in joints}

    def differences(self, run: StoredRun) -> tuple[np.ndarray, dict[str, Differences]]:
        """Of a run at its own steps while errors count: the steps, and what is found by joint."""
        known = (run.times >= self.times[0]) & (run.times <= self.times[-1])
        inside = known & run.counted
        times = run.times[inside]
        exact = self.gaps(self.scene, np.hstack([found(times) for found in self._coordinates]))
        ours = run.gaps(self.scene, run.states[inside])
        found = {}
        for joint in self.joints:
            own = run.result.joints[joint]
            pressure, film = own.max_pressure[inside], own.min_film_thickness[inside]
            exact_pressure = self._nodal[joint](times).max(axis=1)
            exact_film = exact[joint].min(axis=1)
            peak = self.result.joints[joint].max_pressure[self.counted].max()
            off_pressure, off_film = (pressure - exact_pressure) / peak, film / exact_film - 1
            errors = Errors(
                float(np.abs(off_pressure).max()),
                _mean(times, pressure - exact_pressure) / _mean(times, exact_pressure),
                float(np.abs(off_film).max()),
                _mean(times, film - exact_film) / _mean(times, exact_film),
                float(np.abs(ours[joint] - exact[joint]).max()),
            )
            found[joint] = Differences(off_pressure, off_film, errors)
        return times, found


def _mean(times: np.ndarray, values: np.ndarray) -> float:
    """Root mean square over time."""
    return float(np.sqrt(trapezoid(values**2, times) / (times[-1] - times[0])))
