"""Options that several commands have, and lines on the first rank's standard error."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import attrs
import click

from fenics_ehd.base.errors import SettingsError, VerificationError
from fenics_ehd.base.fields import NO_TEMPERATURE, NONE, in_unit, unit_of
from fenics_ehd.base.files import to_json
from fenics_ehd.base.settings import declared


def warn_of(lines: Iterable[str]) -> None:
    """Say which numbers are not usual ones: their unit may be another."""
    _say(f"fenics-ehd: warning: {line}" for line in lines)


def say_reducing(names: Iterable[str]) -> None:
    """Say which bodies are reduced: the first time ever, this takes long."""
    found = ", ".join(names)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fenics"
    compiled = any(cache.glob("libffcx_forms_*.so"))
    once = "" if compiled else " (forms are compiled once, in about half a minute)"
    _say([f"reducing {found}{once}"] if found else [])


def _say(lines: Iterable[str]) -> None:
    from mpi4py import MPI  # help does without

    if MPI.COMM_WORLD.rank == 0:
        for line in lines:
            click.echo(line, err=True)


Command = TypeVar("Command", bound=Callable[..., Any])

#: Paths of a file, and of a folder.
FILE, FOLDER = click.Path(dir_okay=False), click.Path(file_okay=False)


def flag(name: str, help_text: str) -> Callable[[Command], Command]:
    """Option that is given or not."""
    return click.option(name, is_flag=True, help=help_text)


class Measured(click.ParamType):
    """A number, or one with its unit, ``5 kN``, in that which a help text has in brackets."""

    name = "float"

    def __init__(self, help_text: str):
        self.unit = unit_of(help_text)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Number in the unit of the option, as click asks for it."""
        try:
            return float(value)
        except ValueError:
            pass
        try:
            return in_unit(value, self.unit)
        except SettingsError as error:
            self.fail(f"{value!r} {error}", param, ctx)


#: Defaults that stand for what is not given.
NOT_GIVEN = (NONE, NO_TEMPERATURE, (0.0, 0.0))


def setting_options(
    cls: type, *without: str, defaults: bool = True
) -> Callable[[Command], Command]:
    """Options for the settings of a class, some left out, with help and unit of each.

    Without `defaults` what is not given is None.
    """

    def add(command: Command) -> Command:
        fields = [field for field in declared(cls) if field.name not in without]
        fields.sort(key=lambda field: field.name not in cls.__annotations__)  # inherited ones last
        for field in reversed(fields):
            command = _setting_option(field, defaults)(command)
        return command

    return add


def _setting_option(field: attrs.Attribute, defaults: bool) -> Callable[[Command], Command]:
    name, kind, told = field.name.replace("_", "-"), str(field.type), field.metadata["help"]
    measured = Measured(told)
    kinds: dict[str, Any] = {"float": measured, "int": int, "bool": bool}
    kinds["tuple[float, float]"] = measured, measured
    options, default = field.metadata.get("options"), field.default
    return click.option(
        f"--{name}/--no-{name}" if default is True else f"--{name}",
        type=click.Choice(options) if options else kinds.get(kind),
        is_flag=kind == "bool",
        default=default if defaults else None,
        show_default=defaults and bool(default) and default not in NOT_GIVEN,
        help=told,
    )


json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print results as JSON on stdout, nothing else there."
)


#: A printed number that is not finite: no name at the start of a line, and no "results in nan".
UNPRINTABLE = re.compile(r"(?<=\S)(?<! in) +[-+]?(nan|inf)(?=[\s,;%)]|$)")


def answer(found: Mapping[str, Any], told: str, as_json: bool) -> None:
    """Print a result, as JSON, in which a number that is not finite is null, or in words.

    Raises
    ------
    VerificationError
        A figure in words is no finite number.
    """
    unknown = [] if as_json else [line.strip() for line in told.split("\n") if _unknown(line)]
    keys = sorted(set(_not_finite(found))) if unknown else []
    if keys:
        raise VerificationError(f"{', '.join(keys)}: no finite number, in: {unknown[0]}")
    click.echo(to_json(found) if as_json else told)


def _unknown(line: str) -> bool:
    return UNPRINTABLE.search(line) is not None


def _not_finite(found: Any, key: str = "") -> Iterator[str]:
    """Keys of the numbers in a result that are not finite."""
    if isinstance(found, Mapping):
        for name, value in found.items():
            yield from _not_finite(value, str(name))
    elif isinstance(found, list | tuple):
        for value in found:
            yield from _not_finite(value, key)
    elif isinstance(found, float) and not math.isfinite(found):
        yield key


def aligned(
    rows: Sequence[Sequence[str]], words: Collection[int] = (0,), indent: str = ""
) -> list[str]:
    """Lines of a table, the first row its heads: columns of words to the left, others right."""
    columns = enumerate(zip(*rows, strict=True))
    forms = [f"{'<' if k in words else '>'}{max(map(len, cells))}" for k, cells in columns]
    return [(indent + "  ".join(map(format, row, forms))).rstrip() for row in rows]


def output_option(
    name: str, help_text: str, *, folder: bool = True, required: bool = False
) -> Callable[[Command], Command]:
    """``-o``, a folder or a file, under the name of an argument."""
    path = FOLDER if folder else FILE
    return click.option("-o", "--output", name, type=path, help=help_text, required=required)


#: Shared by commands that run many cases.
workers_option = click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes [default: the cores this one may use]; with 1 no run disturbs another.",
)
