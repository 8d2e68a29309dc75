"""An error on one rank ends all of them, with its message and the status of a serial run."""

import os
import re
import subprocess
import sys

import pytest
from scene_cases import write_scene

#: A rod without elasticity, over the first degrees.
SHORT = {
    "bodies.rod.reduction": {"method": "rigid", "estimate_error": False},
    "time.revolutions": 0.02,
    "time.tolerance": 1e-3,
}

#: Status of ranks that wait for each other.
TOO_LONG = 124

COMMAND = f"exec {sys.executable} -m fenics_ehd.cli"


def two_ranks(line, folder):
    """Status and messages of a shell's line on two ranks, each of which knows its `$RANK`."""
    foreign = ("OMPI_", "PMIX_", "PMI_", "ORTE_", "PRTE_")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(foreign)}
    environment |= dict.fromkeys(("OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"), "1")
    script = f"RANK=$OMPI_COMM_WORLD_RANK; {line}"
    # Of a killed mpirun the ranks would go on: timeout asks it to end them.
    command = ["timeout", "120", "mpirun", "-n", "2", "--oversubscribe", "sh", "-c", script]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True)
    # Open MPI's own remarks may begin in the same line.
    said = re.findall(r"fenics-ehd: .*|^Error: .*", done.stderr, flags=re.MULTILINE)
    return done.returncode, [text for text in said if "warning" not in text], done.stderr


@pytest.fixture
def folder(tmp_path):
    write_scene(tmp_path / "scene0.toml", "slider-crank-paper", SHORT)
    return tmp_path


#: What is told to each rank, and in what they differ.
DIFFERENT = [
    ("bearing --eccentricity 0.5", "", "command"),
    ("run scene0.toml -o out", "run four-bar -o out", "scene"),
    ("reduce conrod -o x.h5", "reduce conrod -o x.h5 --method m1", "part, or settings of it,"),
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


def test_ranks_that_are_given_different_commands(folder):
    (folder / "commands.py").write_text(ONE_BY_ONE)
    one, other = (" ".join(f"'{lines[rank]}'" for lines in DIFFERENT) for rank in (0, 1))
    python = f"exec {sys.executable} commands.py"
    line = f"if test $RANK = 0; then {python} {one}; else {python} {other}; fi"
    status, said, errors = two_ranks(line, folder)
    assert status == 0, errors
    assert said == [
        f"fenics-ehd: SettingsError: rank 1 has another {what} than rank 0: call all ranks alike"
        for *_, what in DIFFERENT
    ], errors
    assert not (folder / "out").exists()


RUN = f"{COMMAND} run scene0.toml --no-plots -o out"
NO_CACHE = "export XDG_CACHE_HOME=/dev/null"
NO_SCENE = "SettingsError: scene file scene1.toml: No such file or directory (rank 1"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "expected", "messages"),
    [
        (f"{COMMAND} run scene$RANK.toml -o out", 2, [NO_SCENE]),
        (f"test $RANK = 1 && o=/proc/x || o=out; {RUN[:-3]} $o", 2, ["output /proc/x: "]),
        (f"test $RANK = 0 && {NO_CACHE}; {RUN}", 1, ["/dev/null/fenics", "Not a directory"]),
        (f"test $RANK = 1 && {NO_CACHE}; {RUN}", 1, ["/dev/null/fenics", "Not a directory"]),
        (f"{NO_CACHE}; {RUN}", 1, ["/dev/null/fenics", "Not a directory"]),
    ],
)
def test_what_one_rank_or_all_cannot_do(line, expected, messages, folder):
    status, said, errors = two_ranks(line, folder)
    assert status == expected, errors
    assert len(said) == 1, errors
    for message in messages:
        assert message in said[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "expected", "message"),
    [
        ("run absent.toml", 2, "scene file absent.toml: No such file or directory"),
        ("run", 2, "Error: give a SCENE to run or --resume DIR, one of them"),
    ],
)
def test_error_of_all_ranks_is_said_once_and_aborts_nothing(arguments, expected, message, folder):
    status, said, errors = two_ranks(f"{COMMAND} {arguments}", folder)
    assert status == expected, errors
    assert len(said) == 1, errors
    assert said[0].endswith(message)
    assert "MPI_ABORT" not in errors


@pytest.mark.slow
def test_error_of_the_rank_that_works_alone(folder):
    """The other one has done its share of the reduction, and waits at its end."""
    thin = {"joints.big_end.smallest_film": 0.99}
    write_scene(folder / "thin.toml", "slider-crank-paper", SHORT, thin)
    status, said, errors = two_ranks(f"{COMMAND} run thin.toml --no-plots -o out", folder)
    assert status == 1, errors
    assert len(said) == 1, errors
    assert said[0].startswith("fenics-ehd: FilmTooThinError: ")
    assert "MPI_ABORT" not in errors
    status, said, errors = two_ranks(RUN, folder)
    assert (status, said) == (0, []), errors


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
