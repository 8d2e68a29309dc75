"""Inputs without a fault, small ones, and what the program answers to them."""

import hashlib
import json
import os
import shutil
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from attempt import attempt, finish, launch
from hand_made_rod import Joint, make_body
from judge import figures
from mpi4py import MPI
from petsc4py import PETSc
from scene_cases import LOADED_JOURNAL, ROD_OF_A_FILE, structure, write_scene
from scipy import io, sparse

import fenics_ehd as ehd
from fenics_ehd.cli.main import main
from fenics_ehd.reduction.matrices import as_matrix
from fenics_ehd.reduction.part_files import load_structure, save_structure

#: The paper's machine with a rod of a file under two tables.
SCENE = ROD_OF_A_FILE | {
    "bodies.crank.speed": 500.0,
    "drives.crank": {"kind": "torque", "table": "torque.csv"},
    "forces.gas": {
        "kind": "angle-table", "point": "piston", "angle_of": "crank", "file": "gas.csv"
    },
    "time.revolutions": 0.002,
}  # fmt: skip

#: A run of a second and 170 steps, to be stopped.
LONG_SCENE = ROD_OF_A_FILE | {"time.revolutions": 0.15, "time.tolerance": 1e-7}

#: A run whose history needs far more room than a run asks for at its start.
LARGE_SCENE = LONG_SCENE | {"time.revolutions": 2.0, "time.tolerance": 1e-6}

#: A journal whose load repeats; its film is coarse.
JOURNAL = LOADED_JOURNAL | {
    "joints.bearing.cells": [8, 2], "time.tolerance": 1e-1, "time.periodicity": 1e-1,
    "output.error_limit": 0.9,
}  # fmt: skip

TABLES = {
    "gas.csv": "angle_deg,force_N\n0,80\n90,10\n180,20\n360,80\n",
    "torque.csv": "angle_deg,torque_Nm\n0,1\n120,2\n240,-1\n360,1\n",
    "load.csv": "time_s,Fx_N,Fy_N\n0,1e3,0\n0.005,0,1e3\n0.01,-1e3,0\n0.015,0,-1e3\n0.02,1e3,0\n",
}

#: A rod of few elements, for the files of whole parts.
COARSE = {
    "bore_cells_around": 10,
    "bore_cells_along": 2,
    "big_end_layers": 1,
    "shank_cells": 2,
    "small_end_layers": 1,
}

RUN = ("run", "scene.toml", "--no-plots", "-o", "out")
JOURNAL_RUN = ("run", "journal.toml", "--no-plots", "-o", "out")
RESUME = ("run", "--resume", "out", "--no-plots")


def command(*arguments: str) -> Callable[[], None]:
    """A call of the command line."""
    return lambda: main(list(arguments))


def read_matrix(name: str) -> Callable[[], None]:
    """A call that reads a matrix and leaves its digest in ``figures.json``."""

    def call() -> None:
        matrix = as_matrix(name, MPI.COMM_SELF, "stiffness")
        leave_digest(*matrix.getValuesCSR())

    return call


def read_structure() -> None:
    """Read and check ``part.h5``, the digest of what was read in ``figures.json``."""
    from fenics_ehd.reduction.structure import check_structure

    part = load_structure("part.h5", MPI.COMM_SELF)
    check_structure(part)
    bore = part.bore
    loads = [v.array for three in part.attachments.values() for v in three]
    leave_digest(
        *(a for m in (part.stiffness, part.mass, bore.load) for a in m.getValuesCSR()),
        *(part.coordinates, bore.nodes, bore.coordinates, bore.pressure_coordinates, *loads),
        np.array([bore.radius, bore.width]),
    )


def leave_digest(*arrays: np.ndarray) -> None:
    """Digest of arrays, as the answer of a call."""
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays))
    Path("figures.json").write_text(json.dumps({"digest": digest.hexdigest()}))


@dataclass(frozen=True)
class World:
    """Folder of the intact inputs, and the answers to them by name."""

    folder: Path
    answers: dict[str, dict[str, object]] = field(default_factory=dict)

    def copy(self, names: tuple[str, ...], target: Path) -> None:
        """Bring some inputs into another folder."""
        target.mkdir(parents=True)
        for name in names:
            source = self.folder / name
            copy = shutil.copytree if source.is_dir() else shutil.copyfile
            copy(source, target / name)


#: Which inputs each intact call needs, and the call.
CALLS: dict[str, tuple[tuple[str, ...], Callable[[], None]]] = {
    "run": (("scene.toml", "rod.h5", "gas.csv", "torque.csv"), command(*RUN)),
    "journal": (("journal.toml", "load.csv"), command(*JOURNAL_RUN)),
    "resume": (("out",), command(*RESUME)),
    "structure": (("part.h5",), read_structure),
    **{name: ((name,), read_matrix(name)) for name in ("k.dat", "k.mtx", "k.npz")},
}


def make_world(folder: Path) -> World:
    """Write the intact inputs and ask the program about each."""
    folder.mkdir(parents=True)
    for name, text in TABLES.items():
        (folder / name).write_text(text)
    write_scene(folder / "journal.toml", "loaded-journal", JOURNAL)
    # The load of the driver, in place of the tests' own.
    (folder / "load.csv").write_text(TABLES["load.csv"])
    scenes = {"scene.toml": SCENE, "long.toml": LONG_SCENE, "large.toml": LARGE_SCENE}
    for name, changes in scenes.items():
        write_scene(folder / name, "slider-crank-paper", changes)
    ehd.save_body(make_body(Joint()), folder / "rod.h5")
    part = structure("slider-crank-paper", "rod", MPI.COMM_SELF, {"bodies.rod.geometry": COARSE})
    save_structure(part, folder / "part.h5")
    write_matrices(folder)
    world = World(folder)
    stop_a_run(world)
    for name, (needed, call) in CALLS.items():
        target = folder / "intact" / name
        world.copy(needed, target)
        outcome = attempt(call, target, 300)
        if outcome.status:
            raise SystemExit(f"the intact {name} fails: {outcome.stderr}")
        world.answers[name] = figures(target, outcome)
    return world


def write_matrices(folder: Path) -> None:
    """A stiffness of twelve nodes as three kinds of file."""
    random = np.random.default_rng(2)
    part = sparse.random(36, 36, 0.2, "csr", random_state=2)
    matrix = sparse.csr_matrix(part @ part.T + sparse.diags(random.uniform(1, 2, 36)))
    sparse.save_npz(folder / "k.npz", matrix)
    io.mmwrite(folder / "k.mtx", matrix)
    petsc = PETSc.Mat().createAIJ(
        matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data), comm=PETSc.COMM_SELF
    )
    viewer = PETSc.Viewer().createBinary(str(folder / "k.dat"), "w", PETSc.COMM_SELF)
    petsc.view(viewer)
    viewer.destroy()


def rows_in(folder: Path) -> int:
    """Lines of the history that a run writes, wherever in its folder that is."""
    found = list(folder.rglob("history.csv"))
    return found[0].read_bytes().count(b"\n") if found else 0


def stop_a_run(world: World, rows: int = 100) -> None:
    """Leave in ``out`` what a killed run of the long scene leaves."""
    run = ("run", "long.toml", "--no-plots", "--checkpoint-every", "0")
    began = time.monotonic()
    process = launch(command(*run, "-o", "out"), world.folder, 300)
    while rows_in(world.folder / "out") < rows:
        time.sleep(1e-3)
        if time.monotonic() - began > 120:
            raise SystemExit("the run to be stopped writes no history")
    os.kill(process, signal.SIGKILL)
    finish(process, world.folder, began)
