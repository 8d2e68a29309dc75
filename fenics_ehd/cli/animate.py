"""``fenics-ehd animate``: the mechanism of a run as GIF or MP4."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.cli.options import output_option

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.plotting.animation_shape import PartShape
    from fenics_ehd.results.replay import Replay

#: File name where none is given.
DEFAULT_NAME = "animation.gif"


@click.command()
@click.argument("directory", type=click.Path(file_okay=False))
@output_option(
    "target",
    f"File, .gif or .mp4 (which needs ffmpeg) [default: DIRECTORY/{DEFAULT_NAME}].",
    folder=False,
)
@click.option(
    "--joint", help="Lubricated joint whose film is drawn [default: that of the highest pressure]."
)
@click.option(
    "--frames",
    type=click.IntRange(min=2),
    default=80,
    show_default=True,
    help="Instants, at equal times over the run.",
)
@click.option(
    "--fps",
    "rate",
    type=click.IntRange(min=1, max=50),
    default=20,
    show_default=True,
    help="Frames a second.",
)
@click.option(
    "--scale",
    type=click.FloatRange(min=0, min_open=True),
    help="Enlargement of displacements and clearances [default: so that both are seen].",
)
@click.option(
    "--basis",
    "bases",
    multiple=True,
    type=click.Path(dir_okay=False),
    help="Basis of a whole flexible body, made by 'reduce --basis' [default: its bore, a ring].",
)
def animate(
    directory: str,
    target: str | None,
    joint: str | None,
    frames: int,
    rate: int,
    scale: float | None,
    bases: tuple[str, ...],
) -> None:
    """Show a run: its bodies and joints, the film of one joint, curves.

    DIRECTORY holds a run, also one that was stopped or still goes on; of a periodic run, its last
    cycle. Nothing is meshed for it.
    """
    import sys

    import numpy as np
    from tqdm import tqdm

    from fenics_ehd.base.folder import claim
    from fenics_ehd.plotting.animation import require_animation_format, save_animation
    from fenics_ehd.plotting.animation_figure import draw
    from fenics_ehd.plotting.recorded import recorded
    from fenics_ehd.results.load import load_results
    from fenics_ehd.results.replay import Replay

    path = Path(target or Path(directory) / DEFAULT_NAME)
    require_animation_format(path)
    result = load_results(directory).last_cycle()
    run = recorded(directory, result)
    if target is None:
        claim(path.parent, [DEFAULT_NAME])
    motion = run.motion
    if len(motion.time) < 2:
        raise InputError(f"{directory}: 1 step on the disk, an animation needs 2: let it run on")
    name = _chosen(run, joint)
    columns = result.joints[name].columns if name else {}
    instants = motion.at(np.linspace(motion.time[0], motion.time[-1], frames))
    shown = Replay(run.system.mechanism, instants)
    figure, show = draw(
        run,
        columns | {"time_s": np.asarray(result.time)},
        shown,
        _shapes(run, Path(directory), bases),
        name,
        scale,
    )
    with tqdm(total=frames, unit="frame", file=sys.stderr, mininterval=0.5) as bar:
        save_animation(figure, show, frames, path, rate, bar.update)
    click.echo(path)


def _chosen(run: Replay, joint: str | None) -> str:
    """Name of the joint whose film is drawn, empty where there is none."""
    pressures = run.motion.pressures
    if joint is not None and joint not in pressures:
        known = ", ".join(pressures) or "none"
        raise SettingsError(f"--joint {joint}: lubricated joints of this run: {known}")
    return joint or max(pressures, key=lambda name: pressures[name].max(), default="")


def _shapes(run: Replay, directory: Path, bases: tuple[str, ...]) -> dict[str, PartShape]:
    """What shows of the flexible bodies. Their models, programs, are not run for a picture.

    Raises
    ------
    SettingsError
        A basis given is that of no body.
    """
    from fenics_ehd.multibody.flexible_body import FlexibleBody
    from fenics_ehd.plotting.animation_shape import shape_of_bores, shape_of_part
    from fenics_ehd.results.part_fields import parts_of_bases
    from fenics_ehd.results.run_folder import SCENE_NAME
    from fenics_ehd.scenes.scene import meshed
    from fenics_ehd.scenes.scene_text import as_stored

    parts = {n: b.reduced for n, b in run.bodies.items() if isinstance(b, FlexibleBody)}
    shapes = {name: shape_of_bores(part) for name, part in parts.items()}
    whole = parts_of_bases(run.bodies, bases)
    shapes |= {name: shape_of_part(part) for name, part in whole.items()}
    models = meshed(as_stored(directory / SCENE_NAME))
    for name in (name for name, shape in shapes.items() if not shape.mesh):
        made = (
            f"made by fenics-ehd reduce {name} --scene {directory / SCENE_NAME} --method "
            f"{parts[name].method} -o body.h5 --basis part.h5"
            if name in models
            else "which can be made where the file of this body is"
        )
        click.echo(
            f"of {name} only the bores are drawn; all of it with --basis part.h5, {made}", err=True
        )
    return shapes
