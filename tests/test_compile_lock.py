"""Compiled forms: one process compiles, none waits for ever, killed ones leave no files."""

import errno
import os
import subprocess
import sys

import pytest
from command_line import program

from fenics_ehd.base import compat
from fenics_ehd.base.compile_lock import compiling, forms_folder, orphans
from fenics_ehd.base.errors import CompilationError


def test_a_wait_names_its_holder_once_and_is_given_up(tmp_path, capsys):
    with compiling(tmp_path):
        with (
            pytest.raises(
                CompilationError, match=f"process {os.getpid()} on .*: resume that process"
            ),
            compiling(tmp_path, notice=0.2, limit=0.8),
        ):
            pass
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1
        assert f"in use by process {os.getpid()} on" in lines[0]
    with compiling(tmp_path, notice=0.0, limit=0.0):
        assert capsys.readouterr().err == ""


@pytest.mark.parametrize("value", ["", "cache", "/absolute"])
def test_compiled_forms_are_not_looked_for_in_the_current_folder(value, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", value)
    assert forms_folder().is_absolute()
    assert ("absolute" in forms_folder().parts) == (value == "/absolute")


COMPILE = """
import sys
from fenics_ehd.base import compat
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from fenics_ehd.base.compile_lock import compiling

def compiled():
    domain = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    space = compat.functionspace(domain, compat.lagrange_element("triangle", 1, dimension=2))
    return fem.form(ufl.TestFunction(space) * ufl.dx)

compiled()
made = sorted(compat.FORMS.glob("libffcx_*.c"))
assert made, "nothing was compiled here"
for source in made:
    source.with_suffix(".c.cached").unlink()
    for library in compat.FORMS.glob(source.stem + "*.so"):
        library.unlink()
print(len(made))
compiled()
with compiling(compat.FORMS):
    compiled()
"""


def test_orphans_are_removed_and_compiled_forms_need_no_lock(tmp_path):
    """Elements of dolfinx, too, if this version compiles them."""
    done = subprocess.run(
        [sys.executable, "-c", COMPILE], env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 1
    assert not orphans(tmp_path / "fenics" / "fenics_ehd")
    assert os.listdir(tmp_path / "fenics") == ["fenics_ehd"]


@pytest.mark.slow
def test_a_held_lock_stops_no_run_of_compiled_forms():
    arguments = ("bearing", "--eccentricity", "0.5", "--cells", "16x4", "--json")
    first = program(*arguments)
    assert first.returncode == 0, first.stderr
    with compiling(compat.FORMS):
        again = program(*arguments)
    assert (again.returncode, again.stdout) == (0, first.stdout)


def test_a_file_system_without_locks_stops_nobody(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", refuse)
    with compiling(tmp_path / "forms", limit=0.0):
        assert (tmp_path / "forms").is_dir()
