"""One line names what the system lacks: a compiler, headers, or a library of Gmsh."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from fenics_ehd.base import compiler
from fenics_ehd.base.compiler import compiler_errors, missing_parts

BEARING = ("bearing", "--eccentricity", "0.5", "--cells", "16x4")


def failed_bearing(folder, **variables):
    """Messages of a bearing whose forms cannot be compiled."""
    environment = os.environ | {"XDG_CACHE_HOME": str(folder)} | variables
    command = [sys.executable, "-m", "fenics_ehd.cli", *BEARING]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, "")
    return done.stderr.splitlines()


def test_a_missing_compiler_is_one_line(tmp_path):
    (line,) = failed_bearing(tmp_path, CC="no-such-cc -O3")
    assert line.startswith("fenics-ehd: CompilationError: forms cannot be compiled without ")
    assert "a C compiler (no-such-cc): apt-get install gcc" in line


def test_an_error_of_the_compiler_is_one_line(tmp_path):
    """The compiler prints more than one line."""
    script = tmp_path / "cc"
    script.write_text("#!/bin/sh\nfor i in 1 2 3; do echo f.c:$i: error: no $i >&2; done; exit 1\n")
    script.chmod(0o755)
    (line,) = failed_bearing(tmp_path, CC=str(script))
    stored = tmp_path / "fenics" / "fenics_ehd"
    assert line.endswith(
        f"forms are compiled by {script} and stored in {stored}: f.c:1: error: no 1"
    )


def test_missing_headers_of_python_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(sysconfig, "get_path", lambda name: str(tmp_path))
    assert missing_parts() == [f"the headers of Python ({tmp_path}/Python.h)"]
    Path(tmp_path, "Python.h").touch()
    assert missing_parts() == []


def test_missing_headers_of_c_are_named(tmp_path):
    script = tmp_path / "cc"
    script.write_text("#!/bin/sh\necho 'x.h:9: error: stdlib.h: No such file' >&2; exit 1\n")
    script.chmod(0o755)
    (line,) = failed_bearing(tmp_path, CC=str(script))
    assert "stdlib.h: No such file: apt-get install gcc libc6-dev" in line


def test_a_missing_library_of_gmsh_is_one_line(tmp_path):
    error = "libGLU.so.1: cannot open shared object file"
    (tmp_path / "gmsh.py").write_text(f"raise OSError('{error}: No such file or directory')\n")
    paths = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-m", "fenics_ehd.cli", "reduce", "conrod", "--no-cache", "-o", "x.h5"],
        env=os.environ | {"PYTHONPATH": paths}, cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    line = done.stderr.splitlines()[-1]
    assert done.returncode == 1
    assert line.startswith(f"fenics-ehd: LibraryError: Gmsh lacks a library of the system: {error}")
    assert "directory: apt-get install libglu1-mesa" in line
    assert not list(tmp_path.glob("*.h5"))


def test_errors_of_other_libraries_pass_unchanged(tmp_path, capfd):
    with pytest.raises(KeyError), compiler_errors(tmp_path):
        raise KeyError("x")
    os.write(2, b"shown")
    assert capfd.readouterr().err == "shown"
    assert compiler.INSTALL.count("python3.") == 2
