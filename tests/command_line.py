"""The command line as tests use it: in this process, or in one of its own that may be stopped."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import fenics_ehd as ehd
from fenics_ehd.cli.main import main

COMMAND = [sys.executable, "-m", "fenics_ehd.cli"]

#: Entries of a summary that depend on the machine or on imports of a process. Checksums of inputs
#: do, because the file of a body has the time of its reduction.
OF_THE_MACHINE = {
    "inputs",
    "wall_time_s",
    "processor_time_s",
    "error_budget_processor_time_s",
    "reduction_time_s",
    "versions",
}


def call(*arguments):
    """Exit status of the command, in this process, which keeps its environment."""
    environment = dict(os.environ)
    try:
        with pytest.raises(SystemExit) as caught:
            main([str(a) for a in arguments])
    finally:
        os.environ.clear()
        os.environ.update(environment)
    return caught.value.code


def exit_of(capfd, *arguments):
    """Status, output and error output of the command, in this process."""
    return call(*arguments), *capfd.readouterr()


def program(*arguments, **options):
    """The command in a process of its own, to its end."""
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=300, **options
    )


def rows_in(folder):
    """Lines in the history of the run that works in a folder, or was killed there."""
    history = folder / "history.csv"
    return history.read_bytes().count(b"\n") if history.exists() else 0


def heed_interrupt():
    """For a new process: a shell's background job, as a test run may be, ignores SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(arguments, **streams):
    """The command in a process of its own, started; without streams its output is discarded."""
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        preexec_fn=heed_interrupt,
        **{"stderr": subprocess.DEVNULL, "stdout": subprocess.DEVNULL} | streams,
    )


def stop_after(process, folder, rows, how):
    """Send a signal as soon as the history has so many rows; returns the exit status."""
    deadline = time.monotonic() + 120
    while rows_in(folder) < rows and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(1e-3)
    assert process.poll() is None, f"the run was over before the signal: {process.returncode}"
    process.send_signal(how)
    return process.wait(timeout=60)


def assert_same_results(one, other):
    """Two folders hold the same run, to the last bit."""
    assert (one / "history.csv").read_bytes() == (other / "history.csv").read_bytes()
    ours, expected = ehd.load_results(one), ehd.load_results(other)
    for name in ("time", "coordinates", "rates", "quasi_static"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(expected, name))
    for name, joint in ours.joints.items():
        for field in ("pressure", "gap"):
            fields = (getattr(found.film, field) for found in (joint, expected.joints[name]))
            np.testing.assert_array_equal(*fields)
    assert ours.columns.keys() == expected.columns.keys()
    for name, values in ours.columns.items():
        np.testing.assert_array_equal(values, expected.columns[name])
    ours, expected = (json.loads((f / "summary.json").read_text()) for f in (one, other))
    for key in set(expected) - OF_THE_MACHINE:
        assert ours[key] == expected[key], key


def killed_again_and_again(folder, command, resume, moments):
    """Kill a run at these rows, again after each resume, and let it end at last.

    Yields the folder after each kill.
    """
    process = start(command)
    for rows in moments:
        assert stop_after(process, folder, rows, signal.SIGKILL) == -signal.SIGKILL
        yield folder
        process = start(resume)
    assert process.wait(timeout=120) == 0
