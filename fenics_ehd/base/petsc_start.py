"""Starts PETSc when imported, which must be before anything else imports PETSc or dolfinx.

PETSc would read ``~/.petscrc`` and ``.petscrc`` in the current folder, whose options may be meant
for another program and change results. Those given on purpose stay: in ``PETSC_OPTIONS``, or by a
script that starts PETSc itself.

PETSc would also answer SIGTERM and SIGHUP itself, with pages, and end the program at once.
"""

import os

import petsc4py
from mpi4py import MPI

# Before those given on purpose, which have the last word.
os.environ["PETSC_OPTIONS"] = f"-no_signal_handler {os.environ.get('PETSC_OPTIONS', '')}"
petsc4py.init(["fenics-ehd", "-skip_petscrc"], comm=MPI.COMM_WORLD)
