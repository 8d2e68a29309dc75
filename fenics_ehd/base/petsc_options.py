"""Options of PETSc solvers, which users can override by prefix, and lifetime of PETSc objects."""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
from petsc4py import PETSc

from fenics_ehd.base.errors import SolverError

if TYPE_CHECKING:
    from slepc4py import SLEPc


#: Options that `fenics_ehd.base.petsc_start` sets.
OWN_OPTIONS = ("no_signal_handler", "skip_petscrc")


def options_of_user() -> dict[str, str]:
    """Options in PETSc's database that the user has set, by name."""
    options = PETSc.Options().getAll()
    return {name: str(value) for name, value in options.items() if name not in OWN_OPTIONS}


#: Packages of PETSc that contain factorisations, by the name of the factorisation.
_PACKAGES = {"cholmod": "suitesparse", "mumps": "mumps"}


def available_factorisation(*names: str) -> str:
    """First of the named factorisations that this PETSc contains; otherwise PETSc's own one.

    PETSc of Debian contains CHOLMOD and MUMPS, PETSc of PyPI's wheels contains MUMPS.
    """
    known = (name for name in names if PETSc.Sys.hasExternalPackage(_PACKAGES[name]))
    return next(known, "petsc")


@contextmanager
def configured(
    solver: PETSc.KSP | PETSc.SNES | SLEPc.EPS, prefix: str, defaults: Mapping[str, object]
) -> Iterator[None]:
    """Set a KSP, SNES or EPS from the options database, with `defaults` for missing options.

    If `defaults` has options of multigrid levels or of MUMPS, the solver must be set up within the
    block: these parts are created during the set-up and read their options then.

    Parameters
    ----------
    solver
        PETSc object with ``setOptionsPrefix`` and ``setFromOptions``.
    prefix
        Prefix of the options; with ``"film_"``, the solver reads ``-film_...``.
    defaults
        Default values by option name without prefix. They are in PETSc's options database only
        within the block, so that no other solver reads them.
    """
    options = PETSc.Options(prefix)
    added = {key: value for key, value in defaults.items() if not options.hasName(key)}
    for key, value in added.items():
        options[key] = value
    try:
        solver.setOptionsPrefix(prefix)
        solver.setFromOptions()
        yield
    finally:
        for key in added:
            options.delValue(key)


def configure(
    solver: PETSc.KSP | PETSc.SNES | SLEPc.EPS, prefix: str, defaults: Mapping[str, object]
) -> None:
    """Set a solver as `configured` does, without options of multigrid levels or of MUMPS."""
    with configured(solver, prefix, defaults):
        pass


def destroy_with(owner: object, *objects: PETSc.Object) -> None:
    """Destroy PETSc objects when their Python owner is collected, or at exit.

    PETSc objects refer to arrays and Python contexts until they are destroyed, which must happen
    before the interpreter ends. PETSc 3.18 would otherwise keep them until all ranks collect
    garbage together, which never happens.
    """
    weakref.finalize(owner, _destroy, objects)


def _destroy(objects: tuple[PETSc.Object, ...]) -> None:
    """Destroy PETSc objects."""
    for item in objects:
        item.destroy()


def solve_columns(ksp: PETSc.KSP, right: PETSc.Mat, solution: PETSc.Mat) -> None:
    """Solve a linear system for every column of a dense matrix.

    A direct solver solves for all columns at once, an iterative solver for one column at a time.

    Parameters
    ----------
    ksp
        Solver that is set up.
    right, solution
        Dense matrices of the right-hand sides and of the solutions, which are overwritten; both
        have the same distribution over ranks.

    Raises
    ------
    SolverError
        If the iteration does not converge for a column.
    """
    if ksp.getType() == "preonly" and ksp.pc.getType() in ("lu", "cholesky"):
        ksp.pc.getFactorMatrix().matSolve(right, solution)
        return
    rhs, unknown = ksp.getOperators()[0].createVecs()
    for column in range(right.size[1]):
        rhs.array = right.getDenseArray()[:, column]
        ksp.solve(rhs, unknown)
        if ksp.getConvergedReason() < 0:
            raise SolverError(
                f"no convergence in {ksp.getIterationNumber()} iterations (reason "
                f"{ksp.getConvergedReason()}): see -{ksp.getOptionsPrefix()}ksp_monitor"
            )
        solution.getDenseArray()[:, column] = unknown.array
