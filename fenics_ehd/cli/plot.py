"""``fenics-ehd plot``: pictures of runs."""

from __future__ import annotations

from pathlib import Path

import click

from fenics_ehd.base.pictures import PICTURES
from fenics_ehd.cli.options import output_option


@click.command()
@click.argument("directories", nargs=-1, required=True, type=click.Path(file_okay=False))
@click.option("--joint", "joints", multiple=True, help="Lubricated joint [default: all].")
@click.option(
    "--quantity",
    "quantities",
    multiple=True,
    help=f"What to draw: {', '.join(PICTURES)} [default: all that the runs have].",
)
@click.option("--difference", is_flag=True, help="Draw the second of two runs less the first.")
@output_option("target", "Folder for the pictures [default: the first of DIRECTORIES].")
def plot(
    directories: tuple[str, ...],
    joints: tuple[str, ...],
    quantities: tuple[str, ...],
    difference: bool,
    target: str | None,
) -> None:
    """Draw the last cycle of the joints of one or more runs, several in one picture.

    Prints the names of the pictures, PNG and SVG. Those of several runs have names of their own,
    NAME-comparison or NAME-difference.
    """
    from fenics_ehd.base.output import require_writable
    from fenics_ehd.plotting.pictures import Pictures

    runs = {Path(d).name or str(d): Path(d) for d in directories}
    if len(runs) < len(directories):
        runs = {str(d): Path(d) for d in directories}
    folder = Path(target or directories[0])
    require_writable(folder)
    pictures = Pictures(runs, joints, difference=difference)
    pictures.require(quantities)
    for name in quantities or pictures.names:
        for path in pictures.draw(name, folder):
            click.echo(path)
