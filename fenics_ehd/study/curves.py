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
from fenics_ehd.results.history_file import read_fields, read_history
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.run import BODY_FILE
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

    def __init__(self, directory: Path, scene: Scene, start: float):
        self.directory, self.scene = directory, scene
        self.history = read_history(directory)
        self.times = self.history["cycle_time_s" if scene.time.periodic else "time_s"]
        self.joints = lubricated_joints(scene)
        self.fields = read_fields(directory, ("coordinates", "rates"))
        self.fields |= read_fields(directory, ("quasi_static",), optional=True)
        if {len(values) for values in self.fields.values()} != {len(self.times)}:
            raise InputError(f"{directory}: its history has not the same steps in both files")
        self.counted = self.times >= start
        if np.count_nonzero(self.counted) < 2:
            raise InputError(f"{directory}: fewer than two steps after {start:g} s")

    def named(self, joint: str, column: str) -> str:
        """Name of a joint's column or field."""
        return f"{joint}.{column}" if len(self.joints) > 1 else column

    def column(self, joint: str, column: str) -> np.ndarray:
        """Of a joint's history, shape (steps,)."""
        return self.history[self.named(joint, column)]

    def estimates(self) -> dict[str, float]:
        """Largest error of the gap that the run itself estimates, while errors count [m]."""
        names = {joint: self.named(joint, "basis_error_estimate_m") for joint in self.joints}
        return {
            joint: float(self.history[name][self.counted].max(initial=0.0))
            for joint, name in names.items()
            if name in self.history
        }

    @property
    def states(self) -> np.ndarray:
        """Coordinates and residual amplitudes at every step, shape (steps, n)."""
        names = [name for name in ("coordinates", "quasi_static") if name in self.fields]
        return np.hstack([self.fields[name] for name in names])

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

    def __init__(self, directory: Path, scene: Scene, start: float):
        super().__init__(directory, scene, start)
        names = tuple(self.named(joint, "pressure_Pa") for joint in self.joints)
        self._pressures = dict(
            zip(self.joints, read_fields(directory, names).values(), strict=True)
        )

    @cached_property
    def _coordinates(self) -> Sequence[CubicHermiteSpline | PchipInterpolator]:
        found: list[CubicHermiteSpline | PchipInterpolator] = [
            CubicHermiteSpline(self.times, self.fields["coordinates"], self.fields["rates"])
        ]
        if "quasi_static" in self.fields:
            found.append(PchipInterpolator(self.times, self.fields["quasi_static"]))
        return found

    @cached_property
    def _nodal(self) -> Mapping[str, PchipInterpolator]:
        """Of nodal pressures."""
        return {name: PchipInterpolator(self.times, p) for name, p in self._pressures.items()}

    def differences(self, run: StoredRun) -> tuple[np.ndarray, dict[str, Differences]]:
        """Of a run at its own steps while errors count: the steps, and what is found by joint."""
        known = (run.times >= self.times[0]) & (run.times <= self.times[-1])
        inside = known & run.counted
        times = run.times[inside]
        exact = self.gaps(self.scene, np.hstack([found(times) for found in self._coordinates]))
        ours = run.gaps(self.scene, run.states[inside])
        found = {}
        for joint in self.joints:
            pressure, film = (
                run.column(joint, name)[inside]
                for name in ("max_pressure_Pa", "min_film_thickness_m")
            )
            exact_pressure = self._nodal[joint](times).max(axis=1)
            exact_film = exact[joint].min(axis=1)
            peak = self.column(joint, "max_pressure_Pa")[self.counted].max()
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
