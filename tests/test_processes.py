"""Processes: children of ranks are no ranks, processes on their own have no daemon of MPI."""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import COMMAND
from mpi4py import MPI
from sweep_cases import write_scene

from fenics_ehd.base.errors import EhdError
from fenics_ehd.base.processes import ALONE, RANKS, for_mpirun, in_child, mpirun, without_launcher

#: Of a launch by Open MPI 4 and PMIx, MPICH and Slurm.
LAUNCHED = {
    "OMPI_COMM_WORLD_RANK": "0",
    "OMPI_COMM_WORLD_SIZE": "2",
    "OMPI_MCA_ess": "^singleton",
    "OMPI_MCA_ess_base_vpid": "0",
    "OMPI_MCA_orte_hnp_uri": "127664128.0;tcp://192.0.2.2:41953",
    "OMPI_MCA_pmix": "^s1,s2,cray,isolated",
    "PMIX_NAMESPACE": "127664129",
    "PMI_RANK": "0",
    "SLURM_PROCID": "0",
}

#: Settings of a user.
OWN = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PMIX_MCA_gds": "hash",
}


def test_a_child_of_a_rank_is_no_rank_and_keeps_the_settings_of_the_user(monkeypatch):
    for name, value in (LAUNCHED | OWN).items():
        monkeypatch.setenv(name, value)
    lost = EhdError("no answer")
    values = {name: in_child(os.getenv, name, lost=lost) for name in LAUNCHED | OWN}
    assert values == dict.fromkeys(LAUNCHED) | OWN


def test_ranks_do_not_inherit_the_settings_of_a_process_alone(monkeypatch):
    for name, value in ALONE.items():
        monkeypatch.setenv(name, value)
    assert not ALONE.keys() & for_mpirun().keys()
    monkeypatch.setenv("UCX_TLS", "self,sm,tcp")
    assert for_mpirun()["UCX_TLS"] == "self,sm,tcp"


def test_session_of_gmsh_starts_no_mpi():
    code = "import sys, fenics_ehd.fem.gmsh_session; print('mpi4py.MPI' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "False\n", done.stderr


STARTED = f"""
import os, sys
import fenics_ehd, fenics_ehd.reduction
before = os.environ.get("{next(iter(ALONE))}")
from fenics_ehd.base.command_start import start_command
start_command()
print(before, *map(os.environ.get, {list(ALONE)}), "mpi4py.MPI" in sys.modules)
"""


@pytest.mark.parametrize(
    ("variable", "expected"),
    [*((name, "None None") for name in RANKS), *((name, "1 self") for name in OWN)],
)
def test_only_a_command_on_its_own_is_started_without_a_daemon(variable, expected):
    environment = without_launcher() | {variable: "0"}
    for name in ALONE:
        environment.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-c", STARTED], env=environment, capture_output=True, text=True, timeout=60
    )
    assert done.stdout == f"None {expected} False\n", done.stderr


#: MPICH of PyPI's wheels stops without a file in shared memory, which Open MPI does not need.
NEEDS_A_FILE = pytest.mark.skipif("MPICH" in MPI.Get_library_version(), reason="MPICH needs a file")

#: Address space of what is limited otherwise [bytes]: Open MPI's daemon grew without end.
MEMORY = 6 << 30


def in_session(session):
    """Ids of the processes of a session."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(words[3]) == session and words[0] != "Z":
            found.append(int(stat.parent.name))
    return found


def limited(arguments, folder, limits=(), **variables):
    """Status and output of a command under limits of resources; no process survives it."""

    def set_limits():
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        for kind, most in limits:
            resource.setrlimit(kind, (most, most))

    environment = without_launcher() | variables
    for name in ALONE:
        environment.pop(name, None)
    process = subprocess.Popen(
        [*COMMAND, *arguments], cwd=folder, env=environment, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, preexec_fn=set_limits, start_new_session=True,
    )  # fmt: skip
    try:
        out, errors = process.communicate(timeout=120)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        raise
    assert in_session(process.pid) == []
    return process.returncode, out, errors


BEARING = ("bearing", "--eccentricity", "0.5", "--cells", "16x4", "--json")


@pytest.fixture(scope="module")
def unlimited(tmp_path_factory):
    """Output of a bearing without limits but that of memory."""
    status, out, errors = limited(BEARING, tmp_path_factory.mktemp("bearing"))
    assert status == 0, errors
    return out


@pytest.mark.parametrize(
    ("limits", "variables"),
    [
        ([], {"PATH": ""}),
        ([(resource.RLIMIT_NOFILE, 16)], {}),
        pytest.param([(resource.RLIMIT_FSIZE, 0)], {}, marks=NEEDS_A_FILE),
    ],
    ids=["no path", "16 files", "no file may grow"],
)
def test_a_bearing_needs_neither_path_nor_many_files_nor_a_disk(
    limits, variables, tmp_path, unlimited
):
    status, out, errors = limited(BEARING, tmp_path, limits, **variables)
    assert status == 0, errors
    assert json.loads(out) == json.loads(unlimited)


@NEEDS_A_FILE
def test_a_run_whose_files_may_not_grow_ends_with_one_line(tmp_path):
    write_scene(tmp_path)
    arguments = ("run", "short.toml", "--no-plots", "-o", "out")
    status, _, errors = limited(arguments, tmp_path, [(resource.RLIMIT_FSIZE, 0)])
    assert status == 1
    line = errors.splitlines()[-1]
    assert line.startswith("fenics-ehd: OutputError: ")
    assert line.endswith("File too large")


@pytest.mark.slow
@pytest.mark.skipif(mpirun() is None, reason="mpirun is not installed")
def test_a_sweep_under_mpirun_has_workers_that_are_no_ranks(tmp_path):
    """They died, and mpirun with them."""
    write_scene(tmp_path)
    sweep = ("sweep", "short.toml", "--set", "clearance=17e-6,20e-6", "--workers", "2", "-o", "out")
    done = subprocess.run(
        ["timeout", "100", mpirun(), "-n", "1", *COMMAND, *sweep], cwd=tmp_path,
        env=for_mpirun(), capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("complete") == 2
