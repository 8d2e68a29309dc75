"""A call in a process of its own: what a library leaves behind there, or ends, stays there."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

T = TypeVar("T")

#: What the other process does. Modules are found as here, and none beside the user's files.
_CALL = """
import pathlib, pickle, sys
sys.path = pickle.load(sys.stdin.buffer)
try:
    function, arguments = pickle.load(sys.stdin.buffer)
    answer = True, function(*arguments)
except Exception as error:
    answer = False, error
pathlib.Path(sys.argv[1]).write_bytes(pickle.dumps(answer))
"""


def in_child(function: Callable[..., T], *arguments: Any, lost: Exception) -> T:
    """Result of a module's function, called in another Python; what it prints goes nowhere.

    Parameters
    ----------
    function
        Of a module that does not start MPI.
    arguments
        Like its result, of types that pickle knows.
    lost
        Raised where the other process ends without an answer.
    """
    asked = pickle.dumps(sys.path) + pickle.dumps((function, arguments))
    with TemporaryDirectory() as folder:
        answer = Path(folder, "answer")
        subprocess.run(
            [sys.executable, "-P", "-c", _CALL, str(answer)],
            input=asked,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
        )
        if not answer.is_file():
            raise lost
        good, found = pickle.loads(answer.read_bytes())
    if not good:
        raise found
    return found
