"""Starts PETSc when imported, which must be before anything else imports PETSc or dolfinx.

PETSc would read ``~/.petscrc`` and ``.petscrc`` in the current folder, whose options may be meant
for another program and change results. Those given on purpose stay: in ``PETSC_OPTIONS``, or by a
script that starts PETSc itself.

petsc4py would read ``petsc.cfg`` in the current folder, which may name another folder for the
library that it loads. dolfinx from 0.9 on asks petsc4py again, when it is imported.

PETSc would also answer SIGTERM and SIGHUP itself, with pages, and end the program at once.
"""

import os

import petsc4py
from mpi4py import MPI

from fenics_ehd.base.processes import in_neutral_folder

# Before those given on purpose, which have the last word.
os.environ["PETSC_OPTIONS"] = f"-no_signal_handler {os.environ.get('PETSC_OPTIONS', '')}"
with in_neutral_folder():
    petsc4py.init(["fenics-ehd", "-skip_petscrc"], comm=MPI.COMM_WORLD)
# The decorator enters the neutral folder at every call.
petsc4py.lib.getPathArchPETSc = in_neutral_folder()(petsc4py.lib.getPathArchPETSc)
