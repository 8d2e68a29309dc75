"""``fenics-ehd plot``, ``animate``, ``paraview`` and ``stress``: pictures and fields of a run.

Imports inside functions: ``--help`` must work without matplotlib and runs, and quickly.
"""

from __future__ import annotations

from pathlib import Path

import click

from fenics_ehd.base.files import PICTURES, claim, require_kept, require_writable
from fenics_ehd.base.needs import Needs
from fenics_ehd.base.renamed import renamed_message
from fenics_ehd.cli.options import (
    FILE,
    FOLDER,
    Real,
    Whole,
    answer,
    echo,
    flag,
    json_option,
    no_cache_option,
    output_option,
    question,
    warn_of,
)


@question("How do oil film thickness and pressure change in a cycle?")
@click.command()
@click.argument("directories", nargs=-1, required=True, type=FOLDER)
@click.option("--joint", "joints", multiple=True, help="Lubricated joint [default: all].")
@click.option(
    "--quantity",
    "quantities",
    multiple=True,
    metavar="[JOINT.]QUANTITY",
    help=f"Quantity to draw, for all joints or for one: {', '.join(PICTURES)} [default: all that "
    "the runs have].",
)
@flag("--difference", "Draw the difference of two runs: the second minus the first.")
@output_option("target", "Folder for the pictures [default: the first of DIRECTORIES].")
def plot(
    directories: tuple[str, ...],
    joints: tuple[str, ...],
    quantities: tuple[str, ...],
    difference: bool,
    target: str | None,
) -> None:
    """Draw the last cycle of the joints of one run, or of several runs in the same pictures.

    The command prints the names of the files, PNG and SVG. The names of pictures of several runs
    end with -comparison or -difference.
    """
    from fenics_ehd.plotting.pictures import Pictures

    runs = {Path(d).name or str(d): Path(d) for d in directories}
    if len(runs) < len(directories):
        runs = {str(d): Path(d) for d in directories}
    folder = Path(target or directories[0])
    require_writable(folder)
    pictures = Pictures(runs, joints, difference=difference)
    pictures.require(quantities)
    warn_of(
        renamed_message(f"--quantity {name}", f"--quantity {pictures.full_name(name)}")
        for name in quantities
        if pictures.full_name(name) != name and not joints
    )
    if not any(folder.resolve() == run.resolve() for run in runs.values()):
        claim(folder, (), "plot")
    for name in quantities or pictures.names:
        for path in pictures.draw(name, folder):
            echo(path)


#: Default name of the file with the animation.
DEFAULT_NAME = "animation.gif"


@question("How do the bodies and the oil film of a run move?")
@click.command()
@click.argument("directory", type=FOLDER)
@output_option(
    "target",
    f"File to write, .gif or .mp4 (which needs ffmpeg) [default: DIRECTORY/{DEFAULT_NAME}].",
    folder=False,
)
@click.option(
    "--joint", help="Joint whose film is drawn [default: joint with the highest pressure]."
)
@click.option(
    "--frames",
    type=Whole(min=2),
    default=80,
    show_default=True,
    help="Number of frames, at equal time intervals over the run.",
)
@click.option(
    "--fps",
    "rate",
    type=Whole(min=1, max=50),
    default=20,
    show_default=True,
    help="Frames per second.",
)
@click.option(
    "--scale",
    type=Real(min=0, min_open=True),
    help="Magnification of displacements and clearances [default: so that both are visible].",
)
@click.option(
    "--basis",
    "bases",
    multiple=True,
    type=FILE,
    help="Basis file of a flexible body, made by 'reduce --basis', to draw the complete body "
    "[default: its bore as a ring].",
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
    """Animate a run: bodies and joints, the film of one joint, and curves.

    DIRECTORY holds a run, which may be incomplete or in progress. For a periodic run, the last
    cycle is shown. No part is meshed again.
    """
    from fenics_ehd.base.progress import shown_progress
    from fenics_ehd.plotting.animation import draw_run, require_animation_format, save_animation

    path = Path(target or Path(directory) / DEFAULT_NAME)
    require_animation_format(path, [*Path(directory).glob("*.h5"), *bases])
    figure, show, hints = draw_run(Path(directory), joint, frames, scale, bases)
    if target is None:
        claim(path.parent, [DEFAULT_NAME])
    for hint in hints:
        echo(hint, err=True)
    with shown_progress(logs=True).stage("animation", frames, "frames") as stage:
        save_animation(figure, show, frames, path, rate, stage.add)
    echo(path)


@question("How do I see the fields of a run in ParaView?")
@click.command()
@click.argument("directory", type=FOLDER)
@output_option("target", "Folder for the series [default: DIRECTORY/vtk].")
@click.option(
    "--frames",
    type=Whole(min=1),
    default=60,
    show_default=True,
    help="Largest number of recorded steps to write.",
)
@click.option(
    "--basis",
    "bases",
    multiple=True,
    type=FILE,
    help="Basis file of a flexible body, made by 'reduce --basis', to write the complete body "
    "[default: lines].",
)
def paraview(directory: str, target: str | None, frames: int, bases: tuple[str, ...]) -> None:
    """Write run.pvd, a ParaView series of the moving bodies and films of a run.

    DIRECTORY holds a run, which may be incomplete or in progress. No part is meshed again.
    """
    from fenics_ehd.multibody.history import load_history
    from fenics_ehd.plotting.shown import moving_part, recorded
    from fenics_ehd.results.paraview import parts_of_bases, write_run
    from fenics_ehd.results.recorded_run import SERIES

    of = Path(directory)
    folder = Path(target or of / "vtk")
    require_writable(folder)
    if folder.resolve() == (of / "vtk").resolve():
        claim(of, [SERIES])
    else:
        claim(folder, (), "paraview")
    require_kept(folder, bases)
    result = moving_part(load_history(of))
    run = recorded(of, result)
    parts = parts_of_bases(run.bodies, bases)
    echo(write_run(run.system.mechanism, result, parts, folder, frames))


@question("Which stresses do the flexible bodies have over the cycle?")
@click.command()
@click.argument("directory", type=FOLDER)
@click.option(
    "--body",
    "chosen",
    multiple=True,
    help="Flexible body [default: all flexible bodies]. Repeatable.",
)
@click.option(
    "--damping/--no-damping",
    default=True,
    show_default=True,
    help="Whether the stress includes the part carried by material damping, so that it balances "
    "the loads, or is that of the elastic deformation alone.",
)
@flag(
    "--complete",
    "Add the static response to film pressures and to rotation that the basis lacks: for bodies "
    "reduced by m1, m2 and m3, whose modes contain only a part of it.",
    needs=(Needs(("damping",), (True,)),),
)
@click.option(
    "--model",
    "programs",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False),
    help="Allow this .geo model of the run, which is a program, to be executed. Repeatable.",
)
@no_cache_option
@json_option
def stress(
    directory: str,
    chosen: tuple[str, ...],
    damping: bool,
    complete: bool,
    programs: tuple[str, ...],
    as_json: bool,
) -> None:
    """Compute stresses of flexible bodies over the last cycle of a run.

    DIRECTORY holds a complete run. The parts are meshed again, and reduced again if their bodies
    are not in the cache. The command writes stress.json and vtk/BODY_stress.vtu. The half-range of
    the stress tensor is half the difference between the stresses of two instants. Both files
    contain the half-range with the largest von Mises stress over all pairs of instants, the mean
    stress of the same pair, and the largest principal stress.
    """
    from mpi4py import MPI

    from fenics_ehd.cli.stress import cycle_stresses, report

    if MPI.COMM_WORLD.rank:  # the other ranks have nothing to do
        return
    folder = Path(directory)
    stresses = cycle_stresses(folder, chosen, damping, complete, programs)
    answer(stresses, report(stresses, folder), as_json)
