"""Fields of a scene's settings beside those of `base.fields`: points, names, film cells."""

from __future__ import annotations

from functools import partial
from typing import Any

import attrs

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import as_tuple, checked, described, table, unit_of
from fenics_ehd.base.quantities import LARGEST_LENGTH

#: Stands for what is not given: a file, a name.
NONE = "none"

#: A key that must be written.
REQUIRED: Any = attrs.NOTHING

#: Fewest film cells around and along. With 3 around the largest pressure is 12 % too low.
FEWEST_CELLS = (8, 2)

#: Film cells around times along that still fit into the memory of a usual machine.
MOST_CELLS = 200_000


def _is_pair(value: Any, below: float) -> bool:
    if not isinstance(value, tuple) or len(value) != 2:
        return False
    return all(isinstance(n, float) and abs(n) < below for n in value)


def _two(unit: str, below: float) -> str:
    return f"two numbers [x, y]{f' in {unit}' if unit else ''}, below {below:g}"


def pair(help_text: str, default: Any = (0.0, 0.0), *, below: float = 1e15) -> Any:
    """Two numbers along x and y, each of a size below a limit."""
    unit = unit_of(help_text)
    return described(
        default,
        help_text,
        lambda value: _is_pair(value, below),
        _two(unit, below),
        partial(as_tuple, unit=unit),
    )


def place(help_text: str, default: Any = (0.0, 0.0)) -> Any:
    """A place in the plane [m]."""
    return pair(help_text, default, below=100 * LARGEST_LENGTH)


def places(help_text: str) -> Any:
    """Places in the plane by name [m]."""
    unit, below = unit_of(help_text), 100 * LARGEST_LENGTH

    def check(name: str, value: Any) -> None:
        if not _is_pair(value, below):
            shown = list(value) if isinstance(value, tuple) else value
            raise SettingsError(f"{name} = {shown!r} must be {_two(unit, below)}")

    return table(help_text, check, partial(as_tuple, unit=unit))


def names(help_text: str, default: Any = (), *, count: int | None = None) -> Any:
    """A list of names, of a given `count` or of any."""

    def listed(value: Any) -> bool:
        words = isinstance(value, tuple) and all(isinstance(n, str) and n for n in value)
        return words and count in (None, len(value))

    wanted = "a list of names" if count is None else f"a list of {count} names"
    return described(default, help_text, listed, wanted, as_tuple)


def film_cells(help_text: str) -> Any:
    """Cells of a film mesh around and along, or an empty list."""

    def check(name: str, value: Any) -> None:
        given = f"{name} = {list(value)!r}"
        if value and (len(value) != 2 or any(type(n) is not int or n <= 0 for n in value)):
            raise SettingsError(f"{given} must be two whole numbers above 0, or empty")
        if any(n < fewest for n, fewest in zip(value, FEWEST_CELLS, strict=False)):
            raise SettingsError(
                f"{given} must be at least {list(FEWEST_CELLS)}: fewer are too coarse"
            )
        if value and value[0] * value[1] > MOST_CELLS:
            raise SettingsError(
                f"{given}: {value[0] * value[1]} cells, at most {MOST_CELLS} are allowed"
            )

    return checked(
        (),
        help_text,
        check,
        lambda value: tuple(value) if isinstance(value, (list, tuple)) else (value,),
    )
