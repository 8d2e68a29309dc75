"""What pictures are drawn of: the last cycle of runs, joint by joint."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.base.errors import EhdError
from fenics_ehd.base.output import SUMMARY
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.multibody.joint_contact import joint_contact
from fenics_ehd.plotting.recorded import recorded
from fenics_ehd.results.history_file import read_history
from fenics_ehd.results.motion import joint_histories
from fenics_ehd.results.replay import Replay
from fenics_ehd.results.run_folder import SCENE_NAME
from fenics_ehd.scenes.scene import lubricated_joints
from fenics_ehd.scenes.scene_text import as_stored

#: Columns that a cycle is drawn over: the crank's angle, or time in a mechanism without any.
ANGLE, TIME = "crank_angle_deg", "time_s"

#: Column of kinetic and strain energy, less those at the start.
STORED = "stored_energy_J"


@dataclass(frozen=True, eq=False)
class ShownFilm:
    """A film over the steps of a cycle.

    Attributes
    ----------
    grid
        Its mesh.
    clearance
        [m]
    pressure, gap
        At the nodes, shape (t, k) [Pa], [m].
    contact
        Contact pressure there, None between smooth surfaces.
    """

    grid: FilmGrid
    clearance: float
    pressure: np.ndarray
    gap: np.ndarray
    contact: np.ndarray | None


class ShownRun:
    """A run as drawn.

    Parameters
    ----------
    name
        In legends.
    directory
        Of it.

    Attributes
    ----------
    columns
        Of its history, and the time of the cycle.

    Raises
    ------
    InputError
        It holds no history.
    """

    def __init__(self, name: str, directory: str | Path):
        self.name, self.directory = name, Path(directory)
        self.told, self.starts, self.figures = "", False, dict[str, dict[str, float]]()
        history = read_history(directory)
        self.columns = history | {TIME: history.get("cycle_time_s", history[TIME])}

    @cached_property
    def joints(self) -> dict[str, ShownJoint]:
        """Its lubricated joints by name."""
        shared = {ANGLE: self.columns[ANGLE]} if ANGLE in self.columns else {}
        return {
            name: ShownJoint(self, name, own | shared)
            for name, own in named_histories(self.directory).items()
        }

    @property
    def whole(self) -> ShownJoint:
        """Itself, its energies too."""
        stored = self.columns["kinetic_energy_J"] + self.columns["strain_energy_J"]
        return ShownJoint(self, "", self.columns | {STORED: stored - stored[0]})

    @cached_property
    def replay(self) -> Replay | None:
        """The mechanism over the cycle, None without scene, bodies or fields of it."""
        with suppress(EhdError):
            return recorded(self.directory)
        return None

    @cached_property
    def summary(self) -> Mapping[str, Any]:
        """Its figures, none of a run that was killed."""
        with suppress(OSError, ValueError):
            return json.loads((self.directory / SUMMARY).read_text())
        return {}


@dataclass(frozen=True, eq=False)
class ShownJoint:
    """A lubricated joint of a run, or a run as a whole, without a name.

    Attributes
    ----------
    run, name
        Which.
    columns
        Of the history.
    """

    run: ShownRun
    name: str
    columns: Mapping[str, np.ndarray]

    @cached_property
    def film(self) -> ShownFilm | None:
        """Fields of its film, None where they are not to be had."""
        replay = self.run.replay
        place = (
            next((p for p in replay.system.films if p.name == self.name), None) if replay else None
        )
        if replay is None or place is None:
            return None
        gap, contact = replay.gaps[self.name], joint_contact(place)
        parameters = place.film.film.parameters
        return ShownFilm(
            parameters.grid,
            parameters.clearance,
            replay.motion.pressures[self.name],
            gap,
            None if contact is None else contact.surfaces.asperities.touch(gap).pressure,
        )


def named_histories(directory: Path) -> dict[str, dict[str, np.ndarray]]:
    """As `joint_histories`, the only joint with its name too, if the folder has its scene."""
    found = joint_histories(directory)
    if list(found) == [""]:
        with suppress(EhdError):
            (name,) = lubricated_joints(as_stored(directory / SCENE_NAME))
            return {name: found[""]}
    return found
