"""Environment of a command, set before any library is imported.

A command gives the same results in every folder: files in the current folder are neither executed
nor read unless the user names them. Only commands use this module. A program that imports the
package, such as a notebook, keeps its environment; see also `matplotlib_start` and `compat`.

This module and the package's ``__init__``, which runs before it, import only modules that are built
into Python or frozen. Other modules might be read from the current folder.

Imports inside functions: `processes` imports modules that are not frozen. `processes` is therefore
imported only after the current folder has been removed from the module path.
"""

import os
import sys

#: Environment variable with the path of matplotlib's options; the null device means no options.
MATPLOTLIB_OPTIONS = "MATPLOTLIBRC"


def leave_current_folder() -> None:
    """Remove the current folder from the head of `sys.path`, where ``python -m`` puts it.

    If the current folder contains this package, the folder is moved to the end of `sys.path`.
    """
    if sys.flags.safe_path or not sys.path:
        return
    folder = sys.path.pop(0)
    if os.path.isdir(os.path.join(folder, __name__.partition(".")[0])):
        sys.path.append(folder)


def start_command() -> None:
    """Set environment variables for libraries and child processes.

    Child processes do not search the current folder for modules. Matplotlib uses its defaults.
    Libraries use one BLAS thread unless the user has set a number of threads.

    For a single process, Open MPI does not start its daemon, which would need files in a temporary
    folder and free space on a disk. MPICH does not open network cards and shared memory. Such a
    process cannot spawn other processes by MPI. Ranks are started by their launcher.
    """
    from fenics_ehd.base.processes import ALONE, THREADS, is_rank

    os.environ["PYTHONSAFEPATH"] = "1"
    os.environ[MATPLOTLIB_OPTIONS] = os.devnull
    if not is_rank():
        for variable, value in ALONE.items():
            os.environ.setdefault(variable, value)
    for variable in THREADS:
        os.environ.setdefault(variable, "1")
