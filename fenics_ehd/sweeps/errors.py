"""Named errors of sweeps."""

from __future__ import annotations

from fenics_ehd.errors import EhdError, InputError


class FailedCasesError(EhdError):
    """Some cases of a sweep failed; the rows of all others are complete."""


class OtherSweepError(InputError):
    """The folder holds the rows of another sweep, or of none that this program wrote."""


def one_line(error: BaseException) -> str:
    """Name and message of an error in one line, for a table."""
    return " ".join(f"{type(error).__name__}: {error}".rstrip(": ").split())
