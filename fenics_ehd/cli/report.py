"""``fenics-ehd report``: the report of a study once more, also of one that goes on."""

from __future__ import annotations

import click


@click.command()
@click.argument("directory", type=click.Path(file_okay=False))
def report(directory: str) -> None:
    """Write report.html, report.md and figures/ of the study in DIRECTORY.

    'study' does so at its end; this also reports a study that still runs or was stopped.
    """
    from fenics_ehd.study.report import write_report

    click.echo(write_report(directory))
