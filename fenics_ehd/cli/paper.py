"""``fenics-ehd paper``: the figures of the paper by Krinner and Rixen.

Imports inside functions: ``--help`` must work without runs and pictures, and quickly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.base.files import claim, require_writable
from fenics_ehd.base.progress import shown_progress
from fenics_ehd.cli.options import (
    aligned,
    answer,
    echo,
    flag,
    json_option,
    no_cache_option,
    output_option,
    question,
    workers_option,
)

if TYPE_CHECKING:  # the import is slow, and --help must be fast
    from fenics_ehd.study.compare import StudyFolder
    from fenics_ehd.study.paper import Estimate, PaperFigure


@question("Do the figures of the paper by Krinner and Rixen come out?")
@click.command()
@output_option("directory", "Folder for figures and runs [default: results/paper].")
@click.option(
    "--figures",
    "chosen",
    metavar="NUMBERS",
    help="Numbers of the figures, 5,7 or 5-8,10 [default: all, 5 to 8, 10 and 11].",
)
@workers_option
@flag("--overwrite", "Discard the runs in the folder, and run all anew.")
@no_cache_option
@json_option
def paper(
    directory: str | None,
    chosen: str | None,
    workers: int | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Compute and draw figures 5 to 8, 10 and 11 of the paper.

    Figures 5 to 8 are of the slider-crank with a flexible rod, figures 10 and 11 of the rotor in a
    flexible housing. Estimates of the time are printed first. Runs in the folder that are already
    complete are not computed again.
    """
    from fenics_ehd.study.compare import StudyFolder, run_study
    from fenics_ehd.study.paper import FIGURES, needed_runs, paper_study, parse_figures
    from fenics_ehd.study.pool import open_pool

    figures = [FIGURES[n] for n in (parse_figures(chosen) if chosen else FIGURES)]
    target = Path(directory or Path("results") / "paper")
    require_writable(target)
    claim(target, [], "paper")
    with open_pool(workers) as pool, ExitStack() as held:
        folders = {}
        for scene in dict.fromkeys(figure.scene for figure in figures):
            folder = StudyFolder(target / scene, paper_study(scene), overwrite=overwrite)
            folders[scene] = held.enter_context(folder)
            folder.take_stock()
        _print_estimates(figures, folders)
        entries = []
        for scene, folder in folders.items():
            names = needed_runs(figures, scene)
            run_study(folder, pool, names=names, progress=shown_progress(logs=True))
            entries += [_drawn(each, folder, target) for each in figures if each.scene == scene]
    rows = [["figure", "file", "contents"]]
    rows += [[str(e["figure"]), (e["files"] or ["-"])[0], e["caption"]] for e in entries]
    text = "\n".join(aligned(rows, (1, 2)))
    answer({"directory": str(target), "figures": entries}, text, as_json)
    _require_complete(entries)


def _print_estimates(figures: Sequence[PaperFigure], folders: Mapping[str, StudyFolder]) -> None:
    """Print to standard error how many runs each figure still needs, and their estimated time."""
    from fenics_ehd.study.paper import estimate, needed_runs, sum_of

    rows = [["figure", "runs", "complete", "to come"]]
    for figure in figures:
        each = estimate(folders[figure.scene], figure.runs)
        rows.append([str(figure.number), *_counts(each)])
    sums = [estimate(folders[scene], needed_runs(figures, scene)) for scene in folders]
    rows.append(["all", *_counts(sum_of(sums))])
    for line in aligned(rows):
        echo(line, err=True)
    echo(
        "times are estimates for one core; runs that several figures need are counted once in all",
        err=True,
    )


def _counts(each: Estimate) -> list[str]:
    return [str(each.runs), str(each.runs - each.missing), _estimate(each.seconds)]


def _estimate(seconds: float) -> str:
    """Text of an estimated time, ``40 s`` or ``3 min``; two digits are enough."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def _drawn(figure: PaperFigure, folder: StudyFolder, target: Path) -> dict[str, Any]:
    """Draw a figure from the runs in a folder; entry of the result for it."""
    from fenics_ehd.multibody.verdict import COMPLETE
    from fenics_ehd.study.report.paper_figures import write_figure
    from fenics_ehd.study.report.study_data import read_study

    files = write_figure(figure, read_study(folder.path), target)
    statuses = {name: folder.status(name) for name in figure.runs}
    return {
        "figure": figure.number,
        "scene": figure.scene,
        "caption": figure.caption,
        "files": [str(path) for path in files],
        "runs": [str(folder.run(name)) for name in figure.runs],
        "failed": {name: status for name, status in statuses.items() if status != COMPLETE},
    }


def _require_complete(entries: Sequence[Mapping[str, Any]]) -> None:
    """Fail if a run of a figure failed.

    Raises
    ------
    FailedCasesError
        A run failed; the message has the first reason.
    """
    from fenics_ehd.study.pool import FailedCasesError

    failures = {
        f"{entry['scene']}/{name}": why
        for entry in entries
        for name, why in entry["failed"].items()
    }
    if failures:
        name, why = next(iter(failures.items()))
        raise FailedCasesError(
            f"{len(failures)} runs failed, the first is {name}: {why}: the same command runs them "
            "again"
        )
