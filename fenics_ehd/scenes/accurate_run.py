"""Runs of a scene, one after another, until one meets the accuracy that is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI
from tqdm import tqdm

from fenics_ehd.base.output import SUMMARY
from fenics_ehd.multibody.orbit import Orbit
from fenics_ehd.results.checkpoint import CHECKPOINT
from fenics_ehd.results.recorded_run import CHECKPOINT_EVERY
from fenics_ehd.scenes.accuracy import Search
from fenics_ehd.scenes.build import Built, build_mechanism
from fenics_ehd.scenes.run import run_scene
from fenics_ehd.scenes.scene import Scene


def run_accurately(
    scene: Scene,
    built: Built,
    directory: Path,
    bar: Callable[[Scene], tqdm],
    search: Search | None,
    *,
    interval: float = CHECKPOINT_EVERY,
    former: Mapping[str, Any] | None = None,
    multiplier: bool = False,
    told: Callable[[Search], None] = lambda search: None,
) -> tuple[Scene, Built, dict[str, Any]]:
    """Run a scene as `run_scene` does, and then others while its search wants them; serial.

    Parameters
    ----------
    scene, built
        Of the first run, see `fenics_ehd.scenes.accuracy.begun`.
    directory, interval, former, multiplier
        See `run_scene`; the folder has the last run.
    bar
        Shows the progress of a run.
    search
        None: there is one run.
    told
        Of a search that goes on.

    Returns
    -------
    scene, built, summary
        Of the last run.
    """
    orbits: list[Orbit] = []
    while True:
        summary = run_scene(
            scene,
            built,
            directory,
            bar(scene),
            interval=interval,
            former=former,
            multiplier=multiplier,
            search=search,
            orbits=orbits,
        )
        if search is None:
            return scene, built, summary
        if not search.wanted:
            search.leave(directory)
            return scene, built, summary
        told(search)
        # Whoever finds the folder so, finds no result that is not that of its scene.
        for name in (SUMMARY, CHECKPOINT):
            (directory / name).unlink(missing_ok=True)
        former, last = None, scene
        scene = search.go_on(scene)
        bodies = {
            name: body
            for name, body in built.parts.items()
            if scene.bodies[name] == last.bodies[name]
        }
        built = build_mechanism(scene, MPI.COMM_SELF, bodies=bodies)
