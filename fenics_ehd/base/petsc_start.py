"""Start of PETSc at import; this module must be imported before PETSc or dolfinx.

PETSc would read ``~/.petscrc`` and ``.petscrc`` in the current folder, whose options may be meant
for another program and change results. Options in ``PETSC_OPTIONS``, and options of a script that
starts PETSc itself, are effective.

petsc4py would read ``petsc.cfg`` in the current folder, which may name another folder for the
library to be loaded. dolfinx from 0.9 on makes petsc4py read the file again at its own import.

PETSc would also handle SIGTERM and SIGHUP itself, print pages, and end the program at once.
"""

import os

import petsc4py
from mpi4py import MPI

from fenics_ehd.base.processes import in_neutral_folder

# First among the options, so that options of the user come later and override it.
os.environ["PETSC_OPTIONS"] = f"-no_signal_handler {os.environ.get('PETSC_OPTIONS', '')}"
with in_neutral_folder():
    petsc4py.init(["fenics-ehd", "-skip_petscrc"], comm=MPI.COMM_WORLD)
# The decorator enters the neutral folder at every call.
petsc4py.lib.getPathArchPETSc = in_neutral_folder()(petsc4py.lib.getPathArchPETSc)
