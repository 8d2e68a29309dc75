"""The mechanism of a run's folder, moving; nothing is meshed, reduced or compiled for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

from fenics_ehd.base.errors import InputError
from fenics_ehd.multibody.result import Result
from fenics_ehd.results.load import load_results
from fenics_ehd.results.motion import RecordedMotion
from fenics_ehd.results.replay import Replay
from fenics_ehd.results.run_folder import SCENE_NAME
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.run import stored_bodies
from fenics_ehd.scenes.scene_text import as_stored


def recorded(directory: str | Path, result: Result | None = None) -> Replay:
    """All recorded steps of a run of a scene, also of one that goes on or was killed.

    Parameters
    ----------
    directory
        Of the run.
    result
        What it answers, or a part of that; None: all, read here.

    Raises
    ------
    InputError
        The folder holds no scene, or no step.
    SettingsError, BodyFileError
        Scene or bodies cannot be read.
    """
    folder = Path(directory)
    if not (folder / SCENE_NAME).is_file():
        raise InputError(f"{folder / SCENE_NAME}: missing, {directory} is not the folder of a run")
    scene = as_stored(folder / SCENE_NAME)
    bodies = stored_bodies(scene, folder)
    # Forces move nothing here, and their tables may be gone.
    mechanism = build_mechanism(replace(scene, forces={}), MPI.COMM_SELF, bodies=bodies).mechanism
    return Replay(mechanism, RecordedMotion.of(result or load_results(folder)))
