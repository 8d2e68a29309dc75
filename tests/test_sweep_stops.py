"""Sweeps that end before their end."""

import multiprocessing
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from command_line import program as call
from command_line import start
from sweep_cases import MANY, rows_of, write_scene

from fenics_ehd.study.pool import ProcessPool, Tasks


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(tmp_path_factory.mktemp("scene"))


def process_of(number):
    """This process, which ends with task 8."""
    if number == 8:
        os._exit(1)
    time.sleep(0.2)
    return os.getpid()


def test_processes_serve_one_task_after_the_other_and_one_that_dies_costs_its_own_task_only():
    with ProcessPool(2) as pool:
        answers = dict(Tasks(pool, process_of, lambda: None).outcomes(range(8)))
        processes = {process.pid for process in multiprocessing.active_children()}
        assert sorted(answers) == list(range(8))
        assert set(answers.values()) == processes
        assert len(processes) == 2
        answers = dict(Tasks(pool, process_of, lambda: None).outcomes(range(5, 11)))
    assert answers.pop(8).status.startswith("failed: WorkerDiedError")
    assert sorted(answers) == [5, 6, 7, 9, 10]
    assert all(isinstance(number, int) for number in answers.values())
    assert not multiprocessing.active_children()


def wait_until(condition, seconds=60):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def children(process):
    """Processes started by this one."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            _, _, rest = path.read_text().rpartition(")")
        except OSError:
            continue
        if int(rest.split()[1]) == process.pid:
            found.append(int(path.parent.name))
    return found


def stopped(process, directory, rows, number):
    """Send a signal once there are so many rows; error output and rows when all processes ended."""
    path = directory / "sweep.csv"
    wait_until(lambda: path.is_file() and path.read_text().count("\n") > rows)
    workers = children(process)
    assert workers
    process.send_signal(number)
    errors = process.communicate(timeout=30)[1]
    wait_until(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers), 15)
    return errors, rows_of(directory)


@pytest.mark.slow
def test_stopped_sweep_keeps_its_rows_and_is_completed(scene, tmp_path):
    command = ["sweep", scene, "--set", MANY, "-o", tmp_path, "--workers", 1]
    interrupted = start(command, stderr=subprocess.PIPE, text=True)
    errors, first = stopped(interrupted, tmp_path, 2, signal.SIGINT)
    assert interrupted.returncode == 130
    assert "Traceback" not in errors
    assert errors.splitlines()[-1] == "fenics-ehd: interrupted"
    killed = start(command, stderr=subprocess.PIPE)
    _, second = stopped(killed, tmp_path, len(first) + 2, signal.SIGKILL)
    assert killed.returncode == -signal.SIGKILL
    assert second[: len(first)] == first
    assert len(first) >= 2
    assert len(first) + 2 <= len(second) < 80
    result = call(*command, "--resume")
    assert result.returncode == 0, result.stderr
    rows = rows_of(tmp_path)
    assert rows[: len(second)] == second
    assert sorted(int(row["case"]) for row in rows) == list(range(1, 81))
    assert {row["status"] for row in rows} == {"complete"}
