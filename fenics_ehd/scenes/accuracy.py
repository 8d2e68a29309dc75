"""Accuracy asked of a run: what takes the largest share of its error is refined, run by run.

A pilot run comes first: on coarse films, with a tolerance that usually gives such errors. Its error
budget (`fenics_ehd.analysis.error_budget`) tells whether it will do. If not, the largest shares of
the errors of every figure are brought down to one level, by the laws of their settings,

    step size   tolerance^(k / (k + 1)),
    film mesh   cells^-3 either way, of 4-node cells cells^-2: between the orders of a film's
                solution and of what its nodes miss of a peak between them,
    basis       1 / modes,
    part mesh   cells^-2,
    start       periodicity,

at which all shares together leave a margin to the accuracy; and the next run is judged in the same
way.

What is chosen, unless ``output.accuracy_keeps`` names it: the tolerance of steps and of the
periodicity, the cells of every film, the reduction of meshed parts that are not to be rigid, and,
with ``output.part_mesh_error``, cells of their meshes.
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
from fenics_ehd.multibody.mechanism import FilmBinding
from fenics_ehd.multibody.periodic import CYCLE_NOISE
from fenics_ehd.multibody.simulation import Simulation
from fenics_ehd.multibody.trust import COMPONENTS, KEYS, NOT_APPLICABLE, QUANTITIES
from fenics_ehd.reduction.mesh_error import ORDER as PART_ORDER
from fenics_ehd.scenes.films import planned_cells
from fenics_ehd.scenes.scene import Scene, changed, meshed, stored

#: Least tolerance of a step, least periodicity, most film cells, vibration modes that a basis may
#: have, and cells of a part's mesh around a bore.
TIGHTEST = 1e-8
TIGHTEST_PERIODICITY = 1e-7
MOST_CELLS = 6400
MOST_MODES = 48
MOST_CELLS_AROUND = 60

#: Share of the accuracy that all components together are aimed at, and what of its steps and films
#: is left of a run that may not be trusted.
AIM, HALF = 0.7, 0.5

#: Beside shares that are kept others that are less of them are left alone.
LITTLE = 0.2

#: Rounding that makes no cell more.
ROUNDING = 1e-6


def rounded(value: float) -> float:
    """Down to two digits, as people write numbers."""
    digits = 10.0 ** (int(np.floor(log10(value))) - 1)
    return float(f"{np.floor(value / digits * (1 + ROUNDING)) * digits:.1e}")


#: Cells of a pilot's films around at an accuracy of 1 %, by element, and the order of their errors.
#: Those of films of 24 cells are 0.3 to 1.5 %, of 4-node ones of 48 cells 1.2 %.
PILOT_AROUND = {"lagrange": 24, "serendipity": 24, "bilinear": 48}
FILM_ORDER = {"lagrange": 3.0, "serendipity": 3.0, "bilinear": 2.0}

#: Fewest and most cells of a pilot's film around.
FEWEST_AROUND, MOST_AROUND = 16, 48

#: Error of the steps at a tolerance of 1e-3, of order 2 or 3: 0.4 to 1.5 % of shipped scenes; the
#: share of the accuracy that it is to take in a pilot, and least and largest tolerance of one.
STEP_ERROR = 0.006
PILOT_SHARE = 0.6
PILOT_TIGHTEST = 3e-4
PILOT_LOOSEST = 3e-3

#: Least accuracy: smaller errors were never judged (`docs/error-budget.md`), and 1e-9 would be 37
#: hours.
LEAST = 1e-4

#: Periodicity over the accuracy; at least it is `CYCLE_NOISE` times the tolerance of a step.
PERIODICITY = 0.1


@dataclass
class Search:
    """For settings that meet an accuracy.

    Attributes
    ----------
    asked
        The accuracy.
    kept
        Full keys that stay as written.
    chosen
        Values by full key of the run under way.
    runs
        Of every run so far, the pilot first: what was ``chosen``, its ``estimate``, the largest
        error of every component as ``errors``, ``status``, ``processor_time_s``.
    wanted
        Values for the next run; none: the search is over.
    """

    asked: float
    kept: tuple[str, ...]
    chosen: dict[str, Any]
    runs: list[dict[str, Any]] = field(default_factory=list)
    wanted: dict[str, Any] = field(default_factory=dict)

    @property
    def met(self) -> bool:
        """True if the last run meets the accuracy, and may be trusted."""
        last = self.runs[-1]
        return bool(last["estimate"] <= self.asked and last["status"] == "complete")

    def go_on(self, scene: Scene) -> Scene:
        """With what is wanted for the next run."""
        self.chosen, values, self.wanted = {**self.chosen, **self.wanted}, self.wanted, {}
        return stored(changed(scene, values))

    def leave(self, directory: Path) -> None:
        """Store it beside the run under way."""
        contents = {
            "asked": self.asked,
            "kept": self.kept,
            "chosen": self.chosen,
            "runs": self.runs,
            "wanted": self.wanted,
        }
        write_whole(directory / ACCURACY, to_json(contents) + "\n")

    def figures(self) -> dict[str, Any]:
        """For ``summary.json``."""
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


def begun(scene: Scene) -> tuple[Scene, Search | None]:
    """The pilot's scene, which asks for no accuracy, and its search; as given if none is asked for.

    Raises
    ------
    SettingsError
        There is no film, or its errors are not to be estimated, or not so well, or no such key is
        chosen.
    """
    output, asked = scene.output, scene.output.accuracy
    if not asked:
        return scene, None
    if not scene.films:
        raise SettingsError(f"output.accuracy = {asked:g}: scene {scene.name} has no film")
    if not output.error_budget:
        raise SettingsError(f"output.accuracy = {asked:g} needs output.error_budget = true")
    if asked < LEAST:
        raise SettingsError(
            f"output.accuracy = {asked:g} is below {LEAST:g}, where errors are not known to be "
            "estimated well: ask for that, or write meshes and steps"
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
    """Search that the run in a folder belongs to."""
    path = directory / ACCURACY
    if not path.exists():
        return None
    with named(InputError, f"{path}: not the search of a run"):
        found = read_json(path)
        return Search(
            asked=found["asked"],
            kept=tuple(found["kept"]),
            chosen=found["chosen"],
            runs=found["runs"],
            wanted=found["wanted"],
        )


def choosable(scene: Scene) -> tuple[str, ...]:
    """Full keys of what an accuracy chooses."""
    keys = ["time.tolerance", *(["time.periodicity"] if scene.time.periodic else [])]
    keys += [f"joints.{name}.cells" for name in scene.films]
    for name in meshed(scene):
        if scene.bodies[name].reduction.method != "rigid":
            keys.append(f"bodies.{name}.reduction")
            if scene.output.part_mesh_error and scene.bodies[name].cell_counts:
                keys.append(f"bodies.{name}.geometry")
    return tuple(keys)


def _kept(scene: Scene) -> tuple[str, ...]:
    """Full keys of those that are to stay, which may be given by their end, or one within them."""
    known, found = choosable(scene), []
    for name in scene.output.accuracy_keeps:
        own = [
            key
            for key in known
            if f".{key}".endswith(f".{name}") or f"{name}.".startswith(f"{key}.")
        ]
        if not own:
            raise SettingsError(
                f"output.accuracy_keeps: {name!r} is none of what is chosen: {', '.join(known)}"
            )
        found += own
    return tuple(dict.fromkeys(found))


def _pilot(scene: Scene, asked: float, kept: Collection[str]) -> dict[str, Any]:
    """Values of a pilot by key."""
    order = scene.time.order
    tolerance = 1e-3 * (PILOT_SHARE * asked / STEP_ERROR) ** ((order + 1.0) / order)
    values: dict[str, Any] = {
        "time.tolerance": rounded(float(np.clip(tolerance, PILOT_TIGHTEST, PILOT_LOOSEST)))
    }
    if scene.time.periodic:
        own = values["time.tolerance"] if "time.tolerance" not in kept else scene.time.tolerance
        values["time.periodicity"] = max(PERIODICITY * asked, CYCLE_NOISE * own)
    for name in scene.films:
        values[f"joints.{name}.cells"] = list(_pilot_cells(scene, name, asked))
    for name in meshed(scene):
        reduction = scene.bodies[name].reduction
        if reduction.method != "rigid":
            own = attrs.evolve(reduction, method="m4", estimate_error=True)
            values[f"bodies.{name}.reduction"] = attrs.asdict(own)
    return values


def _pilot_cells(scene: Scene, name: str, asked: float) -> tuple[int, int]:
    """As the scene's own in shape, but coarse; with supplies, whose edges need cells, its own."""
    joint, (around, along) = scene.joints[name], planned_cells(scene, name)
    most = 2 * ceil(
        0.5 * PILOT_AROUND[joint.element] * (0.01 / asked) ** (1.0 / FILM_ORDER["lagrange"])
    )
    most = min(max(most, FEWEST_AROUND), MOST_AROUND)
    if around <= most or joint.grooves or joint.supply:
        return around, along
    return most, max(3, round(along * most / around))


#: Runs after the pilot, at most.
RUNS = 3

#: By joint and quantity: component and error.
Errors = Mapping[tuple[str, str], Mapping[str, float]]


def account(
    search: Search, scene: Scene, recorded: Simulation, worth: Mapping[str, Any]
) -> dict[str, Any]:
    """Add a judged run to its search, which then wants other settings or is over.

    Parameters
    ----------
    search, scene
        Of the run.
    recorded
        The run, which has the budgets.
    worth
        What the summary has of its budget.

    Returns
    -------
    dict
        For ``summary.json``.

    Raises
    ------
    AccuracyError
        A component is not estimated.
    """
    errors = _errors(search, recorded, worth["error_budget_notes"])
    budgets = recorded.worth
    if search.runs and search.runs[-1]["chosen"] == search.chosen:
        search.runs.pop()  # a complete run, taken up again
    search.runs.append(
        {
            "chosen": dict(search.chosen),
            "estimate": max(budgets[name][quantity]["known"] for name, quantity in errors),
            "errors": {
                key: max(own[key] for own in errors.values() if key in own)
                for key in COMPONENTS
                if any(key in own for own in errors.values())
            },
            "status": recorded.verdict(max(scene.output.error_limit, search.asked)),
            "processor_time_s": recorded.processor_time + worth["error_budget_processor_time_s"],
        }
    )
    warnings, why = list(scene.warnings), worth["error_budget_notes"].get("part_mesh")
    if why is not None:
        warnings.append(f"output.accuracy = {search.asked:g} is without the part mesh: {why}")
    if search.met:
        return {"accuracy": search.figures(), "status": "complete", "warnings": warnings}
    if len(search.runs) <= RUNS:
        values = _refined(search, scene, recorded, errors)
        search.wanted = {k: v for k, v in values.items() if v != search.chosen.get(k)}
    found = {"accuracy": search.figures(), "status": search.runs[-1]["status"]}
    if not search.wanted:
        found["warnings"] = [*warnings, _missed(search)]
    return found


def _errors(search: Search, recorded: Simulation, notes: Mapping[str, str]) -> Errors:
    """Components that count."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for joint, budget in recorded.worth.items():
        for quantity in QUANTITIES:
            own = found[joint, quantity] = {}
            for key in COMPONENTS:
                value = budget[quantity][key]
                if not isinstance(value, str):
                    own[key] = value
                elif key == "start" and value != NOT_APPLICABLE:
                    own[key] = search.asked  # films that repeat by chance: once more
                elif value != NOT_APPLICABLE and key != "part_mesh":
                    raise AccuracyError(
                        f"output.accuracy = {search.asked:g}: the error of joints.{joint} by "
                        f"{key.replace('_', ' ')} is {value}: {notes.get(key, 'drop the key')}"
                    )
    return found


def _refined(search: Search, scene: Scene, recorded: Simulation, errors: Errors) -> dict[str, Any]:
    """Values by key that bring the errors of every figure to the aim together, within limits."""
    films = {binding.name: binding for binding in recorded.run.equations.system.films}
    trusted = search.runs[-1]["status"] == "complete"
    free = set(choosable(scene)) - set(search.kept)
    found: dict[str, tuple[float, str, FilmBinding]] = {}
    for (joint, _), own in errors.items():
        keys = {component: _setting(component, films[joint]) for component in own}
        ours = {component: own[component] for component in own if keys[component] in free}
        beyond = sum(own.values()) - sum(ours.values())
        level = water_level(ours.values(), max(AIM * search.asked - beyond, LITTLE * beyond))
        for component, error in ours.items():
            share = min(1.0, level / error) if error else 1.0
            if not trusted and component in ("step_size", "film_mesh"):
                share = min(share, HALF)
            former = found.get(keys[component], (1.0,))
            if share < former[0]:
                found[keys[component]] = share, component, films[joint]
    values = search.chosen | {
        key: _value(search, scene, recorded, *wanted) for key, wanted in found.items()
    }
    if {"time.periodicity", "time.tolerance"} <= set(values):
        # The steps of a cycle are not those of the one before.
        most = values["time.periodicity"] / CYCLE_NOISE
        values["time.tolerance"] = min(values["time.tolerance"], most)
    return values


def water_level(errors: Collection[float], total: float) -> float:
    """Limit that leaves errors a total together; infinite where they are less."""
    for left, error in zip(range(len(errors), 0, -1), sorted(errors), strict=True):
        if left * error > total:
            return total / left
        total -= error
    return inf


def _setting(component: str, binding: FilmBinding) -> str:
    """Key of what makes a component of the errors of a joint smaller."""
    return {
        "step_size": "time.tolerance",
        "start": "time.periodicity",
        "film_mesh": f"joints.{binding.name}.cells",
        "basis": f"bodies.{binding.bore_body}.reduction",
        "part_mesh": f"bodies.{binding.bore_body}.geometry",
    }[component]


def _value(
    search: Search,
    scene: Scene,
    recorded: Simulation,
    share: float,
    component: str,
    binding: FilmBinding,
) -> Any:
    """Value of its setting that leaves a share of a component, or is the last within limits."""
    if component == "step_size":
        order, own = recorded.run.control.order, scene.time.tolerance
        return min(own, max(rounded(own * share ** ((order + 1.0) / order)), TIGHTEST))
    if component == "start":
        # Cycles differ by what their steps leave.
        noise = CYCLE_NOISE * scene.time.tolerance if "time.tolerance" in search.kept else 0.0
        own = scene.time.periodicity
        return min(own, max(rounded(share * own), TIGHTEST_PERIODICITY, noise))
    if component == "film_mesh":
        grid = binding.film.film.parameters.grid
        most = max(1.0, sqrt(MOST_CELLS / prod(grid.cells)))
        factor = min(share ** (-1.0 / FILM_ORDER[grid.family]), most)
        return [ceil(factor * cells - ROUNDING) for cells in grid.cells]
    part, chosen = scene.bodies[binding.bore_body], search.chosen
    if component == "basis":
        modes = part.reduction.vibration_modes
        modes = max(modes, min(ceil(modes / share - ROUNDING), MOST_MODES))
        return {**chosen.get(_setting(component, binding), {}), "vibration_modes": modes}
    around = max((part.geometry[key] for key in part.cell_counts if "around" in key), default=1.0)
    return part.geometry_of(min(share ** (-1.0 / PART_ORDER), max(1.0, MOST_CELLS_AROUND / around)))


def _missed(search: Search) -> str:
    """The line that says so."""
    run = search.runs[-1]
    worst = max(run["errors"], key=run["errors"].__getitem__)
    keys = [key for key in search.kept if f".{key}".endswith(f".{KEYS[worst]}")]
    why = f"{', '.join(keys)} kept" if keys else f"after {len(search.runs)} runs or at a limit"
    return (
        f"output.accuracy = {search.asked:g} is not met: the estimate is {run['estimate']:.2g}, of "
        f"which {worst.replace('_', ' ')} {run['errors'][worst]:.2g} ({why})"
    )
