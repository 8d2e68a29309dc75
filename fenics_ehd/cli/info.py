"""``fenics-ehd info``: what is installed."""

from __future__ import annotations

import click

from fenics_ehd.cli.options import json_option


@click.command()
@json_option
def info(as_json: bool) -> None:
    """Show versions and where the Gmsh models are."""
    from importlib import resources

    from fenics_ehd.base.output import to_json, versions
    from fenics_ehd.fem.models import model_path

    found = {
        **versions(installed=True),
        "package": str(resources.files("fenics_ehd")),
        **{f"{part}_model": str(model_path(part)) for part in ("conrod", "housing")},
    }
    lines = "\n".join(f"{name:14s} {value}" for name, value in found.items())
    click.echo(to_json(found) if as_json else lines)
