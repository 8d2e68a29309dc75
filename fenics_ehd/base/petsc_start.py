"""Initialisation of PETSc at import; this module must be imported before PETSc or dolfinx.

PETSc does not read ``.petscrc`` in the home and current folders, whose options may be meant for
another program and would change results. Options in ``PETSC_OPTIONS``, and those of a script that
initialises PETSc itself, are effective.

petsc4py does not read ``petsc.cfg`` in the current folder, which may name another folder from which
the library is loaded. dolfinx from 0.9 on would make petsc4py read this file again.

PETSc does not handle SIGTERM and SIGHUP: it would print pages and end the program at once.

All ranks initialise PETSc together, except workers of an ``MPIPoolExecutor``: each rank of
``mpi4py.futures`` imports this module with its first task, and the ranks would wait for each other.
"""

import os
import sys

import petsc4py
from mpi4py import MPI

from fenics_ehd.base.processes import in_neutral_folder

# Options of the user come later and therefore override this one.
os.environ["PETSC_OPTIONS"] = f"-no_signal_handler {os.environ.get('PETSC_OPTIONS', '')}"
comm = MPI.COMM_SELF if "mpi4py.futures" in sys.modules else MPI.COMM_WORLD
with in_neutral_folder():
    petsc4py.init(["fenics-ehd", "-skip_petscrc"], comm=comm)
# The function changes to a neutral folder at every call.
petsc4py.lib.getPathArchPETSc = in_neutral_folder()(petsc4py.lib.getPathArchPETSc)
