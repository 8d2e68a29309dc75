"""Results that several test modules read, made once for all processes of a test session.

Processes of pytest-xdist share a folder of the session. The first one that needs a result makes it
under a lock; the others wait and read it. Results are read-only.
"""

import fcntl
import os
import shutil


def shared_results(tmp_path_factory):
    """Function (name, make) that returns the folder of a result; `make` fills it once a session."""
    base = tmp_path_factory.getbasetemp()
    root = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shared"
    root.mkdir(exist_ok=True)

    def folder_of(name, make):
        folder = root / name
        finished = root / f"{name}.finished"
        with open(root / f"{name}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not finished.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                make(folder)
                finished.touch()
        return folder

    return folder_of
