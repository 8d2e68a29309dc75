"""Every command and snippet of README, tutorial and scene guide does what the text describes.

A section runs in the folder that its document's earlier sections left behind, as a reader would.
"""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from command_line import exit_of
from scene_cases import write_scene

import fenics_ehd as ehd

ROOT = Path(__file__).parents[1]

#: Lines that are not run, by their beginning, and why.
EXEMPT = {
    "make demo": "installs Debian packages and makes the environment that this test runs in",
    "make test": "runs this test",
    "python3 -m venv ehd": "downloads wheels; make test-wheels installs and tests them",
    "ehd/bin/": "the same",
    "docker ": "needs a Docker engine; .ci/image builds and runs the same image",
    ". .venv/bin/activate": "this test's environment is active",
}

#: Sections of more than a few seconds. What is fast must not need what they leave behind.
SLOW = {
    "README.md": {"What it does"},
    "docs/tutorial.md": {
        "A machine", "Your own machine", "Which method, how many modes", "Many runs", "From Python",
    },
    "docs/mechanisms.md": {
        "Mechanisms of bodies and joints", "As a scene file", "Pictures of a run",
    },
    "docs/pictures.md": {"Pictures", "Two runs"},
    "docs/results.md": {"Results of a run", "In ParaView"},
    "docs/tutorial-motorcycle.md": {"Known data, as a scene", "Results", "Variations"},
    "docs/own-part.md": {
        "Your own part", "A drawing", "A bore with chamfers and an oil hole", "A mesh",
        "A mesh with an oil hole", "Hexahedra", "Matrices of CalculiX",
    },
    "docs/own-scene.md": {"Settings", "Loads from tables", "Another machine"},
    "docs/error-budget.md": {"Error budget"},
    "docs/rotor-maps.md": {"A rotor", "The Campbell diagram", "In Python"},
    "docs/accuracy.md": {"Accuracy: settings chosen for an error"},
}  # fmt: skip

#: Documents that run shipped scenes as they are. They do so here in small forms, which other tests
#: run in their own size: each line that is replaced, by scene.
SMALL = ("README.md", "docs/tutorial.md", "docs/mechanisms.md", "docs/pictures.md",
         "docs/error-budget.md")  # fmt: skip
SMALL_FORMS = {
    "slider-crank-paper": {
        "bore_cells_around = 20": "bore_cells_around = 10",
        "bore_cells_along = 5": "bore_cells_along = 2",
        "big_end_layers = 2": "big_end_layers = 1",
        "shank_cells = 12": "shank_cells = 4",
        "small_end_layers = 2": "small_end_layers = 1",
        "revolutions = 1.0": "revolutions = 0.1",
        "tolerance = 1e-5": "tolerance = 1e-3",
    },
    "four-bar": {
        "cells = [24, 4]": "cells = [12, 2]",
        "periodicity = 1e-3": "periodicity = 1e-2",
        "tolerance = 1e-4": "tolerance = 1e-3",
    },
}

#: Sections that vary a scene which an earlier section of the document has run in its own size: the
#: file of the scene, and each line that is replaced in it before the section.
SHORT_FORMS = {
    ("docs/tutorial-motorcycle.md", "Variations"): (
        "motorcycle.toml",
        {
            "cells = [40, 10]": "cells = [16, 3]",
            "periodic = true": "periodic = false",
            "revolutions = 2 ": "revolutions = 0.1 ",
            "periodicity = 1e-3": "",
            "tolerance = 1e-4": "tolerance = 1e-3",
        },
    ),
}

#: Programs that sections need and that not every machine has.
NEEDS = {("docs/own-part.md", "Matrices of CalculiX"): "ccx"}


@dataclass(frozen=True)
class Section:
    """Part of a document under one heading, with the language and text of its code blocks."""

    document: str
    title: str
    blocks: tuple[tuple[str, str], ...]


def sections(document):
    """Sections that have code in them, in blocks that name its language."""
    title, blocks = "", {}
    # Blocks first: a comment in them looks like a heading.
    pattern = r"^```(\w+)\n(.*?)^```$|^#+ ([^\n]+)$"
    for match in re.finditer(
        pattern, (ROOT / document).read_text(), flags=re.MULTILINE | re.DOTALL
    ):
        language, text, heading = match.groups()
        if heading:
            title = heading
        else:
            blocks.setdefault(title, []).append((language, text))
    return [Section(document, title, tuple(found)) for title, found in blocks.items()]


ALL = [part for document in SLOW for part in sections(document)]


def runnable(script):
    """The script without its exempt lines."""
    lines = script.splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith(tuple(EXEMPT)))


def cases():
    for part in ALL:
        marks = [pytest.mark.slow] if part.title in SLOW[part.document] else []
        if program := NEEDS.get((part.document, part.title)):
            lacking = shutil.which(program) is None
            marks.append(pytest.mark.skipif(lacking, reason=f"{program} is not installed"))
        yield pytest.param(part, marks=marks, id=f"{part.document}: {part.title}")


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """One folder for each document, with the demos in it as a checkout has them."""
    found = {part.document: tmp_path_factory.mktemp("reader") for part in ALL}
    for folder in found.values():
        (folder / "demos").symlink_to(ROOT / "demos")
    return found


def replace_lines(path, lines):
    """Replace pieces of a file's text, each of which it has once."""
    text = path.read_text()
    for line, short in lines.items():
        assert text.count(line) == 1, line
        text = text.replace(line, short)
    path.write_text(text)


@pytest.fixture(scope="module")
def small_forms(tmp_path_factory):
    """Folder with a copy of the package whose shipped scenes are small."""
    folder = tmp_path_factory.mktemp("small")
    shutil.copytree(Path(ehd.__file__).parent, folder / "fenics_ehd")
    for scene, lines in SMALL_FORMS.items():
        path = folder / "fenics_ehd" / "scenes" / "shipped" / f"{scene}.toml"
        replace_lines(path, {f"\n{line} ": f"\n{short} " for line, short in lines.items()})
    return folder


@pytest.mark.parametrize("part", cases())
def test_code_runs_as_it_is_printed(part, folders, request):
    small = part.document in SMALL
    package = {"PYTHONPATH": str(request.getfixturevalue("small_forms"))} if small else {}
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    if form := SHORT_FORMS.get((part.document, part.title)):
        replace_lines(folders[part.document] / form[0], form[1])
    for language, text in part.blocks:
        command = {
            "sh": ["bash", "-euo", "pipefail", "-c", runnable(text)],
            "python": [sys.executable, "-c", text],
            "text": ["true"],  # printed by the program, see the next test
        }[language]
        result = subprocess.run(
            command,
            cwd=folders[part.document],
            env={**os.environ, **package, "PATH": path},
            capture_output=True,
            text=True,
            timeout=1800,
        )
        assert result.returncode == 0, f"{text}\n{result.stderr}"


def test_bad_value_is_answered_as_printed(tmp_path, capfd, monkeypatch):
    printed = [text for part in ALL for language, text in part.blocks if language == "text"]
    changes = {"joints.big_end.clearance": -10e-6}
    write_scene(tmp_path / "press.toml", "slider-crank-paper", changes)
    monkeypatch.chdir(tmp_path)
    status, _, errors = exit_of(capfd, "run", "press.toml")
    assert status == 2
    assert [errors] == printed


def test_no_block_is_overlooked():
    for document in SLOW:
        fences = len(re.findall(r"^```", (ROOT / document).read_text(), flags=re.MULTILINE))
        found = sum(len(part.blocks) for part in ALL if part.document == document)
        assert fences == 2 * found, document


def test_nothing_is_exempt_or_slow_without_need():
    lines = [line for part in ALL for _, text in part.blocks for line in text.splitlines()]
    for beginning in EXEMPT:
        assert any(line.startswith(beginning) for line in lines), beginning
    slow = {(document, title) for document, titles in SLOW.items() for title in titles}
    assert {(part.document, part.title) for part in ALL} >= slow | set(NEEDS)


def test_a_stranger_reads_it_in_a_minute():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) < 90
    for name in re.findall(r"\]\((?!http)([^)#]+)", text):
        assert (ROOT / name).exists(), name
