"""Parts that several test modules look at, made once: treat them as read-only."""

# ruff: noqa: E402

import os
import sys

# As the command line does, before numpy is imported: results to the last bit depend on it.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
# Parts are reduced, in this process and in those that tests start; `test_kept_bodies` has caches.
os.environ["FENICS_EHD_CACHE"] = "off"
# Else each process that a test starts compiles the modules of the package again, if the shell has
# switched off the files with their bytecode.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# Processes of pytest-xdist inherit what MPI set for the one that starts them: no mpirun would
# start from there.
if "PYTEST_XDIST_WORKER" in os.environ:
    for variable in [name for name in os.environ if name.startswith(("OMPI_", "PMIX_"))]:
        del os.environ[variable]

import pytest

# Hooks and fixture of the documentation's figures; pytest finds them here by their names.
from figures import (  # noqa: F401
    figure,
    pytest_addoption,
    pytest_configure,
    pytest_runtest_makereport,
    pytest_sessionfinish,
)
from figures import pytest_collection_modifyitems as keep_tests_with_figures
from hypothesis import settings
from mpi4py import MPI
from recorded_runs import short_run, stored_run
from shared_runs import shared_results

import fenics_ehd as ehd
from fenics_ehd.scenes.part import elastic_part

# No deadline, as the time of an example depends on the load of the machine; the same examples every
# time, so that no change fails by chance (`--hypothesis-profile=default` draws others).
settings.register_profile("any machine", deadline=None, derandomize=True)
settings.load_profile("any machine")


#: Files whose tests take longest begin first: one process would run them alone at the end.
LONGEST = (
    "test_readme.py", "test_cycle_sensitivity.py", "test_joint_heat.py", "test_own_parts.py",
    "test_held_run.py", "test_parallel_parts.py", "test_working_directory.py", "test_accuracy.py",
    "test_conserved_oil.py", "test_error_budget.py", "test_golden.py", "test_resume.py",
    "test_study.py", "test_frames.py", "test_ranks.py", "test_bearing.py", "test_cli.py",
)  # fmt: skip


def pytest_collection_modifyitems(config, items):
    """Keep what is asked for, in an order in which processes end together."""
    keep_tests_with_figures(config, items)
    rank = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.name, len(LONGEST)))


@pytest.fixture(scope="session")
def rod_structure():
    """Default rod on this rank alone."""
    rod = ehd.read_scene("slider-crank-paper").bodies["rod"]
    return elastic_part(rod, "rod", "lagrange", MPI.COMM_SELF).source


@pytest.fixture(scope="session")
def shared(tmp_path_factory):
    """Function (name, make) that returns the folder of a result of the whole session."""
    return shared_results(tmp_path_factory)


@pytest.fixture(scope="session")
def rod_body(shared, request):
    """Default reduction of the default rod."""

    def make(folder):
        structure = request.getfixturevalue("rod_structure")
        ehd.save_body(ehd.load_dependent(structure, 6, 31), folder / "rod.h5")

    return ehd.load_body(shared("rod-body", make) / "rod.h5")


@pytest.fixture(scope="session")
def two_bearings(shared):
    """Short run of a shaft in two equal bearings, with its error budget."""

    def make(folder):
        short_run(folder, "rotor-two-bearings", budget=True, end=2e-3, tolerance=1e-3)

    return stored_run(shared("two-bearings", make))


@pytest.fixture(scope="session")
def housing_structure():
    """Default housing on this rank alone, its foot held."""
    housing = ehd.read_scene("rotor-paper").bodies["housing"]
    return elastic_part(housing, "housing", "lagrange", MPI.COMM_SELF).source
