"""Table of the cases of a sweep: its columns as arrays, its rows, and its CSV file.

Imports inside functions: pandas is not required.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.described import Described, unknown_name, value_text
from fenics_ehd.base.errors import InputError, UnknownNameError
from fenics_ehd.base.files import require_writable
from fenics_ehd.multibody.verdict import COMPLETE
from fenics_ehd.study.cases import write_table

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False, repr=False)
class CaseTable(Described):
    """Rows of a sweep, one for each case, as in ``sweep.csv``.

    A column is read by its name, or by the end of its name if no other column has this end:
    ``table["clearance"]`` for ``joints.big_end.clearance``.

    Attributes
    ----------
    names
        Names of the columns: ``case``, the swept keys, ``status``, and the results with units.
    rows
        Values by column, row by row; a result that does not exist is None.
    """

    names: tuple[str, ...]
    rows: Sequence[dict[str, Any]]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __getitem__(self, name: str) -> np.ndarray:
        """Values of a column, shape (cases,); numbers that do not exist are nan.

        Raises
        ------
        UnknownNameError
            No column, or several columns, have this name or end of a name.
        """
        matches = [each for each in self.names if each == name or each.endswith(f".{name}")]
        column = name if name in self.names else matches[0] if len(matches) == 1 else None
        if column is None:
            if matches:
                raise UnknownNameError(
                    f"table[{name!r}] has several columns: choose {' or '.join(matches)}"
                )
            raise unknown_name("table", name, self.names, "table.names")
        values = [row[column] for row in self.rows]
        if all(value is None or isinstance(value, (int, float)) for value in values):
            if any(value is None for value in values):
                return np.array([np.nan if value is None else value for value in values])
            return np.array(values)
        array = np.empty(len(values), dtype=object)
        array[:] = values
        return array.astype(str) if all(isinstance(value, str) for value in values) else array

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """All columns by their complete names."""
        return {name: self[name] for name in self.names}

    @property
    def complete(self) -> np.ndarray:
        """Whether each case is complete, shape (cases,)."""
        return self["status"] == COMPLETE

    def write(self, path: str | Path) -> None:
        """Write the table to a CSV file, as ``sweep.csv``.

        Raises
        ------
        InputError, OutputError
            The file cannot be written.
        """
        require_class("path", path, str, Path)
        require_writable(path)
        write_table(Path(path), self.names, self.rows)

    def to_dataframe(self) -> DataFrame:
        """Return the columns as a pandas table.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise InputError(f"to_dataframe needs pandas ({error})") from None
        return pandas.DataFrame(self.columns)

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield numbers of cases, and the range of every column."""
        yield "Sweep", f"{len(self)} cases, {int(self.complete.sum()) if self.rows else 0} complete"
        for name in self.names[1:] if self.rows else ():
            if any(row[name] is not None for row in self.rows):
                yield name, value_text(self[name])
