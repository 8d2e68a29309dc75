"""``fenics-ehd animate``: the machine of a run as GIF or MP4."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.plotting.animation_shape import PartShape
    from fenics_ehd.reduction import ReducedBody

#: File name where none is given.
DEFAULT_NAME = "animation.gif"


@click.command()
@click.argument("directory", type=click.Path(file_okay=False))
@click.option(
    "-o",
    "--output",
    "target",
    type=click.Path(dir_okay=False),
    help=f"File, .gif or .mp4 (which needs ffmpeg) [default: DIRECTORY/{DEFAULT_NAME}].",
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
    help="Enlargement of displacements and clearance [default: so that both are seen].",
)
@click.option(
    "--basis",
    type=click.Path(dir_okay=False),
    help="Basis of the whole part, made by 'reduce --basis' [default: a bore drawn as a ring].",
)
@click.option(
    "--body",
    "body_file",
    type=click.Path(dir_okay=False),
    help="Reduced body of the run [default: DIRECTORY/body.h5].",
)
def animate(
    directory: str,
    target: str | None,
    frames: int,
    rate: int,
    scale: float | None,
    basis: str | None,
    body_file: str | None,
) -> None:
    """Show a run of the slider-crank or the rotor: deformed part, film pressure, curves.

    DIRECTORY holds a run, also one that was stopped or still goes on. Between recorded steps,
    motion and pressure follow straight lines.
    """
    import sys

    from tqdm import tqdm

    from fenics_ehd.commands.machine_run import BODY_NAME
    from fenics_ehd.errors import InputError
    from fenics_ehd.plotting.animation import require_animation_format, save_animation
    from fenics_ehd.reduction import load_body

    path = Path(target or Path(directory) / DEFAULT_NAME)
    require_animation_format(path)
    settings = _settings(Path(directory))
    stored = Path(body_file or Path(directory) / BODY_NAME)
    if not stored.is_file():
        raise InputError(f"{stored}: missing; give the reduced body of the run by --body")
    body = load_body(stored)
    subject = _subject(settings, body, Path(directory), frames, scale, basis)
    with tqdm(total=len(subject.time), unit="frame", file=sys.stderr, mininterval=0.5) as bar:
        save_animation(subject, path, rate, bar.update)
    click.echo(path)


def _settings(directory: Path) -> Any:
    """Scene of a run, by its own file.

    Raises
    ------
    InputError
        The folder holds no scene, or one that is not of a machine.
    """
    from fenics_ehd.commands.machine_run import SCENE_NAME
    from fenics_ehd.commands.rotor import read_settings
    from fenics_ehd.commands.scene_kinds import tables_of
    from fenics_ehd.commands.scenes import read_scene
    from fenics_ehd.errors import InputError

    scene = directory / SCENE_NAME
    if not scene.is_file():
        raise InputError(f"{scene}: missing, {directory} is not a run of slider-crank or rotor")
    rotor = tables_of(str(scene), "rotor")
    if rotor is not None:
        return read_settings(str(scene), rotor)
    return read_scene(str(scene))[0]


def _subject(
    settings: Any,
    body: ReducedBody,
    directory: Path,
    frames: int,
    scale: float | None,
    basis: str | None,
) -> Any:
    """What the run's folder says, at instants of equal distance."""
    import numpy as np

    from fenics_ehd.errors import InputError
    from fenics_ehd.motion import read_motion
    from fenics_ehd.output import read_history
    from fenics_ehd.plotting.animation_subjects import rotor_subject, slider_crank_subject

    steps = read_motion(directory)
    if len(steps.time) < 2:
        raise InputError(f"{directory}: 1 step on the disk, an animation needs 2: let it run on")
    expected = body.modes, len(body.pressure_nodes)
    own = body.modes + (settings.shaft.modes if settings.scene == "rotor" else 2)
    if steps.coordinates.shape[1] < own or steps.pressure.shape[1] != expected[1]:
        raise InputError(
            f"the body's {expected[0]} modes and {expected[1]} pressure nodes are not those of "
            f"the run in {directory}: give its own by --body"
        )
    motion = steps.at(np.linspace(steps.time[0], steps.time[-1], frames))
    subject = rotor_subject if settings.scene == "rotor" else slider_crank_subject
    shape = _shape(settings, body, directory, basis)
    return subject(settings, body, shape, motion, read_history(directory), scale)


def _shape(settings: Any, body: ReducedBody, directory: Path, basis: str | None) -> PartShape:
    """What shows of the part. Its model, a program, is not run for a picture.

    Raises
    ------
    InputError
        The basis given is not that of the body.
    """
    from fenics_ehd.commands.machine_run import SCENE_NAME
    from fenics_ehd.errors import InputError
    from fenics_ehd.plotting.animation_shape import shape_of_basis, shape_of_bore
    from fenics_ehd.reduction import BasisFile

    if basis is None:
        part = "housing" if settings.scene == "rotor" else "conrod"
        click.echo(
            "only the bore is drawn deformed; the whole part: fenics-ehd reduce "
            f"{part} --scene {directory / SCENE_NAME} -o body.h5 --basis part.h5, then --basis "
            "part.h5 here",
            err=True,
        )
        return shape_of_bore(body)
    with BasisFile(basis) as file:
        shape = shape_of_basis(file, body)
    if shape is None:
        raise InputError(
            f"--basis {basis}: not the basis of the run's body with its {body.modes} modes"
        )
    return shape
