"""Shipped scenes with other values, their parts reduced once, and runs with their curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from time import process_time
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.interpolate import PchipInterpolator

from fenics_ehd.base.errors import EhdError
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.tracking import Tracker
from fenics_ehd.reduction import ReducedBody, Reductor
from fenics_ehd.scenes import given, schema
from fenics_ehd.scenes.build import Built, build_mechanism
from fenics_ehd.scenes.elastic_part import elastic_part
from fenics_ehd.scenes.part import METHOD_KEYS, reduce_structure
from fenics_ehd.scenes.scene import Scene
from fenics_ehd.scenes.scene_file import read_scene

#: Keys of the slider-crank's scenes.
METHOD = "bodies.rod.reduction.method"
TOLERANCE = "time.tolerance"
REVOLUTIONS = "time.revolutions"
CELLS = "joints.big_end.cells"

#: Steps of a run for which it is given up as one that does not advance.
MOST_STEPS = 40_000

#: Makes a body of a part.
Reduce = Callable[[Reductor], ReducedBody]


def changed(scene: Scene | str, values: Mapping[str, Any]) -> Scene:
    """A scene, or a shipped one, with other values by dotted keys."""
    if isinstance(scene, str):
        scene = read_scene(scene)
    return given.changed(scene, values)


class Parts:
    """Flexible bodies of scenes, meshed once for each geometry and reduced once for each method."""

    def __init__(self) -> None:
        self._reductors: dict[str, Reductor] = {}
        self._bodies: dict[tuple, ReducedBody] = {}

    def reductor(self, part: schema.FlexibleSettings, element: str = "lagrange") -> Reductor:
        """Of a part, for films of an element."""
        mesh = part.model, part.geometry, part.cells, part.element
        key = repr((*mesh, part.material, part.bores, part.points, part.held_by, element))
        if key not in self._reductors:
            source = elastic_part(part, "part", element, MPI.COMM_SELF).source
            assert not isinstance(source, ReducedBody)
            self._reductors[key] = Reductor(source)
        return self._reductors[key]

    def body(
        self, part: schema.FlexibleSettings, element: str, reduce: Reduce | None
    ) -> ReducedBody:
        """Reduced as its settings say, or by `reduce`."""
        reductor, settings = self.reductor(part, element), part.reduction
        keys = (*METHOD_KEYS[settings.method], "method", "estimate_error")
        key = id(reductor), reduce, *(getattr(settings, name) for name in keys)
        if key not in self._bodies:
            body = reduce(reductor) if reduce else reduce_structure(reductor, settings)
            self._bodies[key] = replace(body, columns=None)
        return self._bodies[key]

    def build(self, scene: Scene, reduce: Reduce | None = None) -> Built:
        """The mechanism of a scene, its flexible bodies by `reduce` if that is given."""
        elements = {
            joint.bore.partition(".")[0]: joint.element
            for _, joint in scene.joints_of(schema.LubricatedSettings)
        }
        bodies = {
            name: self.body(part, elements.get(name, "lagrange"), reduce)
            for name, part in scene.bodies.items()
            if isinstance(part, schema.FlexibleSettings)
        }
        return build_mechanism(scene, MPI.COMM_SELF, bodies=bodies)


@dataclass
class Curves:
    """A run of a scene with one lubricated joint.

    Attributes
    ----------
    columns
        Of its history, by name.
    fields
        Pressures [Pa] and gaps [m] at all points of the film, shape (steps, points), if wanted.
    figures
        Of its summary.
    error
        What ended it early, or None.
    seconds
        Processor time of the steps and of their powers.
    """

    columns: Mapping[str, np.ndarray] = field(default_factory=dict)
    fields: tuple[np.ndarray, np.ndarray] | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)
    error: EhdError | None = None
    seconds: float = 0.0

    @property
    def times(self) -> np.ndarray:
        """Of every step [s]."""
        return self.columns.get("time_s", np.empty(0))

    @property
    def pressure(self) -> np.ndarray:
        """Peak pressure of every step [Pa]."""
        return self.columns.get("max_pressure_Pa", np.empty(0))

    @property
    def film(self) -> np.ndarray:
        """Thinnest film of every step [m]."""
        return self.columns.get("min_film_thickness_m", np.empty(0))

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Peak pressure and thinnest film at other times, from the fields where they were kept.

        Where an extreme moves from one point to the next its curve has a kink that no
        interpolation meets: points are interpolated first then.
        """
        if self.fields is None:
            return tuple(
                PchipInterpolator(self.times, y)(times) for y in (self.pressure, self.film)
            )
        pressures, gaps = (PchipInterpolator(self.times, values)(times) for values in self.fields)
        return pressures.max(axis=1), gaps.min(axis=1)


class GivenUpError(EhdError):
    """A run takes more steps than any of these should."""


def follow(run: Run, span: float, *, fields: bool = False, start: float = 0.0) -> Curves:
    """All steps of a run up to a time [s]; an error of ours that ends it is part of the result.

    With `fields`, those of all steps from a start [s] on are kept.
    """
    tracker, found = Tracker(run.equations, run.norm), Curves()
    rows: list[dict[str, float]] = []
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    began = process_time()
    try:
        for step in run.until(span):
            rows.append(tracker.add(step)[0])
            if fields and step.time >= start:
                kept.append((step.solution.films[0].pressure, run.norm.gaps(step.observed)))
            if len(rows) >= MOST_STEPS:
                raise GivenUpError(f"{MOST_STEPS} steps led to {step.time:.3g} s only")
    except EhdError as error:
        found.error = error
    found.seconds = process_time() - began
    if rows:
        found.columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    if kept:
        found.columns = {name: values[-len(kept) :] for name, values in found.columns.items()}
        found.fields = np.stack([p for p, _ in kept]), np.stack([g for _, g in kept])
    found.figures = tracker.figures()
    return found


def difference(run: Curves, reference: Curves, start: float) -> tuple[float, float]:
    """Of peak pressure over its peak and of film thickness, pointwise, at the run's own steps.

    From a start [s] on: before, both films build up from no pressure at all.
    """
    end = min(run.times[-1], reference.times[-1])
    own = (run.times >= start) & (run.times <= end)
    pressure, film = reference.at(run.times[own])
    peak = reference.pressure[reference.times >= start].max()
    return (
        float(np.abs(run.pressure[own] - pressure).max() / peak),
        float(np.abs(run.film[own] / film - 1).max()),
    )
