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

from fenics_ehd.base.files import SCENE_NAME, claim, require_writable, write_whole
from fenics_ehd.multibody.cycle import CRANK
from fenics_ehd.multibody.figures import Figure, figures_of
from fenics_ehd.multibody.history import CSV_NAME, History, load_history
from fenics_ehd.multibody.verdict import COMPLETE
from fenics_ehd.plotting.picture import SETTINGS, plt, svg_of
from fenics_ehd.plotting.shown import ShownRun
from fenics_ehd.results.recorded_run import REPORT
from fenics_ehd.scenes.scene import as_stored, input_files
from fenics_ehd.study.report.page import render
from fenics_ehd.study.report.run_figures import bound_text, figure_blocks, value_text
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
        "blocks": figure_blocks(figures, body, searched="cycles" in summary),
        "body": body,
        "notices": list(_notices(summary)),
        "versions": summary.get("versions", {}),
        "checksums": {
            name: hashlib.sha256((folder / name).read_bytes()).hexdigest()
            for name in (SCENE_NAME, CSV_NAME)
            if (folder / name).is_file()
        },
        "entries": [],
        "scene_text": "",
        "inputs": [],
    }
    path = folder / SCENE_NAME
    if path.is_file():
        scene = as_stored(path)
        content["entries"] = list(scene_entries(scene, history))
        content["scene_text"] = path.read_text(encoding="utf-8")
        content["inputs"] = [str(file) for file in input_files("", scene)]
    return content


def _answer(history: History, figures: Sequence[Figure]) -> Iterator[str]:
    """Yield the sentences of the answer: status, and the extremes of all oil films."""
    summary = history.summary()
    if history.status == COMPLETE:
        cycles = history.cycles
        yield (
            f"The run is complete: it is periodic after {cycles} cycles."
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
            yield f"{words}: {value} in {worst.joint}."
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
