"""C compiler of forms: suppressed output, and a message of one line if a compilation fails.

A compilation needs a C compiler, the headers of the C library and those of Python. Linux systems
have packages with all three, which are often not installed.
"""

from __future__ import annotations

import logging
import os
import shlex
import shutil
import sys
import sysconfig
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

from fenics_ehd.base.errors import CompilationError

#: Version of this Python as in the names of system packages, which have its headers.
_PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"

#: Commands that install what a compilation needs.
INSTALL = (
    f"apt-get install gcc libc6-dev {_PYTHON}-dev (Debian, Ubuntu), or "
    f"dnf install gcc {_PYTHON}-devel (Fedora, RHEL)"
)

#: Largest number of characters of the compiler's error in a message.
LONGEST = 300


@contextmanager
def quiet_compiler() -> Iterator[None]:
    """Suppress the log of the C compiler; restore logging and warnings afterwards.

    Setuptools runs the compiler. It also adds a handler to the root logger, sets its level, and
    redirects Python's warnings to it.
    """
    root = logging.getLogger()
    handlers = list(root.handlers)
    level = root.level
    disabled = root.manager.disable
    shown = warnings.showwarning
    logging.disable(max(disabled, logging.INFO))
    try:
        yield
    finally:
        logging.disable(disabled)
        if warnings.showwarning is not shown:
            logging.captureWarnings(False)
        root.handlers[:] = handlers
        root.setLevel(level)


@contextmanager
def compiler_errors(folder: Path) -> Iterator[None]:
    """Collect the error output of the C compiler, and report a failed compilation in one line.

    Parameters
    ----------
    folder
        Path of the folder with the compiled forms, for the message.

    Raises
    ------
    CompilationError
        If the compiler fails. The message names what is missing, or the compiler's first error.
    """
    with TemporaryFile(dir=folder) as output:
        try:
            with _standard_error_to(output):
                yield
        except Exception as error:
            if type(error).__module__.partition(".")[0] not in ("cffi", "distutils", "setuptools"):
                raise
            output.seek(0)
            text = output.read().decode(errors="replace")
            raise CompilationError(_failure(f"{text}\n{error}", folder)) from error


@contextmanager
def _standard_error_to(file: IO[bytes]) -> Iterator[None]:
    """Redirect the standard error output of this process and of its children to a file."""
    try:
        kept = os.dup(2)
    except OSError:  # the standard error output is closed
        yield
        return
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.flush()
    os.dup2(file.fileno(), 2)
    try:
        yield
    finally:
        with suppress(OSError, ValueError, AttributeError):
            sys.stderr.flush()
        os.dup2(kept, 2)
        os.close(kept)


def _failure(output: str, folder: Path) -> str:
    """Reason for a failed compilation, in one line; `output` ends with the error of setuptools."""
    missing = missing_parts()
    if missing:
        return f"forms cannot be compiled without {' and '.join(missing)}: {INSTALL}"
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    error = next((line for line in lines if "error:" in line), lines[-1])[:LONGEST]
    remedy = f": {INSTALL}" if ".h: No such file" in error else ""
    return f"forms are compiled by {' '.join(_compiler())} and stored in {folder}: {error}{remedy}"


def missing_parts() -> list[str]:
    """C compiler and Python headers, as far as they are missing, for messages."""
    parts = []
    compiler = _compiler()[0]
    if shutil.which(compiler) is None:
        parts.append(f"a C compiler ({compiler})")
    folders = dict.fromkeys(sysconfig.get_path(name) for name in ("include", "platinclude"))
    if not any(Path(folder, "Python.h").exists() for folder in folders):
        parts.append(f"the headers of Python ({next(iter(folders))}/Python.h)")
    return parts


def _compiler() -> list[str]:
    """Command of the C compiler with its options, as setuptools finds it."""
    return shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc") or ["cc"]
