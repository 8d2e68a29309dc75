"""What an installed copy has: all that the program reads."""

import subprocess
import sys
import zipfile
from pathlib import Path
from shutil import copytree, ignore_patterns

ROOT = Path(__file__).parents[1]

BUILD = "import sys; from setuptools import build_meta; print(build_meta.build_wheel(sys.argv[1]))"


def test_a_wheel_holds_every_file_of_the_package(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    for folder in ("fenics_ehd", "meshes"):
        copytree(ROOT / folder, source / folder, ignore=ignore_patterns("__pycache__", "*.pyc"))
    for file in ("pyproject.toml", "README.md"):
        (source / file).write_bytes((ROOT / file).read_bytes())
    wanted = {
        f"fenics_ehd/{path.relative_to(source).as_posix().removeprefix('fenics_ehd/')}"
        for folder in ("fenics_ehd", "meshes")
        for path in (source / folder).rglob("*")
        if path.is_file()
    }
    command = [sys.executable, "-c", BUILD, str(tmp_path)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert wanted - held == set()
    assert held - wanted == set()
