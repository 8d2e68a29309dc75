"""Starts PETSc when imported, which must be before anything else imports PETSc or dolfinx.

PETSc would read ``~/.petscrc`` and ``.petscrc`` in the current folder, whose options may be meant
for another program and change results. Those given on purpose stay: in ``PETSC_OPTIONS``, or by a
script that starts PETSc itself.
"""

import petsc4py
from mpi4py import MPI

petsc4py.init(["fenics-ehd", "-skip_petscrc"], comm=MPI.COMM_WORLD)
