"""Command line: the commands by module, options of `run`, `reduce` and `init`, exit status.

Imports inside functions: ``--help`` must work without the libraries of commands, and quickly.
"""

from __future__ import annotations

from fenics_ehd.base.processes import INTERRUPTED, ending_signals_raise

with ending_signals_raise():
    import io
    import logging
    import os
    import sys
    import traceback
    from contextlib import suppress
    from importlib import import_module
    from importlib.util import find_spec
    from itertools import pairwise
    from mmap import MAP_ANONYMOUS, MAP_PRIVATE, PROT_READ, mmap
    from pathlib import Path
    from typing import Any

    import click

    from fenics_ehd import __version__
    from fenics_ehd.base.command_start import start_command
    from fenics_ehd.base.compile_lock import forms_folder
    from fenics_ehd.base.errors import EhdError
    from fenics_ehd.base.libraries import foreign_numpy, library_fault
    from fenics_ehd.base.needs import Needs
    from fenics_ehd.base.printed import escaped
    from fenics_ehd.base.processes import agreed, all_ranks, require_alike
    from fenics_ehd.cli.options import (
        FILE,
        FOLDER,
        Real,
        echo,
        flag,
        json_option,
        option,
        output_option,
        setting_options,
    )
    from fenics_ehd.scenes.part_settings import CELLS, METHODS, OutputSettings, ReductionSettings

#: Libraries that pip does not install, of Debian's packages python3-NAME.
COMPILED = ("dolfinx", "petsc4py", "slepc4py", "mpi4py", "gmsh", "h5py")


#: Address space that libraries and their buffers need [bytes].
LEAST_MEMORY = 768 << 20


#: Keys of [output] for which `run` has no option of the same name.
KEPT = ("plots", "error_limit", "part_mesh_error", "accuracy_keeps", "paraview")


#: Condition of options of `run` that a resumed run reads from its folder.
NEW_RUN = (Needs(("resume",), absent=True),)


#: Commands by their module, which is imported when one of them is called.
COMMANDS = {
    "animate": "pictures",
    "bearing": "bearing",
    "check": "check",
    "info": "check",
    "paraview": "pictures",
    "part": "part",
    "plot": "pictures",
    "report": "study",
    "sensitivity": "study",
    "stress": "pictures",
    "study": "study",
    "sweep": "study",
}


class Commands(click.Group):
    """Commands of this module and of `COMMANDS`."""

    def list_commands(self, context: click.Context) -> list[str]:
        """Names of all."""
        return sorted([*super().list_commands(context), *COMMANDS])

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Import the module of a command and return the command."""
        if name not in COMMANDS:
            return super().get_command(context, name)
        command: click.Command = getattr(import_module(f"{__package__}.{COMMANDS[name]}"), name)
        return command


@click.group(
    cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(__version__, prog_name="fenics-ehd")
def cli() -> None:
    """Mechanisms with elastohydrodynamically lubricated revolute joints."""


@cli.command()
@click.argument("scene", required=False)
@click.option(
    "--resume",
    type=FOLDER,
    help="Go on with the run in this folder from its last checkpoint, in place of SCENE.",
)
@click.option(
    "--checkpoint-every",
    "interval",
    type=Real(min=0),
    default=10.0,
    show_default=True,
    help="Seconds between two checkpoints.",
)
@option("--body", type=FILE, help="Reduced part made by 'reduce'.", needs=NEW_RUN)
@option("--method", type=click.Choice(METHODS), help="Reduction of the part.", needs=NEW_RUN)
@output_option("directory", "Folder for the results [default: results/SCENE].", needs=NEW_RUN)
@click.option("--plots/--no-plots", default=True, show_default=True, help="Draw the curves.")
@flag(
    "--vtk",
    "Write a ParaView series, vtk/run.pvd: bodies and films as they move, their elastic "
    "displacement to warp by, the pressure.",
    needs=NEW_RUN,
)
@setting_options(OutputSettings, *KEPT, defaults=False, needs=NEW_RUN)
@flag("--overwrite", "Replace a complete result in the folder.", needs=NEW_RUN)
@flag(
    "--multiplier",
    "Also find the largest multiplier of a periodic solution, its margin of stability, which "
    "takes 4 to 14 cycles more.",
)
@json_option
def run(
    scene: str | None,
    resume: str | None,
    interval: float,
    body: str | None,
    method: str | None,
    directory: str | None,
    plots: bool,
    vtk: bool,
    overwrite: bool,
    multiplier: bool,
    as_json: bool,
    **output: bool | float | None,
) -> None:
    """Simulate SCENE: a name that 'init' lists, or a TOML file made by it."""
    from fenics_ehd.cli import run
    from fenics_ehd.scenes.scene import input_files

    if (scene is None) == (resume is None):
        raise click.UsageError("give a SCENE to run or --resume DIR, one of them")
    chosen = {key: value for key, value in output.items() if value is not None}
    options = run.RunOptions(plots, interval, as_json, multiplier)
    if scene is not None:
        target = Path(directory or Path("results") / Path(scene).stem)
        asked = chosen | ({"paraview": True} if vtk else {})
        changed = run.changed_scene(scene, body, method, asked)
        run.run(changed, target, overwrite, options, input_files(scene, changed))
        return
    assert resume is not None
    run.resume(Path(resume), options)


@cli.command()
@click.argument("part")
@output_option("path", "HDF5 file of the reduced body.", folder=False, required=True)
@click.option(
    "--scene",
    type=FILE,
    help="Scene file that has PART; options below win.",
)
@click.option(
    "--cells",
    type=click.Choice(CELLS),
    help="Structured hexahedra (the default) or unstructured 10-node tetrahedra.",
)
@setting_options(ReductionSettings, defaults=False)
@click.option(
    "--basis",
    "basis_path",
    type=FILE,
    help="HDF5 file for displacement and stress of the whole part.",
)
@click.option(
    "--export",
    "exports",
    multiple=True,
    type=click.Choice(["npz"]),
    help="Also write the body for NumPy, next to the HDF5 file.",
)
@json_option
def reduce(**options: Any) -> None:
    """Reduce PART to a handful of modes; also under mpirun.

    PART is conrod, housing or, with --scene, a flexible body of that scene or its model.
    """
    from fenics_ehd.cli.reduction import reduce_part

    reduce_part(**options)


@cli.command()
@click.argument("scene", required=False)
def init(scene: str | None) -> None:
    """Print the scene file SCENE, every setting explained; without SCENE the names there are."""
    from fenics_ehd.scenes.library import shipped, shipped_names

    echo("\n".join(shipped_names()) if scene is None else shipped(scene).rstrip("\n"))


def main(arguments: list[str] | None = None) -> None:
    """Run a command: a named error becomes one line and an exit status, on any number of ranks."""
    start_command()
    _open_streams()
    logging.disable(logging.INFO)  # the build log of just-in-time compiled forms
    command_line = sys.argv[1:] if arguments is None else arguments
    # dolfinx reads these variables when it is imported, and only as UTF-8.
    sys.argv = [escaped(argument) for argument in sys.argv]
    with all_ranks() as comm:
        status, message = agreed(comm, *_outcome(command_line, alone=comm is None))
    if message:
        with suppress(OSError):  # the standard error output is closed
            echo(message, err=True)
    sys.exit(status)


def _outcome(arguments: list[str], *, alone: bool) -> tuple[int, str]:
    """Exit status of a command, and the message of its error, if any."""
    try:
        _require_memory()
        _require_arrays(arguments)
        if not alone:
            require_alike("command, or other arguments,", repr(arguments))
        _require_arguments(arguments)
        with ending_signals_raise():
            return cli.main(arguments, prog_name="fenics-ehd", standalone_mode=False) or 0, ""
    except click.ClickException as error:
        usage = io.StringIO()
        error.show(usage)
        return 2, usage.getvalue().rstrip()
    except EhdError as error:
        return error.exit_status, _line(f"{type(error).__name__}: {error}")
    except (KeyboardInterrupt, click.exceptions.Abort, BrokenPipeError):
        return INTERRUPTED, _line("interrupted")
    except MemoryError:
        return 1, _line("out of memory: choose fewer modes or a coarser mesh")
    except OSError as error:
        return 1, _line(f"{error.filename or 'output'}: {error.strerror or error}")
    except Exception as error:
        missing = [f"python3-{name}" for name in COMPILED if find_spec(name) is None]
        if isinstance(error, ModuleNotFoundError) and missing:
            return 1, _line(
                f"this Python, {sys.executable}, lacks Debian's packages {' '.join(missing)}: "
                "install them, and call one that sees them, /usr/bin/python3 -m venv "
                "--system-site-packages makes one"
            )
        if fault := library_fault():
            return 1, _line(fault)
        module = type(error).__module__
        last = str(error).strip().rpartition("\n")[2]
        if "petsc4py" in module:
            return 1, _line(f"PETSc: {last}: check the values of the material")
        if "cffi" in module or "just-in-time" in str(error):
            return 1, _line(f"forms are compiled by cc and stored in {forms_folder()}: {last}")
        return 1, traceback.format_exc().rstrip()


def _require_arguments(arguments: list[str]) -> None:
    """Refuse an empty argument, which would mean the current folder or a default value.

    Raises
    ------
    click.UsageError
        The message has the argument that precedes it.
    """
    for before, argument in pairwise(["fenics-ehd", *arguments]):
        if not argument or (argument.startswith("--") and argument.endswith("=")):
            raise click.UsageError(
                f"{argument or before} is followed by nothing: is a shell variable empty?"
            )


#: Commands and options that need no arrays, or explain a NumPy that does not work.
WITHOUT_ARRAYS = {"init", "info", "check", "-h", "--help", "--version"}


def _require_arrays(arguments: list[str]) -> None:
    """Refuse a NumPy that other libraries are not compiled for, before they are imported.

    Raises
    ------
    EhdError
        The message has the path of that NumPy.
    """
    if not arguments or WITHOUT_ARRAYS & {arguments[0], arguments[-1]} or not foreign_numpy():
        return
    if fault := library_fault():
        raise EhdError(fault)


def _require_memory() -> None:
    """Refuse to begin with too little memory: BLAS would retry forever and ignore signals.

    Raises
    ------
    EhdError
        The address space is too small for libraries and their buffers.
    """
    try:
        mmap(-1, LEAST_MEMORY, flags=MAP_PRIVATE | MAP_ANONYMOUS, prot=PROT_READ).close()
    except OSError:
        raise EhdError(
            f"less than {LEAST_MEMORY >> 20} MB of address space left, which libraries alone need: "
            "raise the limit, ulimit -v"
        ) from None


def _line(message: str) -> str:
    return f"fenics-ehd: {' '.join(message.split())}"


def _open_streams() -> None:
    """Open closed standard streams to the null device: other files must not get their numbers."""
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest free number
            setattr(sys, name, open(number, mode, closefd=False))
