"""From a judged run to the settings of the next one, which is to meet an accuracy."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any

from fenics_ehd.base.errors import AccuracyError
from fenics_ehd.multibody.energy import ENERGY_LIMIT, trusted
from fenics_ehd.multibody.error_budget import FILM_ORDERS
from fenics_ehd.multibody.error_shares import COMPONENTS, KEYS, NOT_APPLICABLE, QUANTITIES
from fenics_ehd.multibody.other_films import FINER
from fenics_ehd.multibody.tracking import Tracker
from fenics_ehd.reduction.mesh_error import ORDER as PART_ORDER
from fenics_ehd.results.recorded_run import RecordedRun
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.accuracy import NOISE, Search
from fenics_ehd.scenes.accuracy_choice import (
    ELASTIC,
    NODES,
    Figure,
    FilmMesh,
    JudgedRun,
    cheapest,
    rounded,
)
from fenics_ehd.scenes.part_cells import counts, part_cells
from fenics_ehd.scenes.scene import Scene, meshed

#: Share of the accuracy that all components together are aimed at, and that a part's mesh, a basis
#: and the start may take of it.
AIM, PART_SHARE, BASIS_SHARE, START_SHARE = 0.7, 0.25, 0.25, 0.1

#: Runs after the pilot, at most.
RUNS = 3

#: Vibration modes that a basis may have, cells of a part's mesh around a bore, least periodicity.
MOST_MODES, MOST_AROUND, TIGHTEST_PERIODICITY = 48, 60, 1e-7

#: Of the steps that the longest one forces, the share that any tolerance has: others would be
#: shorter with less of it. A four-bar and a journal take 1.24 and 1.45 times the steps with a
#: quarter of the tolerance, a rotor 2.7 times with an eightieth: 1.34, 1.36 and 2.9 by this.
FORCED = 0.5

#: By joint and quantity: component and error.
Errors = Mapping[tuple[str, str], Mapping[str, float]]


def account(
    search: Search, scene: Scene, recorded: RecordedRun, worth: Mapping[str, Any]
) -> dict[str, Any]:
    """Add a judged run to its search, which then wants other settings or is over.

    Parameters
    ----------
    search, scene
        Of the run.
    recorded
        The run, whose tracker has the budgets.
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
    budgets = recorded.tracker.worth
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
            "status": recorded.tracker.verdict(max(scene.output.error_limit, search.asked)),
            "processor_time_s": recorded.processor_time + worth["error_budget_processor_time_s"],
        }
    )
    warnings, why = list(scene.warnings), worth["error_budget_notes"].get("part_mesh")
    if why is not None:
        warnings.append(f"output.accuracy = {search.asked:g} is without the part mesh: {why}")
    if search.met:
        return {"accuracy": search.figures(), "status": "complete", "warnings": warnings}
    if len(search.runs) <= RUNS:
        values = _next(search, scene, recorded, errors)
        search.wanted = {k: v for k, v in values.items() if v != search.chosen.get(k)}
    found = {"accuracy": search.figures(), "status": search.runs[-1]["status"]}
    if not search.wanted:
        found["warnings"] = [*warnings, _missed(search)]
    return found


def _errors(search: Search, recorded: RecordedRun, notes: Mapping[str, str]) -> Errors:
    """Components that count."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for joint, budget in recorded.tracker.worth.items():
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


def _next(search: Search, scene: Scene, recorded: RecordedRun, errors: Errors) -> dict[str, Any]:
    """Values for the next run by key."""
    left, asked = _Left({figure: dict(own) for figure, own in errors.items()}), search.asked
    values = dict(search.chosen)
    start, loosest = left.largest("start") / (START_SHARE * asked), inf
    if "time.periodicity" in values and start > 1.0:
        noise = NOISE * scene.time.tolerance if "time.tolerance" in search.kept else 0.0
        periodicity = max(values["time.periodicity"] / start, noise, TIGHTEST_PERIODICITY)
        share = min(1.0, periodicity / values["time.periodicity"])
        left.scale("start", share)
        values["time.periodicity"] = rounded(share * values["time.periodicity"])
        loosest = values["time.periodicity"] / NOISE
    for name in meshed(scene):
        films = recorded.run.equations.system.films
        joints = {place.name for place in films if place.bore_body == name}
        values |= _part(search, scene.bodies[name], f"bodies.{name}", left, joints)
    judged = _judged(search, scene, recorded, left.errors)
    # No looser than this one, which was not good enough: by the laws that would often be cheaper.
    judged = replace(judged, longest=min(judged.longest, 1.0, judged.shares(loosest)))
    choice = cheapest(judged, AIM * asked)
    values["time.tolerance"] = choice.tolerance
    values |= {f"joints.{name}.cells": list(cells) for name, cells in choice.cells.items()}
    return {key: value for key, value in values.items() if key not in search.kept}


def _part(
    search: Search, part: schema.FlexibleSettings, key: str, left: _Left, joints: Collection[str]
) -> dict[str, Any]:
    """Values of a part whose basis or mesh takes too much of the accuracy."""
    values: dict[str, Any] = {}
    reduction, modes = search.chosen.get(f"{key}.reduction"), part.reduction.vibration_modes
    if reduction and left.largest("basis", joints) > BASIS_SHARE * search.asked:
        more = min(2 * modes, max(modes, MOST_MODES))
        # Halved at least: the inertia that is neglected begins at higher frequencies.
        left.scale("basis", modes / more, joints)
        values[f"{key}.reduction"] = {**reduction, "vibration_modes": more}
    over = left.largest("part_mesh", joints) / (PART_SHARE * search.asked)
    if over > 1.0 and counts(part):
        cells = (part.geometry[key] for key in counts(part) if "around" in key)
        around = max(cells, default=MOST_AROUND)
        factor = min(over ** (1.0 / PART_ORDER), max(1.0, MOST_AROUND / around))
        left.scale("part_mesh", factor**-PART_ORDER, joints)
        values[f"{key}.geometry"] = part_cells(part, factor)
    return values


@dataclass
class _Left:
    """Errors of a run, as they will be."""

    errors: dict[tuple[str, str], dict[str, float]]

    def largest(self, component: str, joints: Collection[str] | None = None) -> float:
        """Of a component, of some joints or all."""
        return max((own[component] for own in self._of(component, joints)), default=0.0)

    def scale(self, component: str, share: float, joints: Collection[str] | None = None) -> None:
        """Leave a share of a component."""
        for own in self._of(component, joints):
            own[component] *= share

    def _of(self, component: str, joints: Collection[str] | None) -> list[dict[str, float]]:
        return [
            own
            for (joint, _), own in self.errors.items()
            if component in own and (joints is None or joint in joints)
        ]


def _judged(search: Search, scene: Scene, recorded: RecordedRun, errors: Errors) -> JudgedRun:
    """The run as the laws know it."""
    run, steps = recorded.run, recorded.tracker.counts["steps"]
    films = {}
    for place in run.equations.system.films:
        grid = place.film.film.parameters.grid
        films[place.name] = FilmMesh(
            grid.cells,
            FILM_ORDERS[grid.family != "bilinear"],
            NODES[grid.family] * (ELASTIC if place.bore else 1.0),
            f"joints.{place.name}.cells" in search.kept,
        )
    figures = []
    for (joint, quantity), own in errors.items():
        # What nodes miss as a rule, not what they happen to miss: others lie elsewhere.
        between = recorded.tracker.worth[joint][quantity]["between_nodes"]
        rest = sum(value for key, value in own.items() if key not in ("film_mesh", "step_size"))
        mesh = max(0.0, own["film_mesh"] - between)
        figures.append(Figure(joint, mesh, between, own["step_size"], rest))
    return JudgedRun(
        tuple(figures),
        films,
        scene.time.tolerance,
        run.control.order,
        FORCED * min(1.0, run.state.time / run.control.largest_step / steps),
        "time.tolerance" in search.kept,
        *_trusted(recorded.tracker),
    )


def _trusted(tracker: Tracker) -> tuple[float, float]:
    """Largest share of the steps' error with which a run is to be trusted, and least cells.

    The defect of the energy falls as the steps' error does. Of what else is distrusted the film has
    too few cells.
    """
    balance = tracker.balance
    if tracker.verdict() == "complete" or balance is None:
        return inf, 0.0
    if trusted(balance.error, balance.net_error) == "complete":
        return inf, FINER
    return AIM * min(1.0, ENERGY_LIMIT / balance.error), 0.0


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
