"""Short scenes to sweep, and sweeps in this process or another one."""

import csv
import subprocess
import sys
from concurrent.futures import Future

import pytest

from fenics_ehd.cli import main
from fenics_ehd.sweeps.sweep import run_sweep
from fenics_ehd.sweeps.table import SweepTable
from fenics_ehd.sweeps.work import CaseTask

COMMAND = [sys.executable, "-m", "fenics_ehd.cli"]

SLIDER_CRANK = """
scene = "slider-crank"
[mechanism]
revolutions = 0.002
[reduction]
method = "rigid"
estimate_error = false
[time]
tolerance = 1e-3
"""
ROTOR = """
scene = "rotor"
[shaft]
revolutions = 0.002
[reduction]
method = "rigid"
estimate_error = false
[time]
tolerance = 1e-3
"""
LOADED_JOURNAL = """
scene = "loaded-journal"
[load]
file = "load.csv"
[film]
cells = [12, 2]
[time]
tolerance = 1e-3
largest_step = 0.1
periodicity = 1e-3
"""
LOAD_FILE = "time_ms,Fx_N,Fy_N\n0,500,900\n5,0,500\n10,-500,900\n15,0,1200\n20,500,900\n"

#: Cases 1 and 3 can run; a clearance is not thin, a smallest step too long.
SOME_FAIL = ("clearance=14e-6,17e-6,2e-3", "smallest_step=1e-13,1e-5")
#: Enough cases to be stopped in the middle of them.
MANY = "clearance=10e-6:30e-6:8"


class Inline:
    """A pool that does everything in this process, and remembers what it was given."""

    width = 1

    def __init__(self):
        self.tasks = []

    def submit(self, function, task):
        self.tasks.append(task)
        future = Future()
        future.set_result(function(task))
        return future

    @property
    def cases(self):
        return [task.case.number for task in self.tasks if isinstance(task, CaseTask)]


def write_scene(directory, text=SLIDER_CRANK):
    (directory / "load.csv").write_text(LOAD_FILE)
    path = directory / "short.toml"
    path.write_text(text)
    return str(path)


def given_values(assignments):
    return [word for assignment in assignments for word in ("--set", assignment)]


def call(*arguments, **options):
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=120, **options
    )


def exit_of(capfd, *arguments):
    """Status, output and error output of the command, in this process."""
    with pytest.raises(SystemExit) as end:
        main([*map(str, arguments)])
    return end.value.code, *capfd.readouterr()


def rows_of(directory):
    with open(directory / "sweep.csv", newline="") as file:
        return list(csv.DictReader(file))


def results(rows):
    """Rows by case, without the times they took."""
    timed = ("reduction_time_s", "wall_time_s")
    return {row["case"]: {k: v for k, v in row.items() if k not in timed} for row in rows}


def sweep_inline(plan, directory, **options):
    pool = Inline()
    with SweepTable(directory, plan) as table:
        run_sweep(plan, table, pool, **options)
        return pool, table.rows()
