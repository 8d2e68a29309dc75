"""Surroundings of a command, settled before any library is imported.

A command gives the same results in every folder: files that lie there and that the user has not
named are neither run nor obeyed. Only commands call this. A program that imports the package, a
notebook say, keeps its own surroundings; `matplotlib_start` and `compat` have the rest.

Every import here, and in the package's own ``__init__`` before this module, is of a module that
Python has built in or frozen: another one could come from the current folder.
"""

import os
import sys

#: Names the file of matplotlib's options; that of no options is the null device.
MATPLOTLIB_OPTIONS = "MATPLOTLIBRC"


def leave_current_folder() -> None:
    """Search no module in the current folder, which ``python -m`` puts first in `sys.path`.

    A folder that holds this very package goes to the end.
    """
    if sys.flags.safe_path or not sys.path:
        return
    folder = sys.path.pop(0)
    if os.path.isdir(os.path.join(folder, __name__.partition(".")[0])):
        sys.path.append(folder)


def start_command() -> None:
    """Set the variables that libraries and child processes read.

    Python's children do not search modules in the current folder. Matplotlib has its defaults.
    Open MPI starts no daemon for a process on its own, which needs files, a path, and a disk that
    is not full; a process so started cannot spawn others by MPI, and ranks have their daemon.
    """
    from fenics_ehd.base.processes import THREADS, is_rank

    os.environ["PYTHONSAFEPATH"] = "1"
    os.environ[MATPLOTLIB_OPTIONS] = os.devnull
    if not is_rank():
        os.environ.setdefault("OMPI_MCA_ess_singleton_isolated", "1")
    for variable in THREADS:
        os.environ.setdefault(variable, "1")
