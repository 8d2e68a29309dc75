"""`.ci/image` takes Debian from where apt does."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / ".ci" / "image"

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="an installed copy has no .ci")


def run_with(mirrors, folder):
    """The script where apt knows these mirrors, and what debootstrap is called with."""
    tools = {
        "apt-get": f"printf '%s' '{mirrors}'",
        "podman": "exit 1",
        "buildah": "exit 1",
        "debootstrap": f'echo "$*" > {folder}/called; exit 7',
    }
    for name, text in tools.items():
        (folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (folder / name).chmod(0o755)
    environment = os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"}
    done = subprocess.run([SCRIPT], env=environment, capture_output=True, text=True, timeout=60)
    called = folder / "called"
    return done, called.read_text().split() if called.exists() else None


def test_the_mirror_is_that_of_apt(tmp_path):
    mirrors = "http://mirror.invalid/debian/\nhttp://other.invalid/debian/\n"
    done, called = run_with(mirrors, tmp_path)
    assert (done.returncode, called[-1]) == (7, "http://mirror.invalid/debian/")


@pytest.mark.parametrize("mirrors", ["", "mirror+http://mirror.invalid/list\n"])
def test_without_a_mirror_it_stops_and_says_so(mirrors, tmp_path):
    done, called = run_with(mirrors, tmp_path)
    assert (done.returncode, called) == (1, None)
    assert "apt knows no mirror of Debian" in done.stderr


def kept_in_spite_of_their_ending(path):
    """Patterns of files that an ignore file lists by name, without the slash that roots them."""
    lines = (SCRIPT.parents[1] / path).read_text().splitlines()
    return {line[1:].removeprefix("/") for line in lines if line.startswith("!")}


def test_the_image_gets_the_stored_files_of_the_tests():
    kept = kept_in_spite_of_their_ending(".gitignore")
    assert kept
    stored_bodies = {pattern for pattern in kept if pattern.endswith(".h5")}
    assert stored_bodies <= kept_in_spite_of_their_ending(".dockerignore")
