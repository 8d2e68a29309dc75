"""What the documentation site is generated from: drawings, figures of the tests, demos."""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
import tables
from drawings import DRAWINGS, draw_all
from drawings.gap import CLEARANCE, DIRECTION, RATIO, ends_of_gap
from drawings.rod import CRANK, PHI, ROD, rod_motion
from drawings.sketch import point, save
from light_cells import markdown

from fenics_ehd.cli.main import cli

TESTS = Path(__file__).parent
DOCS = TESTS.parent / "docs"


def test_drawings_are_the_same_at_every_build(tmp_path):
    draw_all(tmp_path)
    assert {path.stem for path in tmp_path.iterdir()} == set(DRAWINGS)
    # All are saved in one way.
    save(DRAWINGS["gap"](), tmp_path / "again.svg")
    assert (tmp_path / "again.svg").read_bytes() == (tmp_path / "gap.svg").read_bytes()


def test_drawn_gap_ends_on_the_drawn_shaft():
    # The gap is the program's; with another sign of e or of n it would miss the circle.
    e = point(CLEARANCE * RATIO, DIRECTION)
    inner, outer = ends_of_gap(e)
    assert np.hypot(*(inner - e)) == pytest.approx(1 - CLEARANCE, rel=1e-12)
    assert np.hypot(*outer) > 1


def test_drawn_rod_ends_on_the_line_of_the_piston():
    pin = point(CRANK, PHI) + point(ROD, rod_motion())
    assert pin[1] == pytest.approx(0.0, abs=1e-12)
    assert pin[0] > 0


def figure_tests():
    """Test functions that ask for the fixture, as file::function."""
    for path in TESTS.glob("test_*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                if "figure" in {argument.arg for argument in node.args.args}:
                    yield f"{path.name}::{node.name}"


def test_validation_page_shows_the_figures_of_the_tests_that_there_are():
    # Refresh with: make figures
    figures = json.loads((DOCS / "validation.json").read_text())["figures"]
    assert {figure["test"].partition("[")[0] for figure in figures} == set(figure_tests())
    for figure in figures:
        if "most" in figure:
            assert figure["value"] <= figure["most"], figure
        else:
            assert figure["value"] >= figure["least"], figure
    groups = {figure["group"] for figure in figures}
    page = (DOCS / "validation.md").read_text()
    assert all(f"<!-- validation-figures {group} -->\n" in page for group in groups)


def test_tables_are_what_the_program_says():
    # Refresh with: python docs/tables.py
    for name in ("settings.md", "validation.md"):
        page = (DOCS / name).read_text()
        assert tables.filled(page) == page, name
    # How help is laid out depends on click's version, what it lists does not.
    page = (DOCS / "command-line.md").read_text()
    for path, text in re.findall(
        r"^### (fenics-ehd[^\n]*)\n\n```text\n(.*?)^```", page, re.MULTILINE | re.DOTALL
    ):
        found = re.findall(r"^  (-\w|--[\w-]+)", text, re.MULTILINE)
        command, context = cli, click.Context(cli)
        for word in path.split()[1:]:
            command = command.get_command(context, word)
        ours = [p.opts[0] for p in command.params if isinstance(p, click.Option) and not p.hidden]
        assert sorted(found) == sorted([*ours, "-h"]), path


def test_a_figure_beyond_its_limit_fails(request):
    figure = request.getfixturevalue("figure")  # not as an argument: it is none of the page's
    with pytest.raises(AssertionError, match="too much: 2, at most 1"):
        figure("film", "too much", 2.0, most=1.0)
    with pytest.raises(AssertionError, match="too little: 1, at least 2"):
        figure("film", "too little", 1.0, least=2.0)


@pytest.mark.parametrize("late", [False, True])
def test_figures_of_a_skipped_test_are_missed(late, tmp_path):
    skip = "    pytest.skip('no ccx')" if late else "    pass"
    mark = "" if late else "@pytest.mark.skipif(True, reason='no ccx')\n"
    test = f"import pytest\nfrom figures import *\n{mark}def test_it(figure):\n{skip}\n"
    (tmp_path / "test_it.py").write_text(test)
    (tmp_path / "conftest.py").write_text("from figures import *\n")
    called = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--figures=f.json"]
    done = subprocess.run(
        called, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(TESTS)}, capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.returncode != 0
    assert "no figures are written: test_it.py" in done.stdout + done.stderr
    assert "no ccx" in done.stdout + done.stderr
    assert not (tmp_path / "f.json").exists()


SOURCE = """# # A title
#
# Some text.

# +
import sys

import numpy
# -

# More text.


def main():
    # a comment inside
    return 1
"""

PAGE = """# A title

Some text.

```python
import sys

import numpy
```

More text.

```python
def main():
    # a comment inside
    return 1
```"""


def test_demos_become_pages():
    assert markdown(SOURCE) == PAGE
    names = {path.stem for path in (TESTS.parent / "demos").glob("*.py")}
    assert names == {path.stem for path in (DOCS / "demos").glob("*.md")} - {"index"}
