"""Parts that several test modules look at, made once: treat them as read-only."""

# ruff: noqa: E402

import os

# As the command line does, before numpy is imported: results to the last bit depend on it.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
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
    pytest_collection_modifyitems,
    pytest_configure,
    pytest_runtest_makereport,
    pytest_sessionfinish,
)
from hypothesis import settings
from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.scenes.part import elastic_part

# How long an example takes says what else the machine does; the same examples for everybody, so
# that no change fails by chance (`--hypothesis-profile=default` draws others).
settings.register_profile("any machine", deadline=None, derandomize=True)
settings.load_profile("any machine")


@pytest.fixture(scope="session")
def rod_structure():
    """Default rod on this rank alone."""
    rod = ehd.read_scene("slider-crank-paper").bodies["rod"]
    return elastic_part(rod, "rod", "lagrange", MPI.COMM_SELF).source


@pytest.fixture(scope="session")
def rod_body(rod_structure):
    """Default reduction of the default rod."""
    return ehd.load_dependent(rod_structure, 6, 31)


@pytest.fixture(scope="session")
def housing_structure():
    """Default housing on this rank alone, its foot held."""
    housing = ehd.read_scene("rotor-paper").bodies["housing"]
    return elastic_part(housing, "housing", "lagrange", MPI.COMM_SELF).source
