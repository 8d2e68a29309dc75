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

COMMAND = f"exec {sys.executable} -m fenics_ehd.cli"


def two_ranks(line, folder):
    """Status and messages of a shell's line on two ranks, each of which knows its `$RANK`."""
    foreign = ("OMPI_", "PMIX_", "PMI_", "ORTE_")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(foreign)}
    environment |= dict.fromkeys(("OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"), "1")
    script = f"RANK=$OMPI_COMM_WORLD_RANK; {line}"
    done = subprocess.run(
        ["mpirun", "-n", "2", "--oversubscribe", "sh", "-c", script],
        env=environment, cwd=folder, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    # Open MPI's own remarks may begin in the same line.
    said = re.findall(r"fenics-ehd: .*|^Error: .*", done.stderr, flags=re.MULTILINE)
    return done.returncode, [text for text in said if "warning" not in text], done.stderr


@pytest.fixture
def folder(tmp_path):
    write_scene(tmp_path / "scene0.toml", "slider-crank-paper", SHORT)
    return tmp_path


@pytest.mark.slow
def test_scene_that_one_rank_does_not_find(folder):
    status, said, errors = two_ranks(f"{COMMAND} run scene$RANK.toml -o out", folder)
    assert status == 2, errors
    assert len(said) == 1, errors
    line = said[0]
    assert "SettingsError: scene file scene1.toml: No such file or directory (rank 1" in line
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("lines", "what"),
    [
        (("bearing --eccentricity 0.5", ""), "command"),
        (("run scene0.toml -o out", "run four-bar -o out"), "scene"),
        (
            ("reduce conrod -o x.h5", "reduce conrod -o x.h5 --method m1"),
            "part, or settings of it,",
        ),
    ],
)
def test_ranks_that_are_given_different_commands(lines, what, folder):
    one, other = (f"{COMMAND} {line}" for line in lines)
    status, said, errors = two_ranks(f"if test $RANK = 0; then {one}; else {other}; fi", folder)
    assert status == 2, errors
    message = f"SettingsError: rank 1 has another {what} than rank 0: call all ranks alike"
    assert said == [f"fenics-ehd: {message}"], errors
    assert not (folder / "out").exists()


@pytest.mark.slow
def test_output_that_one_rank_cannot_write(folder):
    where = "test $RANK = 1 && out=/proc/x || out=out"
    status, said, errors = two_ranks(f"{where}; {COMMAND} run scene0.toml -o $out", folder)
    assert status == 2, errors
    assert len(said) == 1, errors
    line = said[0]
    assert "output /proc/x: " in line


@pytest.mark.slow
@pytest.mark.parametrize("rank", [0, 1, 2])
def test_cache_that_cannot_be_used(rank, folder):
    cache = f"test $RANK -ge {rank % 2} -a $RANK -le {rank} && export XDG_CACHE_HOME=/dev/null"
    run = f"{COMMAND} run scene0.toml --no-plots -o out"
    status, said, errors = two_ranks(f"{cache}; {run}", folder)
    assert status == 1, errors
    assert len(said) == 1, errors
    line = said[0]
    assert "/dev/null/fenics" in line
    assert "Not a directory" in line


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
    line = said[0]
    assert line.endswith(message)
    assert "MPI_ABORT" not in errors


@pytest.mark.slow
def test_error_of_the_rank_that_works_alone(folder):
    """The other one has done its share of the reduction, and waits at its end."""
    thin = {"joints.big_end.smallest_film": 0.99}
    write_scene(folder / "thin.toml", "slider-crank-paper", SHORT, thin)
    status, said, errors = two_ranks(f"{COMMAND} run thin.toml --no-plots -o out", folder)
    assert status == 1, errors
    assert len(said) == 1, errors
    line = said[0]
    assert line.startswith("fenics-ehd: FilmTooThinError: ")
    assert "MPI_ABORT" not in errors
    status, said, errors = two_ranks(f"{COMMAND} run scene0.toml --no-plots -o out", folder)
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
