"""Run cases over a pool: bodies first, each of them once, then the cases."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

from mpi4py import MPI
from tqdm import tqdm

from fenics_ehd.base.folder import clear, let_go
from fenics_ehd.base.whole_file import new_part
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.reduction import load_body
from fenics_ehd.results.run_folder import BODY_FILE, RunFolder
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.run import run_scene
from fenics_ehd.scenes.scene import flexible
from fenics_ehd.study.case import Case
from fenics_ehd.study.outcome import Outcome, failed, patiently, recorded
from fenics_ehd.study.parts import SECONDS, body_path, part_figures, reduce_missing
from fenics_ehd.study.pool import ProcessPool, outcomes


@dataclass(frozen=True, eq=False)
class CaseTask:
    """A case to run, the folders of the bodies and for its results, and whether these stay."""

    case: Case
    bodies: Path
    directory: Path
    keep: bool = True


def run_cases(
    tasks: Sequence[CaseTask],
    bodies: Path,
    pool: ProcessPool,
    ended: Callable[[Case, Outcome], None],
    check: Callable[[], None] = lambda: None,
) -> None:
    """Run cases as ``fenics-ehd run`` does, those whose body fails first.

    Parameters
    ----------
    tasks
        In the order in which they begin.
    bodies
        Folder of the bodies that all of them need.
    pool
        Workers.
    ended
        Told of every case.
    check
        Called a few times a second; may raise `KeyboardInterrupt`.
    """
    failures = reduce_missing((task.case for task in tasks), bodies, pool, check)
    ready = []
    for task in tasks:
        lost = [failures[b.name] for b in task.case.bodies.values() if b.name in failures]
        if lost:
            ended(task.case, lost[0])
        else:
            ready.append(task)
    for task, answer in outcomes(pool, run_case, ready, check):
        ended(task.case, recorded(answer))


def run_case(task: CaseTask) -> Outcome:
    """Run a case anew into its folder; what ends it early is its status.

    Its figures are those of its summary, of its bodies, and the cells of its films by joint.
    """
    try:
        summary = patiently(lambda: _run(task))
    except Exception as error:
        return failed(error)
    finally:
        if not task.keep:
            clear(task.directory)
            let_go(task.directory)
    return Outcome(str(summary["status"]), summary)


def _run(task: CaseTask) -> dict[str, Any]:
    clear(task.directory)
    scene = task.case.scene
    files = {name: body_path(task.bodies, body) for name, body in task.case.bodies.items()}
    bodies = {name: load_body(path) for name, path in files.items()}
    built = build_mechanism(scene, MPI.COMM_SELF, bodies=bodies)
    seconds = sum(float(body.provenance[SECONDS]) for body in bodies.values())
    bar = tqdm(total=1e3 * scene.span, disable=True)
    with RunFolder(task.directory, flexible(scene)) as folder:
        try:
            own = replace(built, seconds=seconds)
            # A study compares its runs with one another.
            summary = run_scene(scene, own, folder.path, bar, interval=inf, judged=False)
        finally:
            for name, path in files.items():
                _share(path, folder.path / BODY_FILE.format(name))
    return summary | part_figures(bodies.values()) | {"film_cells": _film_cells(built.mechanism)}


def _film_cells(mechanism: Mechanism) -> dict[str, str]:
    """Cells around and along of the film in every lubricated joint, ``"20x5"``."""
    films = {n: j.film for n, j in mechanism.joints.items() if isinstance(j, LubricatedJoint)}
    grids = {name: film.parameters.grid for name, film in films.items()}
    return {n: f"{len(grid.angles) - 1}x{len(grid.heights) - 1}" for n, grid in grids.items()}


def _share(file: Path, copy: Path) -> None:
    """Have a copy share the file's place on the disk: many runs have a body in common."""
    with suppress(OSError):  # a file system without links: the copy stays
        link = new_part(copy)
        link.unlink()
        os.link(file, link)
        link.replace(copy)
