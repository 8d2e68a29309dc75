"""Results of a test session are made once, by the first process that needs them."""

import multiprocessing
import time

import pytest


def write(folder):
    time.sleep(0.05)
    with open(folder.parent / "calls", "a") as file:
        file.write("call\n")
    (folder / "result").write_text("42")


def test_a_result_is_made_once(shared):
    folders = [shared("test-once", write) for _ in range(2)]
    assert folders[0] == folders[1]
    assert (folders[0] / "result").read_text() == "42"
    assert (folders[0].parent / "calls").read_text() == "call\n"


def test_processes_wait_for_each_other(shared):
    fork = multiprocessing.get_context("fork")
    processes = [fork.Process(target=shared, args=("test-wait", write_other)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0, 0, 0]


def write_other(folder):
    # A second call would fail, as the folder is not empty.
    time.sleep(0.05)
    (folder / "result").touch(exist_ok=False)


def test_a_result_that_fails_is_not_kept(shared):
    def fail(folder):
        raise OSError("no space left")

    with pytest.raises(OSError, match="no space"):
        shared("test-fail", fail)
    assert not (shared("test-once", write).parent / "test-fail.finished").exists()
