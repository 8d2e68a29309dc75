"""Bodies that cases need: every part is meshed, assembled and factorised once for all of its own.

What a body took is in its provenance: of a part's first body mesh and matrices are included, a
later one adds little where it finds factors, modes and responses of those before it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from mpi4py import MPI

from fenics_ehd.base.errors import BodyFileError
from fenics_ehd.reduction import ReducedBody, Reductor, Structure, load_body, save_body
from fenics_ehd.scenes.elastic_part import ElasticPart, elastic_part
from fenics_ehd.scenes.part import ReducedPart
from fenics_ehd.study.case import Case, NeededBody
from fenics_ehd.study.outcome import Outcome, failed, patiently, recorded
from fenics_ehd.study.pool import ProcessPool, outcomes

#: Entries of a body's provenance: what it took, by the clock and of the processor.
SECONDS, PROCESSOR_SECONDS = "reduction_time_s", "reduction_processor_time_s"


@dataclass(frozen=True)
class PartTask:
    """Bodies of one part to reduce, and the folder for their files."""

    bodies: tuple[NeededBody, ...]
    directory: Path


def body_path(directory: Path, body: NeededBody) -> Path:
    """File of a reduced body in the folder of all of them."""
    return directory / f"{body.name}.h5"


def reduce_missing(
    cases: Iterable[Case], directory: Path, pool: ProcessPool, check: Callable[[], None]
) -> Mapping[str, Outcome]:
    """Reduce what cases need and is not there, or cannot be read; those that failed, by name."""
    needed = {body.name: body for case in cases for body in case.bodies.values()}
    parts: dict[str, list[NeededBody]] = {}
    for body in needed.values():
        if not _there(body_path(directory, body)):
            parts.setdefault(body.part, []).append(body)
    tasks = [PartTask(tuple(in_turn(bodies)), directory) for bodies in parts.values()]
    failures: dict[str, Outcome] = {}
    for task, answer in outcomes(pool, reduce_part_bodies, tasks, check):
        if isinstance(answer, Mapping):
            failures |= answer
        else:
            lost = (b for b in task.bodies if not _there(body_path(directory, b)))
            failures |= {body.name: recorded(answer) for body in lost}
    return failures


def in_turn(bodies: Iterable[NeededBody]) -> Sequence[NeededBody]:
    """Reductions that share most beside each other, the largest first: see `Reductor`."""

    def order(body: NeededBody) -> Any:
        r = body.settings.reduction
        return r.method, r.pressure_set, -r.vibration_modes, -r.modes, -r.residual_modes

    return sorted(bodies, key=order)


def _there(path: Path) -> bool:
    try:
        load_body(path)
    except BodyFileError:
        return False
    return True


def reduce_part_bodies(task: PartTask) -> dict[str, Outcome]:
    """Reduce bodies of one part on this process alone and save them; those that failed."""
    clocks = perf_counter(), process_time()
    first = task.bodies[0]
    try:
        part, reductor = patiently(lambda: _assembled(first))
    except Exception as error:
        return {body.name: failed(error) for body in task.bodies}
    failures = {}
    task.directory.mkdir(parents=True, exist_ok=True)
    for body in task.bodies:
        try:
            made = _reduced(replace(part, settings=body.settings), reductor)
            seconds = perf_counter() - clocks[0], process_time() - clocks[1]
            taken = dict(zip((SECONDS, PROCESSOR_SECONDS), map(repr, seconds), strict=True))
            kept = replace(made, provenance={**made.provenance, **taken})
            save_body(kept, body_path(task.directory, body))
        except Exception as error:
            failures[body.name] = failed(error)
        clocks = perf_counter(), process_time()
    return failures


def _assembled(body: NeededBody) -> tuple[ElasticPart, Reductor]:
    part = elastic_part(body.settings, body.key, body.film_element, MPI.COMM_SELF)
    assert isinstance(part.source, Structure)
    return part, Reductor(part.source, solver=body.settings.reduction.solver)


def _reduced(part: ElasticPart, reductor: Reductor) -> ReducedBody:
    made = part.reduce(reductor=reductor)
    assert isinstance(made, ReducedPart)
    return made.body


def part_figures(bodies: Collection[ReducedBody]) -> dict[str, float]:
    """Figures of the bodies of a run, all together.

    Returns
    -------
    dict
        ``coordinates``, ``highest_frequency_Hz``, ``offline_s`` (processor time that they added),
        ``pressure_columns`` and ``dropped_columns`` of what depends on the others.
    """
    return {
        "coordinates": sum(body.modes for body in bodies),
        "highest_frequency_Hz": max(
            (float(body.frequencies.max(initial=0.0)) for body in bodies), default=0.0
        ),
        "offline_s": sum(float(body.provenance[PROCESSOR_SECONDS]) for body in bodies),
        "pressure_columns": sum(
            len(bore.pressure_coordinates) for body in bodies for bore in body.bores.values()
        ),
        "dropped_columns": sum(int(body.accuracy.get("static_dropped", 0)) for body in bodies),
    }
