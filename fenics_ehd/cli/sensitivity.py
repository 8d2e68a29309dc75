"""``fenics-ehd sensitivity``: derivatives of what a run answers along numbers of its scene."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.cli.options import json_option

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.multibody.sensitivity import Figure
    from fenics_ehd.study.sensitivity import Along, SceneSensitivity


@click.command()
@click.argument("scene")
@click.option(
    "--of",
    "quantities",
    multiple=True,
    required=True,
    metavar="JOINT.QUANTITY",
    help="Extreme or mean over the cycle: big_end.min_film_thickness, big_end.max_pressure, "
    "mean_friction_power, max_force_x. Repeatable.",
)
@click.option(
    "--to",
    "keys",
    multiple=True,
    required=True,
    metavar="KEY",
    help="Number of the scene, joints.big_end.clearance or its end; of a pair, "
    "forces.load.force.x. Repeatable.",
)
@json_option
def sensitivity(
    scene: str, quantities: tuple[str, ...], keys: tuple[str, ...], as_json: bool
) -> None:
    """Run SCENE, and print derivatives of what it answers along its numbers.

    Through the steps of the run where a number leaves reduced bodies as they are, else by
    differences of whole runs.
    """
    from fenics_ehd.base.output import to_json
    from fenics_ehd.scenes.scene_text import as_stored
    from fenics_ehd.study.sensitivity import scene_sensitivity

    found = scene_sensitivity(as_stored(scene), quantities, keys)
    click.echo(to_json(_document(scene, found)) if as_json else _table(scene, found))


def _document(scene: str, found: SceneSensitivity) -> dict[str, Any]:
    return {
        "scene": scene,
        "quantities": {
            f"{figure.joint}.{figure.name}": {
                "value": found.values[figure],
                "along": {
                    number.key: {
                        "at": number.value,
                        "derivative": found.derivatives[figure, number.key],
                        "units": _units(figure, number),
                        "elasticity": found.elasticity(figure, number),
                        "method": found.methods[number.key],
                        "reach": found.reach.get(number.key) if number.relative else None,
                    }
                    for number in found.numbers
                },
            }
            for figure in found.figures
        },
        "sweeps": found.sweeps,
        "processor_time_s": dict(found.seconds),
    }


def _units(figure: Figure, number: Along) -> str:
    """Of a derivative, ``Pa/(rad/s)``."""
    from fenics_ehd.base.columns import split_unit

    own, along = split_unit(figure.column)[1], number.unit or "1"
    return f"{own}/({along})" if re.search("[ /]", along) else f"{own}/{along}"


def _table(scene: str, found: SceneSensitivity) -> str:
    width = max(len(number.key) for number in found.numbers)
    lines = [f"{scene}: derivatives d q / d p, elasticities d ln q / d ln p"]
    for figure in found.figures:
        lines.append(f"  {figure.joint}.{figure.name} = {found.values[figure]:.6g}")
        for number in found.numbers:
            elasticity = found.elasticity(figure, number)
            reach = ""
            if number.key in found.reach and number.relative:
                reach = f", reach {100 * found.reach[number.key]:.2g} %"
            relative = "        -" if elasticity is None else f"{elasticity:9.4f}"
            lines.append(
                f"    {number.key:{width}} = {number.value:<12.6g} "
                f"{found.derivatives[figure, number.key]:12.5g} {_units(figure, number):12} "
                f"{relative}  "
                f"{found.methods[number.key]}{reach}"
            )
    if found.reach:
        lines.append("  reach: change of the number that changes a film somewhere by a tenth")
    seconds = ", ".join(f"{name} {value:.1f} s" for name, value in found.seconds.items() if value)
    return "\n".join([*lines, f"  time: {seconds}"])
