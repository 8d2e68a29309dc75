"""The kinds of scene that can be swept, one line each in `SCENES`.

A scene's own modules are imported by the process that runs it: the one that only hands
out cases needs no finite elements.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.commands.scenes import read_scene, scene_tables
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.part import ReducedPart

if TYPE_CHECKING:
    from fenics_ehd.scenes.transient import Totals

#: Takes the history row and the fields of every accepted step.
Recorder = Callable[[dict[str, Any], dict[str, np.ndarray]], None]


@dataclass(frozen=True)
class Run:
    """One case, ready to start."""

    simulate: Callable[[Recorder | None], object]
    verdict: Callable[[], str]
    summarise: Callable[[str], dict[str, object]]
    constants: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Part:
    """An elastic part: what its reduced body depends on, and its reduction."""

    origin: Callable[[Any], dict[str, str]]
    reduce: Callable[[Any, MPI.Comm], ReducedPart]


@dataclass(frozen=True)
class Scene:
    """How one kind of scene is read, reduced (None: it is rigid) and run."""

    read: Callable[[str, Mapping[str, Any]], Any]
    part: Part | None
    prepare: Callable[[Any, ReducedBody | None, float], Run]


def _rod_origin(settings: Any) -> dict[str, str]:
    from fenics_ehd.scenes.rod import origin

    return origin(settings)


def _reduce_rod(settings: Any, comm: MPI.Comm) -> ReducedPart:
    from fenics_ehd.scenes.rod import reduce_rod

    return reduce_rod(settings, comm)


def _slider_crank(settings: Any, body: ReducedBody | None, seconds: float) -> Run:
    from fenics_ehd.results import summarise
    from fenics_ehd.scenes.run import simulate

    return _machine(simulate, summarise, settings, body, seconds)


def _machine(
    simulate: Callable[..., Totals],
    summarise: Callable[..., dict[str, object]],
    settings: Any,
    body: ReducedBody | None,
    seconds: float,
) -> Run:
    """Run of a machine with an elastic part."""
    from fenics_ehd.results import bore_constants
    from fenics_ehd.scenes.transient import Totals, verdict

    assert body is not None
    totals = Totals()
    return Run(
        lambda record: simulate(settings, body, totals, record),
        lambda: verdict(totals),
        lambda status: summarise(settings, body, totals, status, seconds),
        bore_constants(body),
    )


def _read_rotor(scene: str, tables: Mapping[str, Any]) -> Any:
    from fenics_ehd.commands.rotor import read_settings

    return read_settings(scene, tables)


def _housing_origin(settings: Any) -> dict[str, str]:
    from fenics_ehd.scenes.housing import origin

    return origin(settings)


def _reduce_housing(settings: Any, comm: MPI.Comm) -> ReducedPart:
    from fenics_ehd.scenes.housing import reduce_housing

    return reduce_housing(settings, comm)


def _rotor(settings: Any, body: ReducedBody | None, seconds: float) -> Run:
    from fenics_ehd.commands.rotor import summarise
    from fenics_ehd.scenes.rotor_run import simulate

    return _machine(simulate, summarise, settings, body, seconds)


def _read_loaded_journal(scene: str, tables: Mapping[str, Any]) -> Any:
    from fenics_ehd.commands.loaded_journal import read_settings

    return read_settings(scene, tables)


def _loaded_journal(settings: Any, _body: ReducedBody | None, _seconds: float) -> Run:
    from fenics_ehd.commands.loaded_journal import summarise
    from fenics_ehd.scenes.loaded_journal import build_journal, build_load
    from fenics_ehd.scenes.loaded_journal_run import OrbitTotals, simulate, verdict

    load = build_load(settings)
    journal = build_journal(settings, load)
    totals = OrbitTotals()
    return Run(
        lambda record: simulate(settings, totals, record, None, journal, load),
        lambda: verdict(settings, totals),
        lambda status: summarise(settings, totals, status),
        {"pressure_nodes_m": journal.film.parameters.grid.nodes},
    )


SCENES = {
    "slider-crank": Scene(
        lambda scene, _: read_scene(scene)[0], Part(_rod_origin, _reduce_rod), _slider_crank
    ),
    "rotor": Scene(_read_rotor, Part(_housing_origin, _reduce_housing), _rotor),
    "loaded-journal": Scene(_read_loaded_journal, None, _loaded_journal),
}


def read_settings(scene: str) -> Any:
    """Settings of a scene given by name or TOML file; their `scene` is a key of `SCENES`.

    Raises
    ------
    SettingsError
        The file cannot be read, does not say its kind, or holds a key or a value that cannot be
        used.
    """
    kind, tables = scene_tables(scene)
    return SCENES[kind].read(scene, tables)
