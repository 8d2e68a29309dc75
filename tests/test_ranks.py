"""An error on one rank ends all of them, with its message and the status of a serial run."""

import re
import subprocess
import sys

import pytest
from scene_cases import write_scene

import fenics_ehd as ehd
from fenics_ehd.base.processes import for_mpirun, mpirun

#: A rod without elasticity, over the first degrees.
SHORT = {
    "bodies.rod.reduction": {"method": "rigid", "estimate_error": False},
    "time.revolutions": 0.02,
    "time.tolerance": 1e-3,
}

#: Status of ranks that wait for each other.
TOO_LONG = 124

COMMAND = f"exec {sys.executable} -m fenics_ehd.cli"


def on_ranks(*programs, folder):
    """Status and messages of programs and their arguments under one mpirun."""
    # Of a killed mpirun the ranks would go on: timeout asks it to end them.
    command = ["timeout", "120", mpirun(), *programs]
    done = subprocess.run(command, env=for_mpirun(), cwd=folder, capture_output=True, text=True)
    # Open MPI's own remarks may begin in the same line.
    messages = re.findall(r"fenics-ehd: .*|^Error: .*", done.stderr, flags=re.MULTILINE)
    return done.returncode, [text for text in messages if "warning" not in text], done.stderr


def two_ranks(line, folder):
    """Status and messages of a shell's line on two ranks, each of which knows its `$RANK`."""
    script = f"RANK=${{OMPI_COMM_WORLD_RANK:-$PMI_RANK}}; {line}"
    return on_ranks("-n", "2", "sh", "-c", script, folder=folder)


@pytest.fixture
def folder(tmp_path):
    write_scene(tmp_path / "scene0.toml", "slider-crank-paper", SHORT)
    return tmp_path


ALIKE = "fenics-ehd: SettingsError: rank 1 has another {} than rank 0: all ranks must have the same"

ARGUMENTS = "command, or other arguments,"

#: Command of each rank, and in what they differ; `own.toml` is each rank's own.
DIFFERENT = [
    ("bearing --eccentricity 0.5", "--version", ARGUMENTS),
    ("run scene0.toml -o out", "run", ARGUMENTS),
    ("reduce conrod -o x.h5", "reduce conrod -o x.h5 --method m1", ARGUMENTS),
    ("run own.toml -o out", "run own.toml -o out", "scene"),
    ("reduce rod --scene own.toml -o x.h5",) * 2 + ("part, or settings of it,",),
]

#: Obeys one command after the other; whether each ended as a refusal does.
ONE_BY_ONE = """
import sys
from fenics_ehd.cli.main import main
ended = []
for line in sys.argv[1:]:
    try:
        main(line.split())
    except SystemExit as end:
        ended.append(end.code)
sys.exit(ended != [2] * len(sys.argv[1:]))
"""


@pytest.mark.slow
def test_ranks_that_are_given_different_commands(folder):
    (folder / "commands.py").write_text(ONE_BY_ONE)
    own = SHORT | {"bodies.rod.reduction": {"method": "m1", "modes": 4}}
    for rank, changes in enumerate((own, own | {"bodies.rod.material.density": 7800.0})):
        (folder / f"{rank}").mkdir()
        write_scene(folder / f"{rank}" / "own.toml", "slider-crank-paper", changes)
    one, other = (" ".join(f"'{lines[rank]}'" for lines in DIFFERENT) for rank in (0, 1))
    python = f"cd $RANK; exec {sys.executable} ../commands.py"
    line = f"if test $RANK = 0; then {python} {one}; else {python} {other}; fi"
    status, reported, errors = two_ranks(line, folder)
    assert status == 0, errors
    assert reported == [ALIKE.format(what) for *_, what in DIFFERENT], errors
    assert not list(folder.glob("?/out"))


@pytest.mark.parametrize("other", ["--help", "reduce --help", "reduce conrod -o ''"])
def test_a_rank_with_another_command_ends_all_with_one_line(other, folder):
    """Rank 0 would wait for the other one in the middle of its reduction."""
    # By rank: of two programs with ":" between them, mpirun of Open MPI 5.0.7 itself crashes.
    one, another = (f"{COMMAND} {arguments}" for arguments in ("reduce conrod -o x.h5", other))
    line = f"if test $RANK = 0; then {one}; else {another}; fi"
    status, reported, errors = two_ranks(line, folder)
    assert status == 2, errors
    assert reported == [ALIKE.format(ARGUMENTS)], errors
    assert not (folder / "x.h5").exists()


@pytest.mark.slow
@pytest.mark.parametrize("ranks", ["1", "2"])
def test_an_own_model_is_meshed_in_a_process_that_is_no_rank(ranks, folder):
    (folder / "own.geo").write_text(ehd.model_path("conrod").read_text())
    geometry = {"bore_cells_around": 10, "bore_cells_along": 2, "shank_cells": 2}
    reduction = {"method": "m1", "modes": 4, "estimate_error": False}
    own = {"model": "own.geo", "geometry": geometry, "reduction": reduction}
    changes = {f"bodies.rod.{key}": value for key, value in own.items()}
    write_scene(folder / "own.toml", "slider-crank-paper", changes)
    line = f"{COMMAND} reduce rod --scene own.toml -o rod.h5"
    status, _, errors = on_ranks("-n", ranks, "sh", "-c", line, folder=folder)
    assert status == 0, errors
    assert ehd.load_body(folder / "rod.h5").frequencies[0] > 0.0


RUN = f"{COMMAND} run scene0.toml --no-plots -o out"
NO_CACHE = "export XDG_CACHE_HOME=/dev/null"
OWN_FOLDER = "mkdir $RANK; cd $RANK"
NO_SCENE = "SettingsError: scene file scene0.toml: No such file or directory (rank 1"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "expected", "messages"),
    [
        (f"{OWN_FOLDER}; test $RANK = 0 && cp ../scene0.toml .; {RUN}", 2, [NO_SCENE]),
        (
            f"{OWN_FOLDER}; cp ../scene0.toml .; test $RANK = 1 && ln -s /proc out; {RUN}",
            2,
            ["output out: ", "(rank 1"],
        ),
        (f"test $RANK = 0 && {NO_CACHE}; {RUN}", 1, ["/dev/null/fenics", "Not a directory"]),
        (f"test $RANK = 1 && {NO_CACHE}; {RUN}", 1, ["/dev/null/fenics", "Not a directory"]),
        (f"{NO_CACHE}; {RUN}", 1, ["/dev/null/fenics", "Not a directory"]),
    ],
)
def test_what_one_rank_or_all_cannot_do(line, expected, messages, folder):
    status, reported, errors = two_ranks(line, folder)
    assert status == expected, errors
    assert len(reported) == 1, errors
    for message in messages:
        assert message in reported[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "expected", "message"),
    [
        ("run absent.toml", 2, "scene file absent.toml: No such file or directory"),
        ("run", 2, "Error: give either SCENE, to start a run, or --resume DIR, to continue a run"),
    ],
)
def test_error_of_all_ranks_is_said_once_and_aborts_nothing(arguments, expected, message, folder):
    status, reported, errors = two_ranks(f"{COMMAND} {arguments}", folder)
    assert status == expected, errors
    assert len(reported) == 1, errors
    assert reported[0].endswith(message)
    assert "MPI_ABORT" not in errors


@pytest.mark.slow
def test_error_of_the_rank_that_works_alone(folder):
    """The other one has done its share of the reduction, and waits at its end."""
    thin = {"joints.big_end.smallest_film": 0.99}
    write_scene(folder / "thin.toml", "slider-crank-paper", SHORT, thin)
    status, reported, errors = two_ranks(f"{COMMAND} run thin.toml --no-plots -o out", folder)
    assert status == 1, errors
    assert len(reported) == 1, errors
    assert reported[0].startswith("fenics-ehd: FilmTooThinError: ")
    assert "MPI_ABORT" not in errors
    status, reported, errors = two_ranks(RUN, folder)
    assert (status, reported) == (0, []), errors


@pytest.mark.slow
def test_stress_ends_on_two_ranks(folder):
    elastic = SHORT | {"bodies.rod.reduction": {"method": "m4", "estimate_error": False}}
    write_scene(folder / "elastic.toml", "slider-crank-paper", elastic)
    line = f"{COMMAND} run elastic.toml --no-plots --no-error-budget -o out"
    status, _, errors = two_ranks(line, folder)
    assert status == 0, errors
    status, _, errors = two_ranks(f"{COMMAND} stress out", folder)
    assert status == 0, errors
    assert (folder / "out" / "stress.json").is_file()
