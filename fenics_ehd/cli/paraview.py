"""``fenics-ehd paraview``: a run's series for ParaView, made after it."""

from __future__ import annotations

from pathlib import Path

import click

from fenics_ehd.cli.options import output_option


@click.command()
@click.argument("directory", type=click.Path(file_okay=False))
@output_option("target", "Folder for the series [default: DIRECTORY/vtk].")
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    default=60,
    show_default=True,
    help="At most how many recorded steps.",
)
@click.option(
    "--basis",
    "bases",
    multiple=True,
    type=click.Path(dir_okay=False),
    help="Basis of a whole flexible body, made by 'reduce --basis' [default: lines].",
)
def paraview(directory: str, target: str | None, frames: int, bases: tuple[str, ...]) -> None:
    """Write run.pvd, one file for ParaView: bodies and films of a run as they move.

    DIRECTORY holds a run, also one that was stopped or still goes on. Nothing is meshed for it.
    """
    from fenics_ehd.base.folder import claim
    from fenics_ehd.base.output import require_writable
    from fenics_ehd.plotting.recorded import recorded
    from fenics_ehd.results.load import load_results
    from fenics_ehd.results.paraview import write_run
    from fenics_ehd.results.part_fields import parts_of_bases
    from fenics_ehd.results.run_folder import SERIES

    folder = Path(target or Path(directory) / "vtk")
    require_writable(folder)
    if target is None:
        claim(Path(directory), [SERIES])
    result = load_results(directory).last_cycle()
    run = recorded(directory, result)
    parts = parts_of_bases(run.bodies, bases)
    click.echo(write_run(run.system.mechanism, result, parts, folder, frames))
