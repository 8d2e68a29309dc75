"""``output.accuracy``: settings that meet it are chosen, run by run.

A pilot run comes first: on coarse films, with a tolerance that usually gives such errors. Its error
budget (`fenics_ehd.multibody.error_budget`) tells whether it will do. If not, its errors and the
laws by which they fall tell what will at the least time (`accuracy_choice`), and the next run is
judged in the same way, so that a choice is corrected from better data.

What is chosen, unless ``output.accuracy_keeps`` names it: the tolerance of steps and of the
periodicity, the cells of every film, the reduction of meshed parts that are not to be rigid, and,
with ``output.part_mesh_error``, cells of their meshes.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.base.output import ACCURACY, to_json, write_whole
from fenics_ehd.base.sealed_file import named
from fenics_ehd.base.text_file import read_json
from fenics_ehd.scenes.accuracy_choice import rounded
from fenics_ehd.scenes.films import planned_cells
from fenics_ehd.scenes.given import changed
from fenics_ehd.scenes.part_cells import counts, with_counts
from fenics_ehd.scenes.scene import Scene, lubricated_joints, meshed
from fenics_ehd.scenes.scene_text import stored

#: Cells of a pilot's films around at an accuracy of 1 %, by element, and the order of what others
#: take, between those of a film's solution and of what its nodes miss. Errors of films of 24 cells
#: are 0.3 to 1.5 %, of 4-node ones of 48 cells 1.2 %.
PILOT_AROUND, PILOT_ORDER = {"lagrange": 24, "serendipity": 24, "bilinear": 48}, 3.0

#: Fewest and most cells of a pilot's film around.
FEWEST_AROUND, MOST_AROUND = 16, 48

#: Error of the steps at a tolerance of 1e-3, of order 2 or 3: 0.4 to 1.5 % of shipped scenes; the
#: share of the accuracy that it is to take in a pilot, and least and largest tolerance of one.
STEP_ERROR, PILOT_SHARE, PILOT_TIGHTEST, PILOT_LOOSEST = 0.006, 0.6, 3e-4, 3e-3

#: Least accuracy: smaller errors were never judged (`docs/error-budget.md`), and 1e-9 would be 37
#: hours.
LEAST = 1e-4

#: Periodicity over the accuracy, and its least over the tolerance of a step: the steps that a cycle
#: takes differ from those of the one before. Films of a small journal under a load of five rows and
#: of a four-bar's pin so change by up to once the tolerance from cycle to cycle, without end.
PERIODICITY, NOISE = 0.1, 1.0


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
        """Whether the last run meets the accuracy, and may be trusted."""
        last = self.runs[-1]
        return bool(last["estimate"] <= self.asked and last["status"] == "complete")

    def go_on(self, scene: Scene) -> Scene:
        """With what is wanted for the next run."""
        self.chosen, values, self.wanted = {**self.chosen, **self.wanted}, self.wanted, {}
        return stored(changed(scene, values))

    def leave(self, directory: Path) -> None:
        """Store it beside the run under way."""
        write_whole(directory / ACCURACY, to_json(vars(self)) + "\n")

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
        if output.accuracy_keeps:
            raise SettingsError(
                "output.accuracy_keeps does nothing without output.accuracy: give it, 0.01 say"
            )
        return scene, None
    if not lubricated_joints(scene):
        raise SettingsError(f"output.accuracy = {asked:g}: scene {scene.name} has no film")
    if not output.error_budget:
        raise SettingsError(f"output.accuracy = {asked:g} needs output.error_budget = true")
    if asked < LEAST:
        raise SettingsError(
            f"output.accuracy = {asked:g} is below {LEAST:g}, where errors are not known to be "
            "estimated well: ask for that, or write meshes and steps"
        )
    if output.part_mesh_error:
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


def keeping(scene: Scene, keys: Sequence[str]) -> Scene:
    """With more keys that stay as written."""
    kept = [*scene.output.accuracy_keeps, *keys]
    return changed(scene, {"output.accuracy_keeps": kept})


def search_of(directory: Path) -> Search | None:
    """Of the run in a folder."""
    path = directory / ACCURACY
    if not path.exists():
        return None
    with named(InputError, f"{path}: not the search of a run"):
        found = read_json(path)
        return Search(**found | {"kept": tuple(found["kept"])})


def choosable(scene: Scene) -> tuple[str, ...]:
    """Full keys of what an accuracy chooses."""
    keys = ["time.tolerance", *(["time.periodicity"] if scene.time.periodic else [])]
    keys += [f"joints.{name}.cells" for name in lubricated_joints(scene)]
    for name in meshed(scene):
        if scene.bodies[name].reduction.method != "rigid":
            keys.append(f"bodies.{name}.reduction")
            if scene.output.part_mesh_error and counts(scene.bodies[name]):
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
        values["time.periodicity"] = max(PERIODICITY * asked, NOISE * own)
    for name in lubricated_joints(scene):
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
    most = 2 * ceil(0.5 * PILOT_AROUND[joint.element] * (0.01 / asked) ** (1.0 / PILOT_ORDER))
    most = min(max(most, FEWEST_AROUND), MOST_AROUND)
    if around <= most or joint.grooves or joint.supply:
        return around, along
    return most, max(3, round(along * most / around))
