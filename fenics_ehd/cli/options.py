"""Options common to several commands, and notices on the first rank's standard error.

Imports inside functions: ``--help`` must work without the modules of commands, and quickly.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import attrs
import click

from fenics_ehd.base.compile_lock import forms_folder
from fenics_ehd.base.errors import SettingsError, VerificationError
from fenics_ehd.base.files import to_json
from fenics_ehd.base.needs import NO_TEMPERATURE, NONE, Needs, Setting, missing_need, no_effect
from fenics_ehd.base.printed import escaped
from fenics_ehd.base.settings import declared
from fenics_ehd.base.units import in_unit, parse_number, unit_of


def echo(text: object, *, err: bool = False) -> None:
    """Print a text with its control characters escaped."""
    click.echo(escaped(str(text)), err=err)


def warn_of(lines: Iterable[str]) -> None:
    """Print notices of unusual values, which may be in another unit."""
    _say(f"fenics-ehd: warning: {line}" for line in lines)


def say_reducing(names: Iterable[str]) -> None:
    """Print the names of the bodies to be reduced; the first reduction takes longer."""
    listed = ", ".join(names)
    compiled = any(forms_folder().glob("libffcx_forms_*.so"))
    once = "" if compiled else " (forms are compiled once, in about half a minute)"
    _say([f"reducing {listed}{once}"] if listed else [])


def _say(lines: Iterable[str]) -> None:
    from mpi4py import MPI  # not needed for help

    if MPI.COMM_WORLD.rank == 0:
        for line in lines:
            echo(line, err=True)


Command = TypeVar("Command", bound=Callable[..., Any])

#: Types of options with the path of a file.
FILE = click.Path(dir_okay=False)
FOLDER = click.Path(file_okay=False)


class Dependent(click.Option):
    """Option that is refused if it has no effect.

    Parameters
    ----------
    needs
        Conditions on other parameters of the command, by their names.
    """

    def __init__(self, *names: Any, needs: Sequence[Needs] = (), **more: Any):
        super().__init__(*names, **more)
        self._needs = needs

    def handle_parse_result(
        self, ctx: click.Context, opts: Mapping[str, Any], args: list[str]
    ) -> tuple[Any, list[str]]:
        """Value of the option; an explicit default value is accepted without its conditions."""
        value, rest = super().handle_parse_result(ctx, opts, args)
        name = str(self.name)
        if name in opts and value != self.get_default(ctx):
            why = missing_need(self._needs, partial(_parameter, ctx.command, opts))
            if why:
                raise no_effect(_written(self, opts[name]), value, why)
        return value, rest


def _parameter(command: click.Command, parsed: Mapping[str, Any], name: str) -> Setting | None:
    """Another parameter of the command, if it has been parsed."""
    for parameter in command.params:
        if parameter.name == name:
            value = parsed.get(name, parameter.default)
            # Some versions of click have a sentinel in place of None.
            plain = isinstance(value, (bool, int, float, str, tuple, list))
            return Setting(_written(parameter, True), value if plain else None)
    return None


def _written(parameter: click.Parameter, value: Any) -> str:
    """An option as written on the command line; a false switch as ``--no-...``."""
    off = value is False and parameter.secondary_opts
    return (parameter.secondary_opts if off else parameter.opts)[-1]


def option(*names: str, needs: Sequence[Needs] = (), **more: Any) -> Callable[[Command], Command]:
    """Option of click that has an effect only under conditions, see `Dependent`."""
    return click.option(*names, cls=Dependent, needs=needs, **more)


def flag(name: str, help_text: str, needs: Sequence[Needs] = ()) -> Callable[[Command], Command]:
    """Switch: an option without a value."""
    return option(name, is_flag=True, help=help_text, needs=needs)


class Integer(click.ParamType):
    """A whole number in plain digits."""

    name = "integer"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Number of the option; the interface of click."""
        if isinstance(value, str) and not re.fullmatch(r"[+-]?[0-9]{1,300}", value.strip()):
            self.fail(f"{value[:40]!r} is not a whole number", param, ctx)
        return int(value)


class Whole(click.IntRange):
    """A whole number in plain digits, within limits."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Number of the option; the interface of click."""
        return super().convert(Integer().convert(value, param, ctx), param, ctx)


class Real(click.FloatRange):
    """A finite number in plain digits, within limits."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Number of the option; the interface of click."""
        if isinstance(value, str):
            try:
                value = parse_number(value)
            except ValueError as error:
                self.fail(str(error), param, ctx)
            if abs(value) == float("inf"):
                self.fail("the number must be finite", param, ctx)
        return super().convert(value, param, ctx)


#: Words that Python converts to numbers that are not finite.
NOT_FINITE = ("nan", "inf", "-inf")


class Measured(click.ParamType):
    """A number, or one with its unit, ``5 kN``, converted to the bracketed unit of a help text."""

    name = "float"

    def __init__(self, help_text: str):
        self.unit = unit_of(help_text)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Number in the unit of the option; the interface of click."""
        if not isinstance(value, str):
            return float(value)
        if value.strip().lower() in NOT_FINITE:
            return float(value)  # the setting checks the number, with its name in the message
        try:
            return parse_number(value)
        except ValueError:
            pass
        try:
            return in_unit(value, self.unit)
        except SettingsError as error:
            self.fail(f"{value!r} {error}", param, ctx)


#: Default values of settings that are not set.
NOT_GIVEN = (NONE, NO_TEMPERATURE, (0.0, 0.0))


def setting_options(
    cls: type, *without: str, defaults: bool = True, needs: Sequence[Needs] = ()
) -> Callable[[Command], Command]:
    """Options for settings of a class, except some, with help texts and units of the settings.

    Without `defaults`, missing options are None. All options have the conditions `needs`;
    conditions of the settings are checked with the settings.
    """

    def add(command: Command) -> Command:
        fields = [field for field in declared(cls) if field.name not in without]
        fields.sort(
            key=lambda field: field.name not in cls.__annotations__
        )  # inherited fields last
        for field in reversed(fields):
            command = _setting_option(field, defaults, needs)(command)
        return command

    return add


def _setting_option(
    field: attrs.Attribute, defaults: bool, needs: Sequence[Needs]
) -> Callable[[Command], Command]:
    name = field.name.replace("_", "-")
    kind = str(field.type)
    help_text = field.metadata["help"]
    measured = Measured(help_text)
    kinds: dict[str, Any] = {"float": measured, "int": Integer(), "bool": bool}
    kinds["tuple[float, float]"] = measured, measured
    options = field.metadata.get("options")
    default = field.default
    return option(
        f"--{name}/--no-{name}" if default is True else f"--{name}",
        type=click.Choice(options) if options else kinds.get(kind),
        is_flag=kind == "bool",
        default=default if defaults else None,
        show_default=defaults and bool(default) and default not in NOT_GIVEN,
        help=help_text,
        needs=needs,
    )


json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print results as JSON on stdout, nothing else there."
)


#: Pattern of a number that is not finite; names at the start of a line and files "in nan" differ.
UNPRINTABLE = re.compile(r"(?<=\S)(?<! in) +[-+]?(nan|inf)(?=[\s,;%)]|$)")


def answer(result: Mapping[str, Any], text: str, as_json: bool) -> None:
    """Print a result as JSON, with null for numbers that are not finite, or as text.

    Raises
    ------
    VerificationError
        The text has a number that is not finite.
    """
    unknown = [] if as_json else [line.strip() for line in text.split("\n") if _unknown(line)]
    keys = sorted(set(_not_finite(result))) if unknown else []
    if keys:
        raise VerificationError(f"{', '.join(keys)}: no finite number, in: {unknown[0]}")
    echo(to_json(result) if as_json else text)


def _unknown(line: str) -> bool:
    return UNPRINTABLE.search(line) is not None


def _not_finite(result: Any, key: str = "") -> Iterator[str]:
    """Keys of all numbers in a result that are not finite."""
    if isinstance(result, Mapping):
        for name, value in result.items():
            yield from _not_finite(value, str(name))
    elif isinstance(result, list | tuple):
        for value in result:
            yield from _not_finite(value, key)
    elif isinstance(result, float) and not math.isfinite(result):
        yield key


def aligned(
    rows: Sequence[Sequence[str]], words: Collection[int] = (0,), indent: str = ""
) -> list[str]:
    """Lines of a table with a row of headings: columns of words are left-aligned, others right."""
    columns = enumerate(zip(*rows, strict=True))
    forms = [f"{'<' if k in words else '>'}{max(map(len, cells))}" for k, cells in columns]
    return [(indent + "  ".join(map(format, row, forms))).rstrip() for row in rows]


def output_option(
    name: str,
    help_text: str,
    *,
    folder: bool = True,
    required: bool = False,
    needs: Sequence[Needs] = (),
) -> Callable[[Command], Command]:
    """Option ``-o`` with the path of a folder or a file; `name` is the argument of the command."""
    path = FOLDER if folder else FILE
    names = "-o", "--output", name
    return option(*names, type=path, help=help_text, required=required, needs=needs)


#: Option with the number of processes, for commands that run many cases.
workers_option = click.option(
    "--workers",
    type=Whole(min=1),
    help="Processes [default: the cores available]; with 1 runs do not compete for time.",
)
