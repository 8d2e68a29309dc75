"""Exceptions of the package; a message is one line with the value, the limit and the key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class EhdError(Exception):
    """Base class of all exceptions that fenics_ehd raises; the command line exits with 1."""

    exit_status = 1


class InputError(EhdError):
    """Input cannot be used: a value, a key or a file. The command line exits with 2."""

    exit_status = 2


class SettingsError(InputError):
    """A key or value of a scene file, an option or an argument cannot be used."""


class UnknownNameError(SettingsError, KeyError):
    """A result has no column, joint, body or point of a name; programs may expect a KeyError."""

    __str__ = Exception.__str__  # that of KeyError puts the message in quotes


class AccuracyError(InputError):
    """An accuracy was requested for figures whose errors are not estimated."""


class SensitivityError(InputError):
    """A requested derivative does not exist: the figure is unknown, or the key not continuous."""


class InUseError(InputError):
    """Another process is writing into the folder."""


class OutputError(EhdError):
    """A file cannot be written, for instance because the disk is full."""


class CompilationError(EhdError):
    """Forms cannot be compiled: no compiler, or another process has held the lock for too long."""


class LibraryError(EhdError):
    """A library cannot be loaded, because the system lacks another library that it needs."""


class MeshError(InputError):
    """A Gmsh model lacks something that the part needs, or cannot be meshed."""


class StructureError(InputError):
    """Matrices, bore or boundary points of a part cannot be used or contradict each other."""


class BodyFileError(InputError):
    """A file of a reduced body or of a basis cannot be read, written or used."""


class InterfaceMismatchError(InputError):
    """The mesh of a film and the nodes of its bore do not match."""


class SolverError(EhdError):
    """A linear, eigenvalue or nonlinear solve failed, or its result did not pass a check."""


class CavitationError(SolverError):
    """The complementarity problem of a film was not solved to its tolerance.

    Attributes
    ----------
    state
        Arrays of the failed film solve by name (gap, velocities, pressure, flux), which commands
        save for inspection.
    """

    def __init__(self, message: str, state: Mapping[str, Any] | None = None):
        super().__init__(message)
        self.state = dict(state or {})


class ViscosityError(CavitationError):
    """The iteration of viscosity and pressure diverges: both grow without bound."""


class GapClosedError(SolverError):
    """The thickness of a film is not positive everywhere."""


class FilmTooThinError(SolverError):
    """A film became thinner than `smallest_film`, the limit of the run."""


class ContactError(SolverError):
    """Rough surfaces overlap more than the model of asperity contact can describe."""


class StepSizeError(SolverError):
    """The time integration needs a step below the smallest that is allowed."""


class PeriodicityError(SolverError):
    """A periodic orbit was not found within the allowed cycles."""


class HeatError(SolverError):
    """A film has no temperature at which dissipated and removed heat balance."""


class VerificationError(SolverError):
    """A computed result violates a property it must have."""
