"""Ctrl-C, or another signal, in the middle of a run from the command line."""

import json
import signal
import subprocess
import time

from csv_history import read_history


def rows_in(folder):
    """Lines in the history of the run that works in a folder, or was killed there."""
    history = folder / "history.csv"
    return history.read_bytes().count(b"\n") if history.exists() else 0


def heed_interrupt():
    """For a new process: a shell's background job, as a test run may be, ignores SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupted_run(command, directory, seconds=240, how=signal.SIGINT):
    """Start a run, end it after 20 steps; what it leaves behind is checked, then returned.

    Returns the columns of its history.
    """
    process = subprocess.Popen(
        [*command, "-o", str(directory)],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupt,
    )
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if rows_in(directory) > 20:
            break
        time.sleep(0.05)
    process.send_signal(how)
    stderr = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert "Traceback" not in stderr
    assert "PETSC" not in stderr
    assert stderr.splitlines()[-1] == "fenics-ehd: interrupted"
    summary = json.loads((directory / "summary.json").read_text())
    assert summary["status"] == "interrupted"
    columns = read_history(directory)
    assert len(columns["time_s"]) == summary["steps"] >= 20
    return columns
