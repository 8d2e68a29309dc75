"""Environment of a command, set before any library is imported.

A command gives the same results in every folder: files of the current folder that the user has not
named are neither executed nor read. Only commands call this module. A program that imports the
package, a notebook for instance, keeps its environment; see also `matplotlib_start` and `compat`.

This module, and the package's ``__init__`` before it, import only modules that are built into
Python or frozen: another module could be read from the current folder.

Imports inside functions: `processes` imports modules that are not frozen, and is imported once the
current folder has left the module path.
"""

import os
import sys

#: Variable with the path of matplotlib's options; the null device means none.
MATPLOTLIB_OPTIONS = "MATPLOTLIBRC"


def leave_current_folder() -> None:
    """Remove the current folder from the head of `sys.path`, where ``python -m`` puts it.

    A folder that has this package is appended at the end.
    """
    if sys.flags.safe_path or not sys.path:
        return
    folder = sys.path.pop(0)
    if os.path.isdir(os.path.join(folder, __name__.partition(".")[0])):
        sys.path.append(folder)


def start_command() -> None:
    """Set environment variables for libraries and child processes.

    Child processes do not search the current folder for modules. Matplotlib has its defaults. Open
    MPI starts no daemon for a single process: the daemon needs files, a path, and a disk that is
    not full. Such a process cannot spawn others by MPI. Ranks have their daemon.
    """
    from fenics_ehd.base.processes import THREADS, is_rank

    os.environ["PYTHONSAFEPATH"] = "1"
    os.environ[MATPLOTLIB_OPTIONS] = os.devnull
    if not is_rank():
        os.environ.setdefault("OMPI_MCA_ess_singleton_isolated", "1")
    for variable in THREADS:
        os.environ.setdefault(variable, "1")
