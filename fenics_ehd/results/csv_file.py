"""``history.csv``, which grows row by row."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.whole_file import naming, write_whole

CSV_NAME = "history.csv"


class CsvFile:
    """Append-only rows; those of a former run are compared with, not written again."""

    def __init__(self, path: Path, names: list[str], resumed: int | None):
        self._path = path
        whole = [csv_line(names)]
        if resumed is not None:
            lines = path.read_bytes().splitlines(keepends=True)
            # A killed writer may have left its last row unfinished.
            whole = [line for line in lines if line.endswith(b"\n")]
            if len(whole) < 1 + resumed or whole[0] != csv_line(names):
                raise InputError(f"{path}: not the history of the run to go on with: start anew")
        self._begin(whole)

    def _begin(self, lines: list[bytes]) -> None:
        write_whole(self._path, b"".join(lines))
        self._header, *self._former = lines
        # Without a buffer, which would be written once more when there is no room for it.
        self._file = open(self._path, "ab", buffering=0)

    def write(self, index: int, values: list[str]) -> None:
        """Row number `index`."""
        line = csv_line(values)
        if index < len(self._former):
            if self._former[index] == line:
                return
            # Another machine rounds differently: its rows stand from here on.
            self.close()
            self._begin([self._header, *self._former[:index]])
            self._former = []
        with naming(self._path):
            while line:
                line = line[self._file.write(line) :]

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def csv_line(values: list[str]) -> bytes:
    """One row of such a file."""
    buffer = io.StringIO()
    csv.writer(buffer).writerow(values)
    return buffer.getvalue().encode()
