"""Options that several commands have."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import unit_of
from fenics_ehd.base.units import in_unit

Command = TypeVar("Command", bound=Callable[..., Any])


class Measured(click.ParamType):
    """A number, or one with its unit, ``5 kN``, in that which a help text has in brackets."""

    name = "float"

    def __init__(self, help_text: str):
        self.unit = unit_of(help_text)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """See click."""
        try:
            return float(value)
        except ValueError:
            pass
        try:
            return in_unit(value, self.unit)
        except SettingsError as error:
            self.fail(f"{value!r} {error}", param, ctx)


json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print results as JSON on stdout, nothing else there."
)


def output_option(
    name: str, help_text: str, *, folder: bool = True, required: bool = False
) -> Callable[[Command], Command]:
    """``-o``, a folder or a file, under the name of an argument."""
    path = click.Path(file_okay=not folder, dir_okay=folder)
    return click.option("-o", "--output", name, type=path, help=help_text, required=required)


#: Shared by commands that run many cases.
workers_option = click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes [default: the cores this one may use]; with 1 no run disturbs another.",
)
