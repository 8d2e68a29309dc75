"""Options common to several commands, and notices on the first rank's standard error.

Imports inside functions: ``--help`` must work without the modules of commands, and quickly.
"""

from __future__ import annotations

import inspect
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar

import attrs
import click

from fenics_ehd.base.compile_lock import forms_folder
from fenics_ehd.base.errors import SettingsError, VerificationError
from fenics_ehd.base.files import CACHE_OFF, CACHE_VARIABLE, to_json
from fenics_ehd.base.needs import NO_TEMPERATURE, NONE, Needs, Setting, missing_need, no_effect
from fenics_ehd.base.printed import escaped
from fenics_ehd.base.progress import say
from fenics_ehd.base.settings import declared
from fenics_ehd.base.units import in_unit, parse_number, unit_of


def echo(text: object, *, err: bool = False) -> None:
    """Print a text with its control characters escaped; to standard error as `say` does."""
    if err:
        say(str(text))
    else:
        click.echo(escaped(str(text)))


def warn_of(lines: Iterable[str]) -> None:
    """Print warnings to standard error, on the first rank."""
    _say(f"fenics-ehd: warning: {line}" for line in lines)


def say_reducing(reduced: Iterable[str], read: Iterable[str]) -> None:
    """Print the names of the bodies to reduce, and of the bodies to read from the cache.

    Both lists are in one line. A note is added if finite element forms must be compiled first.
    """
    listed = ", ".join(reduced)
    compiled = any(forms_folder().glob("libffcx_forms_*.so"))
    once = "" if compiled else " (forms are compiled once, in about half a minute)"
    texts = [f"reducing {listed}{once}"] if listed else []
    if kept := ", ".join(read):
        texts.append(f"reading {kept} from the cache (--no-cache reduces anew)")
    _say(["; ".join(texts)] if texts else [])


def _say(lines: Iterable[str]) -> None:
    from mpi4py import MPI  # not needed for help

    if MPI.COMM_WORLD.rank == 0:
        for line in lines:
            echo(line, err=True)


Command = TypeVar("Command", bound=Callable[..., Any])


def question(text: str) -> Callable[[click.Command], click.Command]:
    """Declare the question that a command answers; it is the first line of the command's help.

    The text is also the command's line in the list of all commands. It has the words that users of
    the field search for.
    """

    def add(command: click.Command) -> click.Command:
        command.help = f"{text}\n\n{inspect.cleandoc(command.help or '')}"
        return command

    return add


#: Types of options whose value is the path of a file, and of a folder.
FILE = click.Path(dir_okay=False)
FOLDER = click.Path(file_okay=False)


class Dependent(click.Option):
    """Option of a command; it is refused if other options leave it without effect.

    Parameters
    ----------
    needs
        Conditions on other options of the command, under which this option has an effect.
    """

    def __init__(self, *names: Any, needs: Sequence[Needs] = (), **more: Any):
        super().__init__(*names, **more)
        self._needs = needs

    def handle_parse_result(
        self, ctx: click.Context, opts: Mapping[str, Any], args: list[str]
    ) -> tuple[Any, list[str]]:
        """Return the value of the option; if it is not the default, check the conditions first."""
        value, rest = super().handle_parse_result(ctx, opts, args)
        name = str(self.name)
        if name in opts and value != self.get_default(ctx):
            why = missing_need(self._needs, partial(_parameter, ctx.command, opts))
            if why:
                raise no_effect(_written(self, opts[name]), value, why)
        return value, rest


def _parameter(command: click.Command, parsed: Mapping[str, Any], name: str) -> Setting | None:
    """Option of a command with a given `name`, and its value; None if there is no such option."""
    for parameter in command.params:
        if parameter.name == name:
            value = parsed.get(name, parameter.default)
            # Some versions of click have a sentinel in place of None.
            plain = isinstance(value, (bool, int, float, str, tuple, list))
            return Setting(_written(parameter, True), value if plain else None)
    return None


def _written(parameter: click.Parameter, value: Any) -> str:
    """Name of an option as written on the command line; ``--no-...`` for a switch that is off."""
    off = value is False and parameter.secondary_opts
    return (parameter.secondary_opts if off else parameter.opts)[-1]


def option(*names: str, needs: Sequence[Needs] = (), **more: Any) -> Callable[[Command], Command]:
    """Declare an option of a command; it is refused if its conditions `needs` are not met."""
    return click.option(*names, cls=Dependent, needs=needs, **more)


def flag(name: str, help_text: str, needs: Sequence[Needs] = ()) -> Callable[[Command], Command]:
    """Declare an option without a value: it is true if it is on the command line, else false."""
    return option(name, is_flag=True, help=help_text, needs=needs)


def require_once(context: click.Context, command: click.Command, arguments: list[str]) -> None:
    """Refuse an option that is given twice, unless it is repeatable or a switch.

    Raises
    ------
    SettingsError
        An option has two values, of which only the last would have an effect.
    """
    with suppress(click.UsageError):  # the command itself reports it
        parser = command.make_parser(click.Context(command, parent=context))
        _, _, order = parser.parse_args(list(arguments))
        for parameter, times in Counter(order).items():
            once = isinstance(parameter, click.Option) and not parameter.is_flag
            if once and times > 1 and not parameter.multiple:
                name = parameter.opts[-1]
                raise SettingsError(f"{name} is given {times} times: give it once")


class Integer(click.ParamType):
    """Type of an option: a whole number in decimal digits."""

    name = "integer"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert the text of an option to a whole number; click calls this method."""
        if isinstance(value, str) and not re.fullmatch(r"[+-]?[0-9]{1,300}", value.strip()):
            self.fail(f"{value[:40]!r} is not a whole number", param, ctx)
        return int(value)


class Whole(click.IntRange):
    """Type of an option: a whole number in decimal digits, within limits."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert an option's text to a whole number within limits; click calls this method."""
        return super().convert(Integer().convert(value, param, ctx), param, ctx)


class Real(click.FloatRange):
    """Type of an option: a finite number, within limits."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert the text of an option to a number within limits; click calls this method."""
        if isinstance(value, str):
            try:
                value = parse_number(value)
            except ValueError as error:
                self.fail(str(error), param, ctx)
            if abs(value) == float("inf"):
                self.fail(f"{value} is not finite: give a finite number", param, ctx)
        return super().convert(value, param, ctx)


#: Texts that Python converts to numbers that are not finite.
NOT_FINITE = ("nan", "inf", "-inf")


class Measured(click.ParamType):
    """Type of an option: a number in the unit of the help text, or with its own unit, ``5 kN``.

    The help text ends with the unit in brackets, ``[N]``.
    """

    name = "float"

    def __init__(self, help_text: str):
        self.unit = unit_of(help_text)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert an option's text to a number in the option's unit; click calls this method."""
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


class MeasuredRange(Measured):
    """Type of an option: as `Measured`; or several values, which are returned as a tuple.

    Several values are written as for ``sweep --set``: numbers and ranges ``a:b:n`` with commas
    between them, each with or without a unit.
    """

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert an option's text to a number or a tuple of numbers; click calls this method."""
        if not isinstance(value, str) or not re.search("[:,]", value):
            return super().convert(value, param, ctx)
        from fenics_ehd.study.cases import parse_quantities

        option_name = "value" if param is None else param.opts[0]
        return parse_quantities(option_name, value, self.unit)


#: Default values that mean "not set", and are not shown in a help text.
NOT_GIVEN = (NONE, NO_TEMPERATURE, (0.0, 0.0))


def setting_options(
    cls: type, *without: str, defaults: bool = True, needs: Sequence[Needs] = ()
) -> Callable[[Command], Command]:
    """Declare one option for each setting of a class, with the setting's help text and unit.

    Settings named in `without` get no option. If `defaults` is false, the value of an option that
    is not on the command line is None. All options have the conditions `needs`, see `Dependent`;
    conditions that the class declares are checked when the settings are made.
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


def _without_cache(context: click.Context, _option: click.Parameter, chosen: bool) -> None:
    """Switch the cache of reduced bodies off, for a command and the processes that it starts."""
    if not chosen:
        return
    former = os.environ.get(CACHE_VARIABLE)
    os.environ[CACHE_VARIABLE] = CACHE_OFF

    def restore() -> None:
        os.environ.pop(CACHE_VARIABLE)
        if former is not None:
            os.environ[CACHE_VARIABLE] = former

    context.call_on_close(restore)


#: Option ``--no-cache`` of commands that reduce parts.
no_cache_option = click.option(
    "--no-cache",
    is_flag=True,
    expose_value=False,
    callback=_without_cache,
    help="Reduce all parts anew: neither read nor keep reduced bodies in the cache, which "
    "'info --cache' lists.",
)

json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print results as JSON, and nothing else, on stdout."
)


#: Pattern of a printed number that is not finite; it excludes names at the start of a line, and
#: files "in nan".
UNPRINTABLE = re.compile(r"(?<=\S)(?<! in) +[-+]?(nan|inf)(?=[\s,;%)]|$)")


def answer(result: Mapping[str, Any], text: str, as_json: bool) -> None:
    """Print a result: its values as JSON if `as_json` is true, otherwise the text.

    In JSON, a number that is not finite is printed as null. In a text it is refused.

    Raises
    ------
    VerificationError
        The text has a number that is not finite; the message has the keys of all such numbers.
    """
    unknown = [] if as_json else [line.strip() for line in text.split("\n") if _unknown(line)]
    keys = sorted(set(_not_finite(result))) if unknown else []
    if keys:
        raise VerificationError(
            f"{', '.join(keys)}: not a finite number, in the line {unknown[0]!r}"
        )
    echo(to_json(result) if as_json else text)


def _unknown(line: str) -> bool:
    return UNPRINTABLE.search(line) is not None


def _not_finite(result: Any, key: str = "") -> Iterator[str]:
    """Keys of the numbers in a nested result that are not finite.

    A number in a list has the key of the list; `key` is the key of the result itself.
    """
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
    """Lines of a table from rows of cells.

    Columns whose indices are in `words` are aligned on the left, all others on the right.
    """
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
    """Declare option ``-o``, the path of an output; the command gets it as its argument `name`."""
    path = FOLDER if folder else FILE
    names = "-o", "--output", name
    return option(*names, type=path, help=help_text, required=required, needs=needs)


#: Option ``--workers`` of commands that run many cases.
workers_option = click.option(
    "--workers",
    type=Whole(min=1),
    help="Number of processes [default: number of available cores]; use 1 to compare run times.",
)
