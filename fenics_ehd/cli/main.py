"""Command line: modules of the commands, options of `run`, `reduce` and `init`, exit status.

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
    from fenics_ehd.base.errors import EhdError
    from fenics_ehd.base.libraries import foreign_numpy, library_fault, numpy_conflict
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
        no_cache_option,
        option,
        output_option,
        question,
        require_once,
        setting_options,
    )
    from fenics_ehd.scenes.part_settings import CELLS, METHODS, OutputSettings, ReductionSettings

#: Compiled libraries that pip installs only with the extra; Debian's packages are python3-NAME.
COMPILED = ("dolfinx", "petsc4py", "slepc4py", "mpi4py", "gmsh", "h5py")


#: Texts in the errors with which dolfinx reports a failed compilation to all ranks.
FAILED_FORMS = ("just-in-time compilation", "JIT compilation")


#: Least free address space with which a command starts: libraries and their buffers need it
#: [bytes].
LEAST_MEMORY = 768 << 20


#: Keys of [output] for which `run` has no option of the same name.
KEPT = ("plots", "error_limit", "part_mesh_error", "accuracy_keeps", "paraview")


#: Condition of options of `run` that exclude --resume, because a resumed run reads its settings
#: from its folder.
NEW_RUN = (Needs(("resume",), absent=True),)


#: Module of each command; the module is imported when one of its commands is called.
COMMANDS = {
    "animate": "pictures",
    "bearing": "bearing",
    "check": "check",
    "info": "check",
    "paper": "paper",
    "paraview": "pictures",
    "part": "part",
    "plot": "pictures",
    "report": "study",
    "rotor": "rotor",
    "sensitivity": "study",
    "stress": "pictures",
    "study": "study",
    "sweep": "study",
}


class Commands(click.Group):
    """Group of all commands; the commands in `COMMANDS` are imported when they are called."""

    def list_commands(self, context: click.Context) -> list[str]:
        """Names of all commands, sorted."""
        return sorted([*super().list_commands(context), *COMMANDS])

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Return a command by its name; its module is imported first."""
        if name not in COMMANDS:
            return super().get_command(context, name)
        command: click.Command = getattr(import_module(f"{__package__}.{COMMANDS[name]}"), name)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Command of the arguments, whose options are given once; click calls this method."""
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            require_once(ctx, command, rest)
        return name, command, rest


@click.group(
    cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(__version__, prog_name="fenics-ehd")
def cli() -> None:
    """Mechanisms with elastohydrodynamically lubricated revolute joints.

    Multibody simulation of machines with journal bearings: big ends of connecting rods, main
    bearings, rotors. The film is hydrodynamic or elastohydrodynamic (EHD, EHL), with cavitation.
    Finite element parts are reduced by component mode synthesis.
    """


@question("What film thickness (MOFT) and pressure (POFP) result?")
@cli.command()
@click.argument("scene", required=False)
@click.option(
    "--resume",
    type=FOLDER,
    help="Continue the run in this folder from its last checkpoint, instead of running SCENE.",
)
@click.option(
    "--checkpoint-every",
    "interval",
    type=Real(min=0),
    default=10.0,
    show_default=True,
    help="Seconds between two checkpoints.",
)
@option("--body", type=FILE, help="File of the flexible body, made by 'reduce'.", needs=NEW_RUN)
@option("--method", type=click.Choice(METHODS), help="Reduction method of parts.", needs=NEW_RUN)
@output_option("directory", "Folder for the results [default: results/SCENE].", needs=NEW_RUN)
@click.option("--plots/--no-plots", default=True, show_default=True, help="Draw result curves.")
@flag(
    "--vtk",
    "Write a ParaView series, vtk/run.pvd: the moving bodies and films with the film pressure, and "
    "elastic displacements for the filter 'Warp By Vector'.",
    needs=NEW_RUN,
)
@setting_options(OutputSettings, *KEPT, defaults=False, needs=NEW_RUN)
@flag("--overwrite", "Replace a complete result in the folder.", needs=NEW_RUN)
@flag(
    "--multiplier",
    "Also compute the largest Floquet multiplier of a periodic solution, its stability margin; "
    "this takes 4 to 14 more cycles.",
)
@no_cache_option
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
    """Simulate SCENE: a name listed by 'init', or a TOML file in the format that 'init' prints."""
    from fenics_ehd.cli import run
    from fenics_ehd.scenes.scene import input_files

    if (scene is None) == (resume is None):
        raise click.UsageError(
            "give either SCENE, to start a run, or --resume DIR, to continue a run"
        )
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


@question("How does an FE part become a superelement (Craig-Bampton)?")
@cli.command()
@click.argument("part")
@output_option("path", "HDF5 file of the reduced body.", folder=False, required=True)
@click.option(
    "--scene",
    type=FILE,
    help="Scene file with the settings of PART; the options below replace them.",
)
@click.option(
    "--cells",
    type=click.Choice(CELLS),
    help="Cells of the mesh: structured hexahedra (default) or unstructured 10-node tetrahedra.",
)
@setting_options(ReductionSettings, defaults=False)
@click.option(
    "--basis",
    "basis_path",
    type=FILE,
    help="Also write this HDF5 file with displacements and stresses of the complete part.",
)
@click.option(
    "--export",
    "exports",
    multiple=True,
    type=click.Choice(["npz", "op4", "dmig"]),
    help="Also export the body next to the HDF5 file: to a NumPy file, or as a Craig-Bampton "
    "superelement of Nastran (not of m4).",
)
@no_cache_option
@json_option
def reduce(**options: Any) -> None:
    """Reduce PART to a few modes; also runs under mpirun.

    PART is conrod, housing or, with --scene, the name or model of a flexible body of that scene.
    """
    from fenics_ehd.cli.reduction import reduce_part

    reduce_part(**options)


@question("Which scenes are shipped, and with which settings?")
@cli.command()
@click.argument("scene", required=False)
def init(scene: str | None) -> None:
    """Print the scene file SCENE with every setting explained; without SCENE, list all names."""
    from fenics_ehd.scenes.library import shipped, shipped_names

    echo("\n".join(shipped_names()) if scene is None else shipped(scene).rstrip("\n"))


def main(arguments: list[str] | None = None) -> None:
    """Run a command; an error of the package becomes one line and an exit status, on all ranks."""
    start_command()
    _open_streams()
    logging.disable(logging.INFO)  # the build log of just-in-time compiled forms
    command_line = sys.argv[1:] if arguments is None else arguments
    # dolfinx reads the arguments when it is imported, and accepts only UTF-8.
    sys.argv = [escaped(argument) for argument in sys.argv]
    with all_ranks() as comm:
        status, message = agreed(comm, *_outcome(command_line, alone=comm is None))
    if message:
        with suppress(OSError):  # the standard error output is closed
            echo(message, err=True)
    sys.exit(status)


def _outcome(arguments: list[str], *, alone: bool) -> tuple[int, str]:
    """Run a command; return its exit status and the message of its error, or an empty text."""
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
        missing = [name for name in COMPILED if find_spec(name) is None]
        if isinstance(error, ModuleNotFoundError) and missing:
            packages = " ".join(f"python3-{name}" for name in missing)
            return 1, _line(
                f"this Python, {sys.executable}, lacks {', '.join(missing)}: install them with "
                "pip install 'fenics-ehd[wheels]' (Python 3.12 or later); or install Debian's "
                f"packages {packages}, and use a Python that finds them, for example from "
                "/usr/bin/python3 -m venv --system-site-packages"
            )
        if fault := library_fault():
            return 1, _line(fault)
        module = type(error).__module__
        last = str(error).strip().rpartition("\n")[2]
        if "petsc4py" in module:
            return 1, _line(f"PETSc: {last}: check the values of the material")
        if any(text in str(error) for text in FAILED_FORMS):
            return 1, _line(f"CompilationError: {last.partition(' of form: ')[2] or last}")
        return 1, traceback.format_exc().rstrip()


def _require_arguments(arguments: list[str]) -> None:
    """Refuse an empty argument, which would mean the current folder or a default value.

    Raises
    ------
    click.UsageError
        An argument is empty; the message names the argument before it.
    """
    for before, argument in pairwise(["fenics-ehd", *arguments]):
        if not argument or (argument.startswith("--") and argument.endswith("=")):
            raise click.UsageError(
                f"{argument or before} is followed by an empty value: is a shell variable empty?"
            )


#: Commands and options that work without NumPy, or that explain why NumPy does not work.
WITHOUT_ARRAYS = {"init", "info", "check", "-h", "--help", "--version"}


def _require_arrays(arguments: list[str]) -> None:
    """Refuse a NumPy that differs from the one with which compiled libraries were built.

    Such libraries could end the process when they are imported.

    Raises
    ------
    EhdError
        Python would import another NumPy; the message has the path of that NumPy.
    """
    if not arguments or WITHOUT_ARRAYS & {arguments[0], arguments[-1]}:
        return
    fault = numpy_conflict() or (library_fault() if foreign_numpy() else "")
    if fault:
        raise EhdError(fault)


def _require_memory() -> None:
    """Refuse to start with too little memory, with which BLAS would wait forever for more.

    Raises
    ------
    EhdError
        The free address space is smaller than `LEAST_MEMORY`.
    """
    try:
        mmap(-1, LEAST_MEMORY, flags=MAP_PRIVATE | MAP_ANONYMOUS, prot=PROT_READ).close()
    except OSError:
        raise EhdError(
            f"less than {LEAST_MEMORY >> 20} MB of address space are free, but the libraries alone "
            "need as much: raise the limit with ulimit -v"
        ) from None


def _line(message: str) -> str:
    return f"fenics-ehd: {' '.join(message.split())}"


def _open_streams() -> None:
    """Connect closed standard streams to the null device.

    A file that is opened later would otherwise get the number of a closed stream, and receive what
    is printed.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest free number
            setattr(sys, name, open(number, mode, closefd=False))
