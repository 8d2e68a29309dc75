"""Required accuracy of a run: settings are refined, run by run, until the error budget meets it.

The first run is a pilot on coarse films, with a tolerance that usually gives errors of the required
size. If its error budget (`fenics_ehd.analysis.error_budget`) exceeds the accuracy, the settings of
the largest error components are refined by their orders of convergence. The errors are of order

    step size   tolerance^(k / (k + 1)) for steps of order k,
    film mesh   cells^-3 in each direction, cells^-2 with 4-node cells: a compromise between the
                orders of the nodal pressures and of their interpolation between the nodes,
    basis       1 / modes,
    part mesh   cells^-2,
    start       periodicity, the limit of the change of a film over a cycle.

The components are reduced to a common level, at which their sum leaves a margin to the accuracy.
The next run is judged in the same way.

These settings are chosen unless ``output.accuracy_keeps`` names them: the tolerances of steps and
of the periodicity, the cells of every film, the reduction of meshed parts that are not rigid, and,
with ``output.part_mesh_error``, the cells of their meshes.

Imports inside functions: parts import all reductions.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from math import ceil, inf, log10, prod, sqrt
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from fenics_ehd.base.errors import AccuracyError, InputError, SettingsError
from fenics_ehd.base.files import ACCURACY, read_json, to_json, write_whole
from fenics_ehd.base.sealed_file import named
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.periodic import CYCLE_NOISE
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.trust import COMPONENTS, KEYS, NOT_APPLICABLE, QUANTITIES
from fenics_ehd.reduction.mesh_error import ORDER as PART_ORDER
from fenics_ehd.scenes.films import planned_cells
from fenics_ehd.scenes.scene import Scene, changed, meshed, stored

#: Limits of the search: least tolerance of a step, least periodicity, largest numbers of film
#: cells, of vibration modes in a basis, and of cells around a bore in a part's mesh.
TIGHTEST = 1e-8
TIGHTEST_PERIODICITY = 1e-7
MOST_CELLS = 6400
MOST_MODES = 48
MOST_CELLS_AROUND = 60

#: Sum of all components that a refinement aims at, over the accuracy.
AIM = 0.7

#: Factor to which step and film errors are reduced after a run that cannot be trusted.
HALF = 0.5

#: Components are not reduced below this fraction of the components that cannot be reduced.
LITTLE = 0.2

#: Relative round-off up to which a number of cells is not rounded up.
ROUNDING = 1e-6


def rounded(value: float) -> float:
    """Round a number down to two significant digits."""
    digits = 10.0 ** (int(np.floor(log10(value))) - 1)
    return float(f"{np.floor(value / digits * (1 + ROUNDING)) * digits:.1e}")


#: Numbers of cells around a pilot's films for an accuracy of 1 %, and orders of film errors, by
#: element. Errors of films with 24 cells are 0.3 to 1.5 %, of those with 48 bilinear cells 1.2 %.
PILOT_AROUND = {"lagrange": 24, "serendipity": 24, "bilinear": 48}
FILM_ORDER = {"lagrange": 3.0, "serendipity": 3.0, "bilinear": 2.0}

#: Least and largest number of cells around a pilot's film.
FEWEST_AROUND = 16
MOST_AROUND = 48

#: Step error at a tolerance of 1e-3 and order 2 or 3; it is 0.4 to 1.5 % in shipped scenes.
STEP_ERROR = 0.006

#: Step error that a pilot aims at, over the accuracy; and limits of its tolerance.
PILOT_SHARE = 0.6
PILOT_TIGHTEST = 3e-4
PILOT_LOOSEST = 3e-3

#: Least accuracy: estimates of smaller errors were never compared with true errors
#: (`docs/error-budget.md`), and 1e-9 would take 37 hours.
LEAST = 1e-4

#: Periodicity over the accuracy; it is at least `CYCLE_NOISE` times the tolerance of a step.
PERIODICITY = 0.1


@dataclass
class Search:
    """Search for the settings with which a run meets a required accuracy.

    Attributes
    ----------
    asked
        Required relative accuracy.
    kept
        Full keys of the settings that the search must not change.
    chosen
        Values that the search chose for the settings of the current run, by full key.
    runs
        Entries of every run, the pilot run first: ``chosen``; ``estimate``, the largest total
        error; ``errors``, the largest error by component; ``status``; ``processor_time_s``.
    wanted
        Values that the search chose for the settings of the next run, by full key; empty if there
        is no next run.
    """

    asked: float
    kept: tuple[str, ...]
    chosen: dict[str, Any]
    runs: list[dict[str, Any]] = field(default_factory=list)
    wanted: dict[str, Any] = field(default_factory=dict)

    @property
    def met(self) -> bool:
        """True if the last run meets the required accuracy and its status is complete."""
        last = self.runs[-1]
        return bool(last["estimate"] <= self.asked and last["status"] == "complete")

    def continue_search(self, scene: Scene) -> Scene:
        """Begin the next run: return the scene with the values that the search chose for it."""
        values = self.wanted
        self.chosen = {**self.chosen, **values}
        self.wanted = {}
        return stored(changed(scene, values))

    def store(self, directory: Path) -> None:
        """Write the search into the folder of its current run."""
        contents = {
            "asked": self.asked,
            "kept": self.kept,
            "chosen": self.chosen,
            "runs": self.runs,
            "wanted": self.wanted,
        }
        write_whole(directory / ACCURACY, to_json(contents) + "\n")

    def figures(self) -> dict[str, Any]:
        """Entries of ``summary.json`` about the search: requirement, estimates, chosen values."""
        seconds = [run["processor_time_s"] for run in self.runs]
        return {
            "asked": self.asked,
            "met": self.met,
            "estimate": self.runs[-1]["estimate"],
            "chosen": self.chosen,
            "kept": list(self.kept),
            "pilot_estimate": self.runs[0]["estimate"],
            "pilot_processor_time_s": sum(seconds[:-1]),
            "runs": self.runs,
        }


def start_search(scene: Scene) -> tuple[Scene, Search | None]:
    """Scene of the pilot run, and the search for the accuracy that the scene requires.

    Without a required accuracy, the result is the given scene and None.

    Raises
    ------
    SettingsError
        The scene has no film or no error budget, the accuracy is too small, or
        `accuracy_keeps` names a setting that no search chooses.
    """
    output = scene.output
    asked = output.accuracy
    if not asked:
        return scene, None
    if not scene.films:
        raise SettingsError(
            f"output.accuracy = {asked:g} needs a film: scene {scene.name} has none"
        )
    if not output.error_budget:
        raise SettingsError(f"output.accuracy = {asked:g} needs output.error_budget = true")
    if asked < LEAST:
        raise SettingsError(
            f"output.accuracy = {asked:g} is below {LEAST:g}, where error estimates are not "
            f"validated: use at least {LEAST:g}, or choose meshes and steps yourself"
        )
    if output.part_mesh_error:
        from fenics_ehd.scenes.part import with_counts  # imports all reductions

        scene = changed(
            scene,
            {
                f"bodies.{name}.geometry": with_counts(
                    scene.bodies[name], f"bodies.{name}"
                ).geometry
                for name in meshed(scene)
                if scene.bodies[name].reduction.method != "rigid"
            },
        )
    kept = _kept(scene)
    chosen = {key: value for key, value in _pilot(scene, asked, kept).items() if key not in kept}
    none = {"output.accuracy": 0.0, "output.accuracy_keeps": []}
    return stored(changed(scene, chosen | none)), Search(asked, kept, chosen)


def search_of(directory: Path) -> Search | None:
    """Read the search of the run in a folder; None if the run has none."""
    path = directory / ACCURACY
    if not path.exists():
        return None
    with named(InputError, f"{path}: not the search of a run"):
        stored_search = read_json(path)
        return Search(
            asked=stored_search["asked"],
            kept=tuple(stored_search["kept"]),
            chosen=stored_search["chosen"],
            runs=stored_search["runs"],
            wanted=stored_search["wanted"],
        )


def choosable(scene: Scene) -> tuple[str, ...]:
    """Full keys of the settings that a search can choose for a scene."""
    keys = ["time.tolerance", *(["time.periodicity"] if scene.time.periodic else [])]
    keys += [f"joints.{name}.cells" for name in scene.films]
    for name in meshed(scene):
        if scene.bodies[name].reduction.method != "rigid":
            keys.append(f"bodies.{name}.reduction")
            if scene.output.part_mesh_error and scene.bodies[name].cell_counts:
                keys.append(f"bodies.{name}.geometry")
    return tuple(keys)


def _kept(scene: Scene) -> tuple[str, ...]:
    """Full keys of the settings that the search must not change, from ``accuracy_keeps``.

    An entry of ``accuracy_keeps`` is the end of a full key, such as ``tolerance``, or the full key
    of one value within a setting, such as ``bodies.rod.reduction.method``.
    """
    known = choosable(scene)
    kept = []
    for name in scene.output.accuracy_keeps:
        meant = [
            key
            for key in known
            if f".{key}".endswith(f".{name}") or f"{name}.".startswith(f"{key}.")
        ]
        if not meant:
            raise SettingsError(
                f"output.accuracy_keeps: {name!r} is not a setting that accuracy chooses: "
                f"choose from {', '.join(known)}"
            )
        kept += meant
    return tuple(dict.fromkeys(kept))


def _pilot(scene: Scene, asked: float, kept: Collection[str]) -> dict[str, Any]:
    """Values of settings for the pilot run, by full key, for the required accuracy `asked`."""
    order = scene.time.order
    tolerance = 1e-3 * (PILOT_SHARE * asked / STEP_ERROR) ** ((order + 1.0) / order)
    values: dict[str, Any] = {
        "time.tolerance": rounded(float(np.clip(tolerance, PILOT_TIGHTEST, PILOT_LOOSEST)))
    }
    if scene.time.periodic:
        kept_tolerance = "time.tolerance" in kept
        used = scene.time.tolerance if kept_tolerance else values["time.tolerance"]
        values["time.periodicity"] = max(PERIODICITY * asked, CYCLE_NOISE * used)
    for name in scene.films:
        values[f"joints.{name}.cells"] = list(_pilot_cells(scene, name, asked))
    for name in meshed(scene):
        reduction = scene.bodies[name].reduction
        if reduction.method != "rigid":
            completed = attrs.evolve(reduction, method="m4", estimate_error=True)
            values[f"bodies.{name}.reduction"] = attrs.asdict(completed)
    return values


def _pilot_cells(scene: Scene, name: str, asked: float) -> tuple[int, int]:
    """Numbers of cells around and along a film in the pilot run.

    Both numbers are at most those of the scene, in the same ratio. A film with grooves or supplies
    has the numbers of the scene, because they were chosen for the edges of grooves and supplies.
    """
    joint = scene.joints[name]
    around, along = planned_cells(scene, name)
    most = 2 * ceil(
        0.5 * PILOT_AROUND[joint.element] * (0.01 / asked) ** (1.0 / FILM_ORDER["lagrange"])
    )
    most = min(max(most, FEWEST_AROUND), MOST_AROUND)
    if around <= most or joint.grooves or joint.supply:
        return around, along
    return most, max(3, round(along * most / around))


#: Largest number of runs after the pilot.
RUNS = 3

#: Type for errors by component, for every joint and quantity.
Errors = Mapping[tuple[str, str], Mapping[str, float]]


def account(
    search: Search,
    scene: Scene,
    recorded: Recorder,
    budgets: Mapping[str, Mapping[str, Any]],
    entries: Mapping[str, Any],
) -> dict[str, Any]:
    """Add a run with its errors to a search for an accuracy; choose the settings of the next run.

    Parameters
    ----------
    search, scene
        The search, and the scene of the run.
    recorded
        Recorder of the run.
    budgets
        Error budgets of the run, by joint.
    entries
        Entries of ``summary.json`` about the error budgets, and the status of the run.

    Returns
    -------
    dict
        Entries of ``summary.json`` about the accuracy.

    Raises
    ------
    AccuracyError
        A component of the error is not estimated; the message names the component.
    """
    notes = entries["error_budget_notes"]
    errors = _errors(search, budgets, notes)
    if search.runs and search.runs[-1]["chosen"] == search.chosen:
        search.runs.pop()  # a complete run was resumed
    search.runs.append(
        {
            "chosen": dict(search.chosen),
            "estimate": max(budgets[name][quantity]["known"] for name, quantity in errors),
            "errors": {
                key: max(parts[key] for parts in errors.values() if key in parts)
                for key in COMPONENTS
                if any(key in parts for parts in errors.values())
            },
            "status": entries["status"],
            "processor_time_s": recorded.processor_time + entries["error_budget_processor_time_s"],
        }
    )
    warnings = list(scene.warnings)
    if "part_mesh" in notes:
        warnings.append(
            f"output.accuracy = {search.asked:g} does not include the part mesh: "
            f"{notes['part_mesh']}"
        )
    if search.met:
        return {"accuracy": search.figures(), "status": "complete", "warnings": warnings}
    if len(search.runs) <= RUNS:
        values = _refined(search, scene, recorded, errors)
        search.wanted = {k: v for k, v in values.items() if v != search.chosen.get(k)}
    figures = {"accuracy": search.figures(), "status": search.runs[-1]["status"]}
    if not search.wanted:
        figures["warnings"] = [*warnings, _not_met(search)]
    return figures


def _errors(
    search: Search, budgets: Mapping[str, Mapping[str, Any]], notes: Mapping[str, str]
) -> Errors:
    """Estimated errors of a run by component, for every pair of a joint and a quantity."""
    errors: dict[tuple[str, str], dict[str, float]] = {}
    for joint, budget in budgets.items():
        for quantity in QUANTITIES:
            parts = errors[joint, quantity] = {}
            for key in COMPONENTS:
                value = budget[quantity][key]
                if not isinstance(value, str):
                    parts[key] = value
                elif key == "start" and value != NOT_APPLICABLE:
                    parts[key] = search.asked  # the films repeat by coincidence: run again
                elif value != NOT_APPLICABLE and key != "part_mesh":
                    raise AccuracyError(
                        f"output.accuracy = {search.asked:g}: the error of joints.{joint} due to "
                        f"{key.replace('_', ' ')} is {value}: {notes.get(key, 'drop accuracy')}"
                    )
    return errors


def _refined(search: Search, scene: Scene, recorded: Recorder, errors: Errors) -> dict[str, Any]:
    """Values of settings for the next run, by full key, from the errors of the last run.

    With these values, the total error of every result should be below the required accuracy by the
    margin of `AIM`. Every value is within the limits of a search.
    """
    films = {film.name: film for film in recorded.run.equations.system.films}
    trusted = search.runs[-1]["status"] == "complete"
    free = set(choosable(scene)) - set(search.kept)
    refinements: dict[str, tuple[float, str, FilmBinding]] = {}
    for (joint, _), parts in errors.items():
        keys = {
            component: free.intersection(_settings(component, films[joint])) for component in parts
        }
        reducible = {component: parts[component] for component in parts if keys[component]}
        fixed = sum(parts.values()) - sum(reducible.values())
        total = max(AIM * search.asked - fixed, LITTLE * fixed)
        level = water_filling_level(reducible.values(), total)
        for component, error in reducible.items():
            share = min(1.0, level / error) if error else 1.0
            if not trusted and component in ("step_size", "film_mesh"):
                share = min(share, HALF)
            for key in keys[component]:
                if share < refinements.get(key, (1.0,))[0]:
                    refinements[key] = share, component, films[joint]
    values = search.chosen | {
        key: _value(search, scene, recorded, key, *refinement)
        for key, refinement in refinements.items()
    }
    if {"time.periodicity", "time.tolerance"} <= set(values):
        # Two cycles have different steps, and differ by the errors of these steps.
        most = values["time.periodicity"] / CYCLE_NOISE
        values["time.tolerance"] = min(values["time.tolerance"], most)
    return values


def water_filling_level(errors: Collection[float], total: float) -> float:
    """Limit to which larger errors are reduced, so that the sum of all errors is `total`.

    The limit is infinite if the sum is already smaller.
    """
    for count, error in zip(range(len(errors), 0, -1), sorted(errors), strict=True):
        if count * error > total:
            return total / count
        total -= error
    return inf


#: Full keys of the settings that reduce each component of a joint's error; they contain the name of
#: the joint, or of a body whose surface in the joint deforms.
SETTINGS = {
    "step_size": "time.tolerance",
    "start": "time.periodicity",
    "film_mesh": "joints.{joint}.cells",
    "basis": "bodies.{body}.reduction",
    "part_mesh": "bodies.{body}.geometry",
}


def _settings(component: str, film: FilmBinding) -> set[str]:
    """Full keys of the settings on which an error component of a joint's film depends."""
    elastic = [bound.body for bound in film.surfaces if bound.surface.elastic]
    key = SETTINGS[component]
    return {key.format(joint=film.name, body=body) for body in elastic or [""]}


def _value(
    search: Search,
    scene: Scene,
    recorded: Recorder,
    key: str,
    share: float,
    component: str,
    film: FilmBinding,
) -> Any:
    """Value of the setting `key` with which an error component is multiplied by `share`.

    The value is within the limits of a search.
    """
    if component == "step_size":
        order = recorded.run.control.order
        tolerance = scene.time.tolerance
        return min(tolerance, max(rounded(tolerance * share ** ((order + 1.0) / order)), TIGHTEST))
    if component == "start":
        # Two cycles differ by the errors of their steps.
        noise = CYCLE_NOISE * scene.time.tolerance if "time.tolerance" in search.kept else 0.0
        periodicity = scene.time.periodicity
        return min(periodicity, max(rounded(share * periodicity), TIGHTEST_PERIODICITY, noise))
    if component == "film_mesh":
        grid = film.film.film.parameters.grid
        most = max(1.0, sqrt(MOST_CELLS / prod(grid.cells)))
        factor = min(share ** (-1.0 / FILM_ORDER[grid.family]), most)
        return [ceil(factor * cells - ROUNDING) for cells in grid.cells]
    part = scene.bodies[key.split(".")[1]]
    if component == "basis":
        modes = part.reduction.vibration_modes
        modes = max(modes, min(ceil(modes / share - ROUNDING), MOST_MODES))
        return {**search.chosen.get(key, {}), "vibration_modes": modes}
    around = max((part.geometry[key] for key in part.cell_counts if "around" in key), default=1.0)
    return part.geometry_of(min(share ** (-1.0 / PART_ORDER), max(1.0, MOST_CELLS_AROUND / around)))


def _not_met(search: Search) -> str:
    """Warning that the accuracy is not met, with the largest error component and the reason."""
    run = search.runs[-1]
    worst = max(run["errors"], key=run["errors"].__getitem__)
    keys = [key for key in search.kept if f".{key}".endswith(f".{KEYS[worst]}")]
    why = f"{', '.join(keys)} kept" if keys else f"after {len(search.runs)} runs or at a limit"
    return (
        f"output.accuracy = {search.asked:g} is not met: the estimate is {run['estimate']:.2g}, of "
        f"which {worst.replace('_', ' ')} {run['errors'][worst]:.2g} ({why})"
    )
