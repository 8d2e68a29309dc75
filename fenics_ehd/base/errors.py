"""Named errors: each message is one line with the value, the limit and the key to change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class EhdError(Exception):
    """Base of every error that fenics_ehd raises on purpose; the command line exits with 1."""

    exit_status = 1


class InputError(EhdError):
    """Bad input: a value, a key or a file. The command line exits with 2."""

    exit_status = 2


class SettingsError(InputError):
    """A scene file or option holds a key or a value that cannot be used."""


class AccuracyError(InputError):
    """An accuracy is requested for figures whose errors are not estimated."""


class SensitivityError(InputError):
    """A requested derivative does not exist: of an unknown figure, or along no parameter."""


class InUseError(InputError):
    """Another process is writing into the folder."""


class OutputError(EhdError):
    """A file cannot be written, on a full disk for instance."""


class CompilationError(EhdError):
    """Forms cannot be compiled: another process has held the lock for too long."""


class MeshError(InputError):
    """The Gmsh model lacks something that the part needs, or cannot be meshed."""


class StructureError(InputError):
    """Matrices, bore or boundary points of a part cannot be used or contradict each other."""


class BodyFileError(InputError):
    """A reduced-body file cannot be read, or does not hold a reduced body."""


class InterfaceMismatchError(InputError):
    """Film mesh and bore nodes do not match."""


class SolverError(EhdError):
    """A linear, eigenvalue or nonlinear solve failed or did not pass its own check."""


class CavitationError(SolverError):
    """The complementarity problem of the film was not solved to its tolerance.

    `state` has the arrays of the failed film solve by name (gap, velocities, pressure, flux), to
    be saved for inspection.
    """

    def __init__(self, message: str, state: Mapping[str, Any] | None = None):
        super().__init__(message)
        self.state = dict(state or {})


class ViscosityError(CavitationError):
    """The iteration between viscosity and pressure diverges: the oil thickens without bound."""


class GapClosedError(SolverError):
    """The film thickness is not positive everywhere."""


class FilmTooThinError(SolverError):
    """The film became thinner than `smallest_film`, the limit of the run."""


class ContactError(SolverError):
    """Rough surfaces overlap farther than the model of their contact describes."""


class StepSizeError(SolverError):
    """The time integration needed a step below its smallest allowed one."""


class PeriodicityError(SolverError):
    """A periodic orbit was not found within the allowed cycles."""


class HeatError(SolverError):
    """A film has no temperature at which dissipated and removed heat balance."""


class VerificationError(SolverError):
    """A computed result violates a property it must have."""
