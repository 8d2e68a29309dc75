"""Sweeps on the workers of a Dask scheduler, and on ranks of MPI."""

import signal
import socket
import subprocess
import sys

import pytest
from command_line import call, exit_of
from sweep_cases import RIGID, results, rows_of, scene_as, sweep_inline, write_scene

from fenics_ehd.base.processes import for_mpirun, mpirun
from fenics_ehd.study.plan import FILM
from fenics_ehd.study.sweep import SweepFolder, make_sweep

WITHOUT = "Debian's python3-distributed is missing: debian-packages-tests.txt"
#: More cases than two workers have at the same time, so that a worker is killed before the last.
MANY = "clearance=14e-6:20e-6:6"

#: Time that scheduler and workers have to start on a machine that is busy [s].
PATIENCE = 180

SCRIPT = """
import sys
import fenics_ehd as ehd
from mpi4py.futures import MPIPoolExecutor

if __name__ == "__main__":
    scene, folder = sys.argv[1:]
    with MPIPoolExecutor() as executor:
        ehd.sweep(scene, {"clearance": "14e-6:20e-6:6"}, executor=executor, folder=folder)
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    values = {**RIGID, "time.revolutions": 0.001, FILM: 0.5}
    return write_scene(tmp_path_factory.mktemp("scene"), scene_as("slider-crank-paper", values))


@pytest.fixture(scope="module")
def local(scene, tmp_path_factory):
    """Rows of the sweep in this process."""
    directory = tmp_path_factory.mktemp("local")
    sweep_inline(make_sweep(scene, [MANY]), directory)
    return results(rows_of(directory))


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


@pytest.fixture
def scheduler():
    """Address of a scheduler, and its two workers."""
    distributed = pytest.importorskip("distributed", reason=WITHOUT)
    address = f"tcp://127.0.0.1:{free_port()}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    module = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
    host, port = address.removeprefix("tcp://").split(":")
    processes = [subprocess.Popen([*module, "--host", host, "--port", port], **quiet)]
    module = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1"]
    workers = [
        subprocess.Popen([*module, "--no-nanny", "--no-dashboard"], **quiet) for _ in range(2)
    ]
    processes += workers
    try:
        with distributed.Client(address, timeout=PATIENCE) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
        yield address, workers
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_a_worker_that_is_killed_costs_no_row(scene, scheduler, local, tmp_path, monkeypatch):
    address, workers = scheduler
    add = SweepFolder.add

    def kill_after_first_row(folder, case, result):
        add(folder, case, result)
        workers[0].send_signal(signal.SIGKILL)

    monkeypatch.setattr(SweepFolder, "add", kill_after_first_row)
    monkeypatch.setattr("fenics_ehd.study.scheduler.PATIENCE", PATIENCE)
    assert call("sweep", scene, "--set", MANY, "-o", tmp_path, "--scheduler", address) == 0
    assert workers[0].wait(timeout=PATIENCE) == -signal.SIGKILL
    assert results(rows_of(tmp_path)) == local


def test_a_scheduler_that_does_not_answer_is_named(scene, tmp_path, capfd, monkeypatch):
    pytest.importorskip("distributed", reason=WITHOUT)
    monkeypatch.setattr("fenics_ehd.study.scheduler.PATIENCE", 1.0)
    address = f"tcp://127.0.0.1:{free_port()}"
    arguments = ("--set", "clearance=1e-5", "-o", tmp_path, "--scheduler", address)
    status, _, errors = exit_of(capfd, "sweep", scene, *arguments)
    assert status == 2
    assert f"--scheduler {address}: no scheduler answers" in errors
    assert len(errors.strip().splitlines()) == 1


def test_a_missing_library_is_named(scene, tmp_path, capfd, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    arguments = ("--set", "clearance=1e-5", "-o", tmp_path, "--scheduler", "local:2")
    status, _, errors = exit_of(capfd, "sweep", scene, *arguments)
    assert status == 2
    assert "apt install python3-distributed" in errors
    assert len(errors.strip().splitlines()) == 1


@pytest.mark.skipif(mpirun() is None, reason="no mpirun here")
def test_ranks_of_mpi_find_the_same_rows(scene, local, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    command = [mpirun(), "-n", "3", sys.executable, "-m", "mpi4py.futures", script, scene]
    done = subprocess.run(
        [*map(str, command), str(tmp_path / "out")],
        env=for_mpirun() | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    assert results(rows_of(tmp_path / "out")) == local
