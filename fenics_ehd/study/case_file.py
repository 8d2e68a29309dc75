"""Cases of a sweep from a CSV file, as editors, spreadsheets, pandas, NumPy and MATLAB write it.

The first line has keys, each further line the values of a case. Separators are semicolons, tabs,
commas or spaces; the line of keys decides. Text is UTF-8, UTF-16 with a byte order mark, or the
Western code page of Windows. Everything that has only one meaning is accepted: decimal commas, a
line of units, quoted cells, empty lines and columns, a column that numbers the rows.
"""

from __future__ import annotations

import codecs
import csv
import os
import re
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import shown
from fenics_ehd.base.settings import walk
from fenics_ehd.base.units import WRITTEN, in_unit, unit, unit_of
from fenics_ehd.scenes.scene import Scene
from fenics_ehd.study.cases import MOST_CASES, parse_value, resolve_key, scene_values

#: Largest size of a file of cases: 10 000 lines of 6 kB, far above any table of cases [bytes].
LARGEST_FILE = 1 << 26

#: Beginnings of workbooks: of Excel and LibreOffice, which are zip archives, and of Excel 97.
WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")

#: Control characters that no text has.
CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")

#: Separators of cells; the first of them in the line of keys is used.
SEPARATORS = ";\t,"

#: Patterns of spaces outside brackets, which separate the cells of a file without other separators,
#: and its headings, whose units are behind a space.
SPACES = re.compile(r"[ \xa0]+(?![^\[(]*[\])])")
HEADING_SPACES = re.compile(r"[ \xa0]+(?![\[(])(?![^\[(]*[\])])")

#: Pattern of the beginning of a comment; values such as ``#N/A`` and ``#REF!`` are errors of a
#: spreadsheet.
COMMENT = re.compile(r"\s*#(?!(?:N/A|NV)(?!\w)|[\w/]+[!?])")

#: Pattern of a first line that states the separator for Excel.
EXCEL_SEPARATOR = re.compile(r'"?sep=(?P<mark>[;,\t])"?')

#: Pattern of a heading with a unit for its column: ``clearance [um]`` or ``clearance (um)``.
HEADING = re.compile(r"(?P<key>[^\[\]()]*?)\s*(?:[\[(](?P<unit>[^\[\]]+)[\])])?")

#: Cells of a line of units for a column without a unit.
NO_UNITS = ("", "-", "1", "[-]", "[1]", "[]")

#: Heading of a column that numbers the cases.
NUMBER_OF_CASE = "case"

#: Pattern of a number with a decimal comma, and with a unit behind it.
DECIMAL_COMMA = re.compile(
    r"(?P<whole>[+-]?[0-9]*),(?P<fraction>[0-9]+)(?P<rest>(?:[eE][+-]?[0-9]+)?(?:\s*(?:[^\W\d_]|[%\u00b0]).*)?)"
)

#: Pattern of a decimal point, which is between digits.
DECIMAL_POINT = re.compile(r"[0-9]\.[0-9]")

#: Pattern of a number whose points may separate thousands.
GROUPED = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:\.[0-9]{3})+")


@dataclass(frozen=True)
class Line:
    """Cells of a line.

    Attributes
    ----------
    number
        Number of the line in the file, from 1.
    cells
        Texts of the cells, without spaces around them.
    """

    number: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """Lines of a file that are not empty.

    Attributes
    ----------
    lines
        Line of keys, then lines of values.
    separator
        Separator of the cells; empty for spaces, and for a file with one column.
    """

    lines: Iterator[Line]
    separator: str


@dataclass(frozen=True)
class Column:
    """Column of the values of a key.

    Attributes
    ----------
    index
        Index of its cells in a line.
    heading
        Heading in the file.
    key
        Full key of the setting.
    like
        Value of the key in the scene.
    unit
        Unit of all numbers in the column; empty if they are in the unit of the setting.
    """

    index: int
    heading: str
    key: str
    like: Any
    unit: str

    @property
    def is_number(self) -> bool:
        """Whether values of the key are numbers."""
        return isinstance(self.like, (int, float)) and not isinstance(self.like, bool)


@dataclass(frozen=True)
class CaseFile:
    """Cases of a file.

    Attributes
    ----------
    keys
        Full keys of the columns.
    rows
        Values of the keys, case by case.
    lines
        Numbers of the lines of the cases in the file.
    """

    keys: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    lines: tuple[int, ...]


def read_case_file(scene: Scene, path: str, label: str) -> CaseFile:
    """Read the cases of a sweep from a CSV file.

    A value is written as for ``--set``, with or without a unit. A heading, or a line of units below
    the headings, may have a unit for all numbers in a column.

    Parameters
    ----------
    scene
        Scene as stored, whose keys the headings name.
    path
        Path of the file.
    label
        Name of the file in messages, ``--cases cases.csv``.

    Raises
    ------
    SettingsError
        The file cannot be used; the message has the line and the column.
    """
    table = _table(_text(path, label), label)
    header = next(table.lines)
    header = replace(header, cells=_without_end(header.cells, 0))
    headings = [_heading(scene, text, f"{label}: line {header.number}") for text in header.cells]
    body = [_complete(line, header, table.separator, label) for line in table.lines]
    columns, body = _with_line_of_units(_columns(scene, headings, header, body, label), body)
    if not columns or not body:
        raise SettingsError(f"{label}: the file needs a line of keys, and a line for each case")
    if len(body) > MOST_CASES:
        raise SettingsError(
            f"{label}: the file has {len(body)} cases, above the limit of {MOST_CASES}"
        )
    _require_units(scene, columns, f"{label}: line {header.number}")
    body = _with_decimal_points(columns, body, table.separator, label)
    rows = [
        tuple(_value(line, column, f"{label}: line {line.number}") for column in columns)
        for line in body
    ]
    for column, values in zip(columns, zip(*rows, strict=True), strict=True):
        _require_same_units(column, values, body, label)
    return CaseFile(
        tuple(column.key for column in columns), tuple(rows), tuple(line.number for line in body)
    )


def _text(path: str, label: str) -> str:
    """Text of a file, with line breaks of Unix.

    Raises
    ------
    SettingsError
        The path is that of a folder, a device or a large file, or the file is not a text.
    """
    hint = "give a CSV file with a line of keys, and a line for each case"
    try:
        status = os.stat(path)
        if stat.S_ISDIR(status.st_mode):
            raise SettingsError(f"{label}: this is a folder: {hint}")
        if not stat.S_ISREG(status.st_mode):
            raise SettingsError(f"{label}: this is a pipe or device: write the cases to a file")
        if status.st_size > LARGEST_FILE:
            raise SettingsError(
                f"{label}: the file has {status.st_size >> 20} MB, above the limit of "
                f"{LARGEST_FILE >> 20} MB: {hint}"
            )
        content = Path(path).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: the path has a null character
        raise SettingsError(f"{label}: {getattr(error, 'strerror', None) or error}") from None
    if content.startswith(WORKBOOKS):
        raise SettingsError(
            f"{label}: this is a workbook of Excel or LibreOffice: save its sheet as CSV"
        )
    is_wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    for encoding in ("utf-16",) if is_wide else ("utf-8-sig", "cp1252"):
        with suppress(UnicodeDecodeError):
            text = content.decode(encoding)
            if not CONTROL.search(text):
                return text.replace("\r\n", "\n").replace("\r", "\n")
    raise SettingsError(f"{label}: this is not a text: {hint}")


def _table(text: str, label: str) -> Table:
    """Lines of a file that are not empty; the first has the keys.

    Lines that start with ``#`` are comments. If no line has keys, the last comment before the
    numbers is the line of keys, as `numpy.savetxt` writes it.

    Raises
    ------
    SettingsError
        There is no line of keys.
    """
    texts = text.split("\n")
    separator = ""
    start = next((n for n, each in enumerate(texts) if each.strip()), 0)
    if match := EXCEL_SEPARATOR.fullmatch(texts[start].strip(" ")):
        separator = match["mark"]
        texts[start] = ""
    is_comment = [bool(COMMENT.match(each)) for each in texts]
    first = next((n for n, each in enumerate(texts) if each.strip() and not is_comment[n]), None)
    if first is None:
        raise SettingsError(f"{label}: the file needs a line of keys, and a line for each case")
    if not re.search(r"[^\W\d_]{2}", texts[first]):  # an exponent is one letter
        comments = [n for n in range(first) if is_comment[n] and texts[n].strip("# \t")]
        if not comments:
            raise SettingsError(
                f"{label}: line {first + 1}, {shown(texts[first].strip())}, has no keys: the first "
                "line must have them, clearance,oil.viscosity for instance"
            )
        first = comments[-1]
        texts[first] = texts[first].lstrip().lstrip("#").strip()
        is_comment[first] = False
    kept = ["" if n < first or is_comment[n] else each for n, each in enumerate(texts)]
    separator = separator or next((mark for mark in SEPARATORS if mark in texts[first]), "")
    return Table(_lines(kept, separator, texts[first], label), separator)


def _without_end(cells: tuple[str, ...], least: int) -> tuple[str, ...]:
    """Cells without empty cells at the end; `least` cells remain."""
    while len(cells) > least and not cells[-1]:
        cells = cells[:-1]
    return cells


def _lines(texts: Sequence[str], separator: str, header: str, label: str) -> Iterator[Line]:
    """Lines of a table that are not empty.

    Without a separator, cells are separated by spaces if the `header` has several words, else each
    line has one cell.
    """
    if not separator and HEADING_SPACES.search(header.strip()):
        pattern = HEADING_SPACES
        for number, text in enumerate(texts, 1):
            if text.strip():
                yield Line(number, tuple(pattern.split(text.strip())))
                pattern = SPACES
        return
    reader = csv.reader(
        (f"{text}\n" for text in texts),
        delimiter=separator or ";",
        strict=True,
        skipinitialspace=True,
    )
    number = 1
    try:
        for cells in reader:
            stripped = tuple(cell.strip() for cell in cells)
            if any(stripped):
                yield Line(number, stripped)
            number = reader.line_num + 1
    except csv.Error as error:
        reason = "a quotation mark is not closed" if "end of data" in str(error) else str(error)
        raise SettingsError(f"{label}: line {number}: {reason}") from None


def _complete(line: Line, header: Line, separator: str, label: str) -> Line:
    """Line without the empty cells behind the last heading.

    Raises
    ------
    SettingsError
        The line has more values than there are keys, or fewer.
    """
    count = len(header.cells)
    cells = _without_end(line.cells, count)
    if len(cells) == count:
        return replace(line, cells=cells)
    hint = ": separate columns by semicolons if numbers have decimal commas"
    raise SettingsError(
        f"{label}: line {line.number} has {len(cells)} values, but line {header.number} has "
        f"{count} keys{hint if len(cells) > count and separator == ',' else ''}"
    )


def _heading(scene: Scene, heading: str, where: str) -> tuple[str, str]:
    """Key and unit in a heading; the key is empty for a column that may not have one.

    Raises
    ------
    SettingsError
        The heading is not a key of the scene.
    """
    if heading in ("", NUMBER_OF_CASE):
        return "", ""
    match = HEADING.fullmatch(heading)
    if match is None or not match["key"]:
        raise SettingsError(
            f"{where}: heading {shown(heading)} must be a key, or a key with a unit in brackets"
        )
    try:
        return resolve_key(scene, match["key"]), match["unit"] or ""
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from None


def _columns(
    scene: Scene,
    headings: Sequence[tuple[str, str]],
    header: Line,
    body: Sequence[Line],
    label: str,
) -> list[Column]:
    """Columns of keys; empty columns and columns that number the rows are omitted.

    Raises
    ------
    SettingsError
        A key has two columns, or a column with values has no key.
    """
    like, _ = scene_values(scene)
    columns: list[Column] = []
    for index, (key, symbol) in enumerate(headings):
        heading = header.cells[index]
        if not key:
            _require_without_key(index, body, header, label)
            continue
        if key in [column.key for column in columns]:
            raise SettingsError(
                f"{label}: line {header.number}: column {heading}: {key} is given twice: drop one "
                "of the columns"
            )
        columns.append(Column(index, heading, key, like.get(key, 0.0), symbol))
    return columns


def _require_without_key(index: int, body: Sequence[Line], header: Line, label: str) -> None:
    """Refuse a column without a key, unless it is empty or numbers the rows, from 0 or 1.

    Raises
    ------
    SettingsError
        The column has values.
    """
    where = f"{label}: line {header.number}"
    if header.cells[index] == NUMBER_OF_CASE:
        for number, line in enumerate(body, 1):
            if line.cells[index] != str(number):
                raise SettingsError(
                    f"{where}: column {NUMBER_OF_CASE}: line {line.number} has "
                    f"{shown(line.cells[index])}, but cases are numbered from 1 in the order of "
                    "the lines: drop the column"
                )
        return
    filled = [line for line in body if line.cells[index]]
    cells = [line.cells[index] for line in body]
    counts = [[str(n) for n in range(first, first + len(body))] for first in (0, 1)]
    if filled and not (index == 0 and cells in counts):
        raise SettingsError(
            f"{where}: column {index + 1} has no heading, but line {filled[0].number} has "
            f"{shown(filled[0].cells[index])} there: write its key, or empty the column"
        )


def _with_line_of_units(columns: list[Column], body: list[Line]) -> tuple[list[Column], list[Line]]:
    """Columns with the units of the first line, and the other lines, if this line has only units.

    A word in a column of numbers cannot be a value, so that such a line has one meaning.
    """
    if not body:
        return columns, body
    units = {}
    for column in columns:
        cell = body[0].cells[column.index]
        symbol = cell[1:-1].strip() if re.fullmatch(r"\[.+\]|\(.+\)", cell) else cell
        if cell in NO_UNITS:
            units[column.key] = ""
        elif column.is_number and not column.unit and unit(symbol) is not None:
            units[column.key] = symbol
        else:
            return columns, body
    if not any(units.values()):
        return columns, body
    return [replace(each, unit=units[each.key] or each.unit) for each in columns], body[1:]


def _require_units(scene: Scene, columns: Iterable[Column], where: str) -> None:
    """Refuse a unit of a column that is unknown, or is that of another quantity.

    Raises
    ------
    SettingsError
        The setting of the column cannot have the unit.
    """
    wanted: Mapping[str, str] = {
        key: unit_of(attribute.metadata.get("help", "")) for key, attribute, _ in walk(scene)
    }
    for column in columns:
        if not column.unit:
            continue
        if not column.is_number:
            raise SettingsError(
                f"{where}: column {column.heading}: values of {column.key} are not numbers: drop "
                f"the unit {column.unit}"
            )
        try:
            in_unit(f"1 {column.unit}", wanted.get(column.key, column.unit))
        except SettingsError as error:
            raise SettingsError(f"{where}: column {column.heading}: {column.key} {error}") from None


def _with_decimal_points(
    columns: Iterable[Column], body: Sequence[Line], separator: str, label: str
) -> list[Line]:
    """Lines whose numbers have decimal points in place of decimal commas.

    Programs that separate cells by semicolons write decimal commas. With other separators, a comma
    with three digits behind it may separate thousands, unless another number of the file shows that
    commas are decimal. In a file with decimal points, such a comma always has two meanings.

    Raises
    ------
    SettingsError
        A number has two meanings.
    """
    changed = {line.number: list(line.cells) for line in body}
    unclear: list[tuple[Line, Column]] = []
    grouped: list[tuple[Line, Column]] = []
    is_decimal = separator == ";"
    has_commas = False
    has_points = False
    for column in (column for column in columns if column.is_number):
        for line in body:
            cell = line.cells[column.index]
            has_points = has_points or DECIMAL_POINT.search(cell) is not None
            if match := DECIMAL_COMMA.fullmatch(cell):
                has_commas = True
                point = f"{match['whole']}.{match['fraction']}{match['rest']}"
                changed[line.number][column.index] = point
                if len(match["fraction"]) != 3 or match["whole"].lstrip("+-") in ("", "0"):
                    is_decimal = True
                else:
                    unclear.append((line, column))
            elif GROUPED.fullmatch(cell):
                grouped.append((line, column))
    if unclear and (has_points or not is_decimal):
        _refuse_number(*unclear[0], f"{label}: line {unclear[0][0].number}")
    if grouped and has_commas:
        _refuse_number(*grouped[0], f"{label}: line {grouped[0][0].number}")
    return [Line(line.number, tuple(changed[line.number])) for line in body]


def _refuse_number(line: Line, column: Column, where: str) -> None:
    """Refuse a number whose point or comma may be decimal, or may separate thousands.

    Raises
    ------
    SettingsError
        Always.
    """
    cell = line.cells[column.index]
    decimal = cell.replace(",", ".")
    digits = re.sub("[.,]", "", cell)
    raise SettingsError(
        f"{where}: column {column.heading}: {cell} may mean {decimal} or {digits}: write one of "
        "these, with a decimal point"
    )


def _value(line: Line, column: Column, where: str) -> Any:
    """Value of a cell, with the unit of its column.

    Raises
    ------
    SettingsError
        The cell is empty, or not a value of the key.
    """
    cell = line.cells[column.index]
    label = f"{where}: column {column.heading}"
    if not cell:
        raise SettingsError(f"{label} is empty: give a value")
    try:
        value = parse_value(column.key, cell, column.like)
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from None
    if not column.unit:
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingsError(
            f"{label}: {shown(value)} must be a number in the column's unit, {column.unit}"
        )
    return f"{value!r} {column.unit}"


def _require_same_units(
    column: Column, values: Sequence[Any], body: Sequence[Line], label: str
) -> None:
    """Refuse a column of numbers of which only some have a unit.

    Raises
    ------
    SettingsError
        The message has a number with a unit, and one without.
    """
    if not column.is_number or column.unit:
        return
    with_unit = [n for n, each in enumerate(values) if isinstance(each, str)]
    without = [n for n, each in enumerate(values) if not isinstance(each, str)]
    if with_unit and without and WRITTEN.fullmatch(values[with_unit[0]]):
        plain = body[without[0]]
        named = body[with_unit[0]]
        raise SettingsError(
            f"{label}: column {column.heading}: line {plain.number} has "
            f"{plain.cells[column.index]} without a unit, but line {named.number} has "
            f"{named.cells[column.index]}: only some values of {column.key} have a unit: give all "
            "of them a unit, or none"
        )
