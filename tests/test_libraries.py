"""A NumPy from PyPI that hides Debian's is refused in one line, before compiled libraries fail."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

import fenics_ehd
from fenics_ehd.base import libraries

#: NumPy that ends the process when it is imported: versions are compared without an import.
NUMPY = "import os; os.write(2, b'numpy was imported\\n'); os._exit(3)"


def other_numpy(folder, version):
    """Make a folder with a package numpy of a version, as pip installs it."""
    (folder / "numpy").mkdir(parents=True)
    (folder / "numpy" / "__init__.py").write_text(NUMPY)
    metadata = folder / f"numpy-{version}.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text(f"Metadata-Version: 2.1\nName: numpy\nVersion: {version}\n")
    return folder


def called(folder, *arguments):
    package = Path(fenics_ehd.__file__).parents[1]
    path = os.pathsep.join([str(folder), str(package)])
    environment = os.environ | {"PYTHONPATH": path}
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder)


@pytest.fixture
def debian():
    """Version of Debian's NumPy; only with Debian's libraries is another one refused."""
    version = libraries._numpy_in(libraries.DEBIAN)
    compiled = libraries.origin("scipy").startswith(str(libraries.DEBIAN_LIBRARIES))
    if not (version and compiled):
        pytest.skip("the compiled libraries are not Debian's")
    return version


def test_an_import_of_the_package_names_the_other_numpy_its_folder_and_the_remedy(debian, tmp_path):
    folder = other_numpy(tmp_path, "9.9.1")
    result = called(folder, "-c", "import fenics_ehd")
    line = result.stderr.splitlines()[-1]
    assert result.returncode == 1
    assert line.startswith(
        f"ImportError: numpy 9.9.1 in {folder} hides Debian's numpy {debian}, for which dolfinx, "
        "petsc4py, h5py, scipy of Debian are compiled: remove the folder from PYTHONPATH = "
    )


def test_commands_print_one_line_and_version_and_init_work(debian, tmp_path):
    folder = other_numpy(tmp_path, "9.9.1")
    command = "import sys; sys.argv[0] = 'fenics-ehd'; from fenics_ehd.cli.main import main; main()"
    for name in ("bearing", "run"):
        result = called(folder, "-c", command, name)
        assert result.returncode == 1
        assert "numpy 9.9.1 in" in result.stderr.splitlines()[-1]
        assert "Traceback" not in result.stderr
    result = called(folder, "-c", command, "init")
    assert result.returncode == 0
    assert "slider-crank" in result.stdout.splitlines()


def test_later_versions_of_the_same_numpy_are_accepted(debian, tmp_path, monkeypatch):
    major, minor = map(int, debian.split(".")[:2])
    numpy = {
        f"{major}.{minor + 1}.0": "",
        f"{major + 1}.0.0": "hides",
        f"{major}.{minor - 1}.0": "hides",
    }
    origin = libraries.origin
    for version, expected in numpy.items():
        source = other_numpy(tmp_path / version, version) / "numpy" / "__init__.py"
        monkeypatch.setattr(
            libraries,
            "origin",
            lambda name, source=source: str(source) if name == "numpy" else origin(name),
        )
        conflict = libraries.numpy_conflict()
        assert expected in conflict, version
        assert bool(conflict) == bool(expected), version


def test_an_environment_of_wheels_alone_is_accepted(tmp_path, monkeypatch):
    folder = other_numpy(tmp_path, "9.9.1")
    monkeypatch.setattr(libraries, "origin", lambda name: str(folder / name / "__init__.py"))
    assert libraries.numpy_conflict() == ""
    monkeypatch.setattr(sys, "path", [str(folder)])
    monkeypatch.setattr(libraries, "origin", lambda name: pytest.fail(f"looked for {name}"))
    assert libraries.numpy_conflict() == ""


@pytest.mark.parametrize(
    ("folder", "remedy"),
    [
        (f"{sys.prefix}/lib/python3/site-packages", f"{sys.executable} -m pip uninstall numpy"),
        ("/home/anna/.local/lib/python3.11/site-packages", "PYTHONNOUSERSITE=1"),
    ],
)
def test_the_remedy_fits_the_folder(folder, remedy, monkeypatch):
    monkeypatch.delenv("PYTHONPATH", raising=False)
    assert remedy in libraries._without(Path(folder))


def test_mpi_is_loaded_before_dolfinx_of_pypi_and_not_by_looking_for_it(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "loaded_first.py").write_text("")
    (tmp_path / "needs_other.py").write_text("import sys\nready = 'loaded_first' in sys.modules\n")
    finder = libraries.LoadedFirst(["needs_other"], "loaded_first")
    monkeypatch.setattr(sys, "meta_path", [finder, *sys.meta_path])
    assert libraries.origin("needs_other") == str(tmp_path / "needs_other.py")
    assert "loaded_first" not in sys.modules
    try:
        assert importlib.import_module("needs_other").ready
    finally:
        for name in ("needs_other", "loaded_first"):
            sys.modules.pop(name, None)


def test_the_package_changes_the_order_of_imports_only_if_dolfinx_is_pypis(monkeypatch):
    finders = list(sys.meta_path)
    monkeypatch.setattr(sys, "meta_path", finders)
    for origin, added in (("", 0), ("/x/dolfinx_solver/__init__.py", 1)):
        former = len(finders)
        monkeypatch.setattr(libraries, "origin", lambda _name, origin=origin: origin)
        libraries.load_mpi_first()
        assert len(finders) == former + added
    assert finders[0].names == ("dolfinx", "petsc4py.lib", "slepc4py.lib")
    assert finders[0].first == "mpi4py.MPI"


@pytest.mark.skipif(not libraries.origin("dolfinx_solver"), reason="dolfinx is not PyPI's")
@pytest.mark.parametrize("library", ["dolfinx", "petsc4py.PETSc", "slepc4py.SLEPc"])
def test_libraries_of_pypi_are_imported_after_the_package(library):
    code = f"import fenics_ehd, {library}"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
