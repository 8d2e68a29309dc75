"""Sweeps and studies on executors that this program did not make."""

import multiprocessing
import os
import pickle
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor

import pytest
from study_cases import COARSE
from sweep_cases import Inline, results, rows_of, scene_as, write_scene

from fenics_ehd.base.processes import _thread_functions, one_blas_thread
from fenics_ehd.study.pool import ProcessPool, Tasks
from fenics_ehd.study.sweep import SweepFolder, make_sweep, run_sweep
from fenics_ehd.study.worker import CaseTask, _body

SHORT = {"time.revolutions": 0.002, "time.tolerance": 1e-3, "reduction.estimate_error": False}
CLEARANCES = ["clearance=14e-6,17e-6"]


class Elsewhere(Executor):
    """Another machine: tasks and results travel as bytes, and the caller's folder is not there."""

    def __init__(self, folder):
        self.folder = folder
        self.tasks = []

    def submit(self, function, /, *arguments):
        self.tasks.append(pickle.loads(arguments[0])[1])
        letter = pickle.dumps((function, arguments))
        hidden = self.folder.with_name("hidden")
        self.folder.rename(hidden)
        try:
            unpickled, values = pickle.loads(letter)
            answer = pickle.dumps(unpickled(*values))
        finally:
            hidden.rename(self.folder)
        future = Future()
        future.set_result(pickle.loads(answer))
        return future


def sweep_on(directory, scene, executor, *, keep=False):
    with SweepFolder(directory, make_sweep(scene, CLEARANCES)) as folder:
        return run_sweep(folder, executor or Inline(), keep=keep)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """An elastic rod over a few steps."""
    values = {**SHORT, **COARSE, "reduction.method": "m1", "reduction.modes": 10}
    text = scene_as("slider-crank-paper", values)
    return write_scene(tmp_path_factory.mktemp("scene"), text)


@pytest.fixture(scope="module")
def local(scene, tmp_path_factory):
    """Folder of the sweep on this process."""
    directory = tmp_path_factory.mktemp("local")
    sweep_on(directory, scene, None, keep=True)
    return directory


def test_cases_travel_with_their_bodies_and_their_files_return(scene, local, tmp_path):
    directory = tmp_path / "swept"
    executor = Elsewhere(directory)
    _body.cache_clear()
    sweep_on(directory, scene, executor, keep=True)
    assert results(rows_of(directory)) == results(rows_of(local))
    cases = [task for task in executor.tasks if isinstance(task, CaseTask)]
    bodies = [body.content for task in cases for body in task.bodies.values()]
    # The other machine is sent the bytes of the body once.
    assert sum(content is not None for content in bodies) == 1
    for case in ("0001", "0002"):
        names = {path.name for path in (local / "runs" / case).iterdir()}
        assert {path.name for path in (directory / "runs" / case).iterdir()} == names
        history = (directory / "runs" / case / "history.csv").read_bytes()
        assert history == (local / "runs" / case / "history.csv").read_bytes()


def test_threads_run_one_case_at_a_time(scene, local, tmp_path):
    with ThreadPoolExecutor(2) as executor:
        sweep_on(tmp_path / "swept", scene, executor)
    assert results(rows_of(tmp_path / "swept")) == results(rows_of(local))


@pytest.mark.slow
def test_processes_of_the_standard_library(scene, local, tmp_path):
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as executor:
        sweep_on(tmp_path / "swept", scene, executor)
    assert results(rows_of(tmp_path / "swept")) == results(rows_of(local))


def raised(number):
    if number == 1:
        raise ValueError("one\nof them")
    return number


def killed(number):
    if number == 1:
        os._exit(1)
    return number


@pytest.mark.parametrize("make", [ThreadPoolExecutor, ProcessPool])
def test_an_error_is_the_outcome_of_its_task(make):
    with make(1) as executor:
        answers = dict(Tasks(executor, raised, lambda: None).outcomes(range(3)))
    assert answers.pop(1).status == "failed: ValueError: one of them"
    assert answers == {0: 0, 2: 2}


def test_a_broken_executor_fails_its_tasks_and_ends():
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor:
        answers = dict(Tasks(executor, killed, lambda: None).outcomes([1, 2]))
    assert answers[1].status.startswith("failed: WorkerDiedError")


def test_one_thread_of_the_blas_and_the_former_number_afterwards():
    functions = _thread_functions()
    if not functions:
        pytest.skip("no OpenBLAS here")
    former = [read() for _, read in functions]
    with one_blas_thread():
        assert {read() for _, read in functions} == {1}
    assert [read() for _, read in functions] == former
