"""Start of PETSc, at import; it must be imported before anything else imports PETSc or dolfinx.

PETSc would read ``~/.petscrc`` and ``.petscrc`` in the current folder, whose options may be meant
for another program and change results. Options in ``PETSC_OPTIONS``, or of a script that starts
PETSc itself, stay.

petsc4py would read ``petsc.cfg`` in the current folder, which may name another folder for the
library that it loads. dolfinx from 0.9 on makes petsc4py read it again, when it is imported.

PETSc would also handle SIGTERM and SIGHUP itself, print pages, and end the program at once.
"""

import os

import petsc4py
from mpi4py import MPI

from fenics_ehd.base.processes import in_neutral_folder

# First, so that options of the user come later and override it.
os.environ["PETSC_OPTIONS"] = f"-no_signal_handler {os.environ.get('PETSC_OPTIONS', '')}"
with in_neutral_folder():
    petsc4py.init(["fenics-ehd", "-skip_petscrc"], comm=MPI.COMM_WORLD)
# The decorator enters the neutral folder at every call.
petsc4py.lib.getPathArchPETSc = in_neutral_folder()(petsc4py.lib.getPathArchPETSc)
