"""``fenics-ehd sensitivity``: derivatives of what a run answers along numbers of its scene."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.cli.options import answer, json_option

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.analysis.sensitivity import Figure
    from fenics_ehd.study.sensitivity import Along, SceneSensitivity


#: How a derivative was found: with the reduced bodies of the run, or one reduced anew.
METHODS = "differences in the same steps", "differences in the same steps, reduced anew"


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
@click.option(
    "--finer-film/--no-finer-film",
    "finer",
    default=True,
    help="Whether each is found on finer films, too, and its change printed: most of the time.",
)
@json_option
def sensitivity(
    scene: str, quantities: tuple[str, ...], keys: tuple[str, ...], finer: bool, as_json: bool
) -> None:
    """Run SCENE, and print derivatives of what it answers along its numbers.

    By differences of the run with each number changed by 1 % to either side, in the same steps.
    """
    from fenics_ehd.scenes.scene import as_stored
    from fenics_ehd.study.sensitivity import scene_sensitivity

    found = scene_sensitivity(as_stored(scene), quantities, keys, finer=finer)
    answer(_document(scene, found), _table(scene, found), as_json)


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
                        "on_finer_film": found.finer.get((figure, number.key)),
                        "method": METHODS[number.key in found.reduced],
                    }
                    for number in found.numbers
                },
            }
            for figure in found.figures
        },
        "processor_time_s": dict(found.seconds),
    }


def _units(figure: Figure, number: Along) -> str:
    """Unit of a derivative, ``Pa/(rad/s)``."""
    from fenics_ehd.base.columns import split_unit

    own, along = split_unit(figure.column)[1], number.unit or "1"
    return f"{own}/({along})" if re.search("[ /]", along) else f"{own}/{along}"


def _finer(found: SceneSensitivity, figure: Figure, number: Along) -> str:
    """The change on a finer film, where it was looked for and there is one."""
    slope, fine = (own.get((figure, number.key)) for own in (found.derivatives, found.finer))
    return f"{100 * (fine / slope - 1):+.2g} % on a finer film, " if fine and slope else ""


def _table(scene: str, found: SceneSensitivity) -> str:
    width = max(len(number.key) for number in found.numbers)
    lines = [f"{scene}: derivatives d q / d p, elasticities d ln q / d ln p"]
    for figure in found.figures:
        lines.append(f"  {figure.joint}.{figure.name} = {found.values[figure]:.6g}")
        for number in found.numbers:
            elasticity = found.elasticity(figure, number)
            relative = "        -" if elasticity is None else f"{elasticity:9.4f}"
            lines.append(
                f"    {number.key:{width}} = {number.value:<12.6g} "
                f"{found.derivatives[figure, number.key]:12.5g} {_units(figure, number):12} "
                f"{relative}  {_finer(found, figure, number)}"
                f"{METHODS[number.key in found.reduced]}"
            )
    seconds = ", ".join(f"{name} {value:.1f} s" for name, value in found.seconds.items() if value)
    return "\n".join([*lines, f"  time: {seconds}"])
