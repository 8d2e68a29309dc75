"""Runs of the slider-crank that are asked for again and again."""

from __future__ import annotations

import tempfile
from pathlib import Path

from nested_film import NestedRun
from scene_runs import Curves, Parts, Reduce, difference, follow

from fenics_ehd.multibody.run import Run
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.build import Built
from fenics_ehd.scenes.scene import Scene

#: The first film build-up, from no pressure at all, is left out of comparisons: this share of the
#: simulated time, and no more crank angle than this [rad].
START_SHARE, START_ANGLE = 0.1, 0.1


def crank_speed(scene: Scene) -> float:
    """At the start [rad/s]."""
    return scene.speed_of("crank")


def begin(scene: Scene, end: float) -> float:
    """Time from which curves up to an end are compared [s]."""
    return min(START_SHARE * end, START_ANGLE / crank_speed(scene))


def apart(run: Curves, reference: Curves, scene: Scene) -> tuple[float, float]:
    """Difference of pressure and film, see `difference`."""
    return difference(run, reference, begin(scene, run.times[-1]))


class Workshop:
    """Runs scenes, and keeps parts and runs.

    Attributes
    ----------
    folder
        For tables; gone with the workshop.
    """

    def __init__(self) -> None:
        self._temporary = tempfile.TemporaryDirectory()
        self.folder = Path(self._temporary.name)
        self._parts = Parts()
        self._runs: dict[tuple[str, Reduce | None, type], Curves] = {}

    def build(self, scene: Scene, reduce: Reduce | None = None) -> Built:
        """The mechanism of a scene, its rod by `reduce` if that is given."""
        return self._parts.build(scene, reduce)

    def rod(self, scene: Scene) -> ReducedBody:
        """Reduced rod of a scene."""
        return self.build(scene).parts["rod"]

    def run(self, scene: Scene, reduce: Reduce | None = None, kind: type[Run] = Run) -> Curves:
        """Run a scene."""
        key = repr(scene.tables), reduce, kind
        if key not in self._runs:
            built = self.build(scene, reduce)
            run = kind(built.mechanism, built.steps, scene.span)
            self._runs[key] = follow(run, scene.span)
        return self._runs[key]

    def nested(self, scene: Scene) -> Curves:
        """The same scene with the film solved within every evaluation, by Newton's method."""
        return self.run(scene, kind=NestedRun)
