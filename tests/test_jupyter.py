"""The recipe of the page on Jupyter: its kernel is installed and runs the cells of the page."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[1] / "docs" / "jupyter.md"

WITHOUT = "Debian's python3-ipykernel and python3-nbclient are missing: debian-packages-tests.txt"


def blocks(language):
    """Code blocks of the page in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)


def installed_kernel(folder, monkeypatch):
    """Install the kernel by the line of the page, into a folder of Jupyter's own."""
    for name in ("JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(folder / name))
    (line,) = (block for block in blocks("sh") if "ipykernel install" in block)
    command = line.replace(".venv/bin/python", sys.executable)
    subprocess.run(command, shell=True, check=True, capture_output=True, cwd=folder)
    return folder / "JUPYTER_DATA_DIR" / "kernels" / "fenics-ehd" / "kernel.json"


@pytest.mark.slow
def test_the_kernel_of_the_page_runs_its_cells(tmp_path, monkeypatch):
    pytest.importorskip("ipykernel", reason=WITHOUT)
    nbclient = pytest.importorskip("nbclient", reason=WITHOUT)
    nbformat = pytest.importorskip("nbformat", reason=WITHOUT)
    kernel = installed_kernel(tmp_path, monkeypatch)
    # The kernel file of the page is the one that is written, but for the paths.
    by_hand = json.loads(blocks("json")[0])
    written = json.loads(kernel.read_text())
    assert written["argv"][0] == sys.executable
    arguments = [word for word in written["argv"][1:] if not word.startswith("-X")]
    assert arguments == by_hand["argv"][1:]
    for key in ("display_name", "language", "env"):
        assert written[key] == by_hand[key]
    empty = tmp_path / "notebooks"
    empty.mkdir()
    cells = [nbformat.v4.new_code_cell(block) for block in blocks("python")]
    notebook = nbformat.v4.new_notebook(cells=cells)
    client = nbclient.NotebookClient(
        notebook, timeout=300, kernel_name="fenics-ehd", resources={"metadata": {"path": empty}}
    )
    client.execute()
    outputs = [cell["outputs"] for cell in notebook.cells]
    # An error would have ended the notebook.
    scene, run, values, film, orbit, both, sweep, columns, bearing, chart = outputs
    for table in (scene, run, sweep, bearing):
        assert "<table>" in table[-1]["data"]["text/html"]
    assert re.fullmatch(r"sweep: \d+ s", sweep[0]["data"]["text/plain"])
    assert "2 cases, 2 complete" in sweep[-1]["data"]["text/plain"]
    assert "0.008" in columns[0]["data"]["text/plain"]
    progress = run[0]["data"]["text/plain"]
    assert re.fullmatch(r"simulation: \d+ s", progress), progress
    assert len(run) == 2  # a single output was updated
    assert re.match(r"\(\d", values[0]["data"]["text/plain"])
    for figure in (film, orbit, both, chart):
        assert figure[-1]["data"]["image/png"]
        assert len([each for each in figure if "image/png" in each.get("data", {})]) == 1
    assert sorted(path.name for path in empty.iterdir()) == ["stiff", "thin"]
    if folder := os.environ.get("KEEP_NOTEBOOK"):
        nbformat.write(notebook, Path(folder, "page.ipynb"))
