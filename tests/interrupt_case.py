"""Ctrl-C in the middle of a run from the command line."""

import json
import signal
import subprocess
import time

from fenics_ehd.output import read_history


def heed_interrupt():
    """For a new process: a shell's background job, as a test run may be, ignores SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupted_run(command, directory, seconds=240):
    """Start a run, interrupt it after 20 steps; what it leaves behind is checked, then returned.

    Returns the columns of its history.
    """
    process = subprocess.Popen(
        [*command, "-o", str(directory)],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupt,
    )
    history = directory / "history.csv"
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if history.exists() and history.read_text().count("\n") > 20:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    stderr = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert "Traceback" not in stderr
    summary = json.loads((directory / "summary.json").read_text())
    assert summary["status"] == "interrupted"
    columns = read_history(directory)
    assert len(columns["time_s"]) == summary["steps"] >= 20
    return columns
