"""The report of a run: one self-contained HTML page, which prints on two sheets.

The first sheet has the answer, all figures with their estimated errors, warnings, and the scene in
words. The second has the pictures that decide, and what is needed to repeat the run.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np

from fenics_ehd.base.files import SCENE_NAME, claim, require_writable, write_whole
from fenics_ehd.multibody.cycle import CRANK
from fenics_ehd.multibody.figures import Figure, figures_of
from fenics_ehd.multibody.history import CSV_NAME, History, load_history
from fenics_ehd.multibody.verdict import COMPLETE
from fenics_ehd.plotting.picture import SETTINGS, plt, svg_of
from fenics_ehd.plotting.shown import ShownRun
from fenics_ehd.reduction.body import ReducedBody, load_body
from fenics_ehd.results.recorded_run import BODY_FILE, REPORT
from fenics_ehd.scenes.scene import Scene, as_stored, flexible
from fenics_ehd.study.report.page import render
from fenics_ehd.study.report.run_figures import bound_text, figure_blocks, value_text
from fenics_ehd.study.report.run_inputs import input_names, run_inputs
from fenics_ehd.study.report.run_pictures import deciding_pictures
from fenics_ehd.study.report.scene_words import scene_entries


def write_run_page(directory: str | Path) -> Path:
    """Write ``report.html`` of a run into its folder; the same run gives the same page.

    A run that failed, was interrupted or is in progress is reported as far as it is recorded.

    Parameters
    ----------
    directory
        Folder of the run.

    Returns
    -------
    Path
        Path of the page.

    Raises
    ------
    InputError
        The folder has no run, or a file in it cannot be read.
    """
    folder = Path(directory)
    history = load_history(folder)
    require_writable(folder)
    claim(folder, (REPORT,))
    pictures = []
    drawn = {}
    with plt.rc_context(SETTINGS):
        for picture in deciding_pictures(ShownRun("", history)):
            drawn[picture.name] = svg_of(picture.figure)
            pictures.append({"name": picture.name, "caption": picture.caption})
    text = render("run.jinja", "html", drawn, shown=pictures, **content_of(folder, history))
    write_whole(folder / REPORT, text)
    return folder / REPORT


def content_of(folder: Path, history: History) -> dict[str, Any]:
    """Variables of the template of a run's report, except its pictures."""
    summary = history.summary()
    figures = figures_of(summary)
    body = summary.get("reference_body", CRANK)
    content: dict[str, Any] = {
        "title": f"Report of the run {summary.get('scene') or folder.resolve().name}",
        "lead": list(_answer(history, figures)),
        "blocks": figure_blocks(
            figures, body, searched="cycles" in summary, columns=_columns(history)
        ),
        "body": body,
        "searched": history.cycle.periodic,
        "notices": list(_notices(summary)),
        "versions": summary.get("versions", {}),
        "entries": [],
        "files": [],
        "result_digest": "",
    }
    table = folder / CSV_NAME
    if table.is_file():
        content["result_digest"] = hashlib.sha256(table.read_bytes()).hexdigest()
    path = folder / SCENE_NAME
    if path.is_file():
        scene = as_stored(path)
        name = f"{summary.get('scene') or 'scene'}.toml"
        text = path.read_text(encoding="utf-8")
        files = input_names(scene)
        entries = scene_entries(scene, history, _parts(folder, scene))
        content["entries"] = [entry._replace(words=_with(files, entry.words)) for entry in entries]
        content["files"] = run_inputs(text, scene, name, summary.get("inputs"))
        notes = (f"{file.name}: {file.note}" for file in content["files"] if file.note)
        content["notices"] += notes
    return content


def _columns(history: History) -> dict[str, Mapping[str, np.ndarray]]:
    """Columns of all lubricated joints over time, by the name of the joint."""
    return {name: joint.columns for name, joint in history.joints.items()}


def _parts(folder: Path, scene: Scene) -> dict[str, ReducedBody]:
    """Flexible bodies in the folder of a run, by name; those without a file are left out."""
    paths = {name: folder / BODY_FILE.format(name) for name in flexible(scene)}
    return {name: load_body(path) for name, path in paths.items() if path.is_file()}


def _with(names: Mapping[str, str], words: str) -> str:
    """Replace paths in a text by `names`."""
    for path, name in names.items():
        words = words.replace(path, name)
    return words


def _answer(history: History, figures: Sequence[Figure]) -> Iterator[str]:
    """Yield the sentences of the answer: status, and the extremes of all oil films."""
    summary = history.summary()
    if history.status == COMPLETE:
        cycles = history.cycles
        yield (
            f"The run is complete, and periodic after {cycles} cycles."
            if cycles
            else "The run is complete."
        )
    else:
        yield f"The results are not to be relied on. Status of the run: {history.status}."
    for name, words, choose in (
        ("min_film_thickness_m", "Thinnest oil film", min),
        ("max_pressure_Pa", "Highest oil film pressure", max),
    ):
        extremes = [figure for figure in figures if figure.joint and figure.name == name]
        if extremes:
            worst = choose(extremes, key=lambda figure: figure.value)
            bound = bound_text(worst)
            value = " ".join(filter(None, (value_text(worst), bound if "±" in bound else "")))
            alike = (figure.joint for figure in extremes if value_text(figure) == value_text(worst))
            yield f"{words}: {value} in {' and '.join(alike)}."
    if "cycle_used" in summary and not history.cycle.periodic:
        yield f"Results marked as those of the last cycle are from the {summary['cycle_used']}."


def _notices(summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield the warnings of a run: of its scene, its values, and its error estimates."""
    yield from summary.get("warnings", [])
    yield from summary.get("notices", [])
    for component, why in summary.get("error_budget_notes", {}).items():
        yield f"error by the {component.replace('_', ' ')} not estimated: {why}"
    if "multiplier_failure" in summary:
        yield f"largest multiplier not found: {summary['multiplier_failure']}"
