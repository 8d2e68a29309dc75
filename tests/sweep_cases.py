"""Short scenes to sweep, and sweeps in this process or another one."""

import csv
import pickle
from concurrent.futures import Executor, Future

import scene_cases
from scene_cases import LOAD, tables_of, toml

from fenics_ehd.scenes.scene import as_stored, scene_text
from fenics_ehd.study.cases import with_values
from fenics_ehd.study.plan import FILM, values_in
from fenics_ehd.study.sweep import SweepFolder, run_sweep
from fenics_ehd.study.worker import CaseTask


def scene_as(name, values):
    """Text of a shipped scene with other values, those of reductions in all of its parts."""
    scene = as_stored(name)
    return scene_text(with_values(scene, values_in(scene, values)))


#: First steps of shipped scenes, their parts rigid.
RIGID = {"reduction.method": "rigid", "reduction.estimate_error": False, "time.tolerance": 1e-3}
SLIDER_CRANK = scene_as("slider-crank-paper", {**RIGID, "time.revolutions": 0.002})
#: Two films on one crank.
ENGINE = scene_as("engine", {**RIGID, "time.periodic": False, "time.revolutions": 0.002, FILM: 0.5})
LOADED_JOURNAL = toml(tables_of("loaded-journal", scene_cases.LOADED_JOURNAL))

#: Cases 1 and 3 can run; a clearance is not thin, a film soon thinner than it may be.
SOME_FAIL = ("clearance=14e-6,17e-6,3e-3", "smallest_film=0.01,0.9999")
#: Enough cases to be stopped in the middle of them.
MANY = "clearance=10e-6:30e-6:80"


class Inline(Executor):
    """A pool that does everything in this process, and remembers what it was given."""

    width = 1

    def __init__(self):
        self.tasks = []

    def submit(self, function, letter):
        self.tasks.append(pickle.loads(letter)[1])
        future = Future()
        future.set_result(function(letter))
        return future

    @property
    def cases(self):
        return [task.case.name for task in self.tasks if isinstance(task, CaseTask)]


def write_scene(directory, text=SLIDER_CRANK):
    (directory / "load.csv").write_text(LOAD)
    path = directory / "short.toml"
    path.write_text(text)
    return str(path)


def given_values(assignments):
    return [word for assignment in assignments for word in ("--set", assignment)]


def rows_of(directory):
    with open(directory / "sweep.csv", newline="") as file:
        return list(csv.DictReader(file))


def results(rows):
    """Rows by case, without the times they took."""
    timed = ("reduction_time_s", "wall_time_s")
    return {row["case"]: {k: v for k, v in row.items() if k not in timed} for row in rows}


def sweep_inline(sweep, directory, **options):
    pool = Inline()
    with SweepFolder(directory, sweep) as folder:
        return pool, run_sweep(folder, pool, **options)
