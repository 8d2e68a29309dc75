"""``fenics-ehd paper``: figures and statements of the paper by Krinner and Rixen.

Imports inside functions: ``--help`` must work without runs and pictures, and quickly.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

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
    from fenics_ehd.study.report.paper_page import MachineResult


@question("Do the figures of the paper by Krinner and Rixen come out?")
@click.command()
@output_option("directory", "Folder for figures and runs [default: results/paper].")
@click.option(
    "--figures",
    "chosen",
    metavar="NUMBERS",
    help="Numbers of the figures, 5,7 or 5-8,10 [default: all, 5 to 8, 10 and 11].",
)
@flag(
    "--statements",
    "Also compute the runs that only statements of the paper need, which belong to no figure.",
)
@workers_option
@flag("--overwrite", "Discard the runs in the folder, and run all anew.")
@no_cache_option
@json_option
def paper(
    directory: str | None,
    chosen: str | None,
    statements: bool,
    workers: int | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Compute and draw figures 5 to 8, 10 and 11 of the paper, and judge its statements.

    Figures 5 to 8 are of the slider-crank with a flexible rod, figures 10 and 11 of the rotor in a
    flexible housing. Estimates of the time are printed first; then, for each figure, the errors and
    run times of its methods, and a verdict on each statement of the paper about the figure. The
    folder has the figures, the same results in paper.csv and paper.json, and on the page
    report.html. Runs in the folder that are already complete are not computed again.
    """
    from fenics_ehd.study.compare import StudyFolder, run_study
    from fenics_ehd.study.paper import (
        FIGURES,
        has_statement_runs,
        needed_runs,
        paper_study,
        parse_figures,
    )
    from fenics_ehd.study.pool import open_pool
    from fenics_ehd.study.report.paper_page import (
        document,
        draw_figures,
        missing_figures,
        read_results,
        write_paper_page,
    )

    figures = [FIGURES[n] for n in (parse_figures(chosen) if chosen else FIGURES)]
    target = Path(directory or Path("results") / "paper")
    require_writable(target)
    claim(target, [], "paper")
    with open_pool(workers) as pool, ExitStack() as held:
        folders = {}
        runs = {}
        for scene in dict.fromkeys(figure.scene for figure in figures):
            with_all = statements or has_statement_runs(target / scene, scene)
            study = paper_study(scene, statements=with_all)
            runs[scene] = tuple(study.cases) if statements else needed_runs(figures, scene)
            folder = StudyFolder(target / scene, study, overwrite=overwrite)
            folders[scene] = held.enter_context(folder)
            folder.take_stock()
        _print_estimates(figures, folders, runs)
        drawn: dict[str, bytes] = {}
        for scene, folder in folders.items():
            run_study(folder, pool, names=runs[scene], progress=shown_progress(logs=True))
            of_scene = [machine for machine in read_results(target) if machine.scene == scene]
            drawn = draw_figures(of_scene, target, drawn)
            if not as_json:
                echo("\n".join(_lines(of_scene, figures, target)))
        every = write_paper_page(target, drawn)
    machines = [machine for machine in every if machine.scene in folders]
    text = "\n".join(_last_lines(machines, target, statements))
    results = document(machines, target, missing_figures(every))
    answer({"directory": str(target), **results}, text, as_json)
    _require_complete(machines, figures, runs)


def _print_estimates(
    figures: Sequence[PaperFigure],
    folders: Mapping[str, StudyFolder],
    runs: Mapping[str, Sequence[str]],
) -> None:
    """Print to standard error how many runs each figure still needs, and their estimated time.

    `runs` are the names of all runs to be computed, by scene; the last line has their sums.
    """
    from fenics_ehd.study.paper import estimate, sum_of

    rows = [["figure", "runs", "complete", "to come"]]
    for figure in figures:
        each = estimate(folders[figure.scene], figure.runs)
        rows.append([str(figure.number), *_counts(each)])
    sums = [estimate(folders[scene], names) for scene, names in runs.items()]
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


def _lines(
    machines: Sequence[MachineResult], figures: Sequence[PaperFigure], target: Path
) -> Iterator[str]:
    """Yield the printed lines on the figures of machines: runs, errors, times, and statements."""
    from fenics_ehd.study.report.paper_page import NOTE, statement_lines

    for machine in machines:
        for result in machine.figures:
            if result.figure not in figures:
                continue
            file = target / f"{result.figure.name}.png"
            drawn = f": {file}" if file.is_file() else ""
            yield f"figure {result.figure.number}, {result.figure.caption}{drawn}"
            table = result.table()
            yield from aligned([table.heads, *table.rows], indent="  ")
            yield from statement_lines(result.statements)
            yield ""
        yield f"{machine.scene}, statements that belong to no figure"
        yield from statement_lines(machine.others)
        if machine.own_error:
            yield f"reference's own errors: {machine.own_error} (pressure / film)"
        yield ""
    yield NOTE


def _last_lines(machines: Sequence[MachineResult], target: Path, statements: bool) -> Iterator[str]:
    """Yield the last printed lines: numbers of verdicts, files, and how to judge the rest."""
    from fenics_ehd.study.report.paper_page import (
        PAGE_NAME,
        RESULTS_NAME,
        TABLE_NAME,
        undecided,
        verdict_counts,
    )

    yield f"verdicts on the statements of the paper: {verdict_counts(machines)}"
    if not statements and undecided(machines):
        yield "more runs decide more statements: repeat the command with --statements"
    yield f"page {target / PAGE_NAME}, results in {TABLE_NAME} and {RESULTS_NAME}"


def _require_complete(
    machines: Sequence[MachineResult],
    figures: Sequence[PaperFigure],
    runs: Mapping[str, Sequence[str]],
) -> None:
    """Fail if a run of a figure failed, or another run for a reason that is not its model.

    `runs` are the names of all runs that were asked for, by scene. Statements are judged by runs
    whose steps or film break down.

    Raises
    ------
    FailedCasesError
        A run failed; the message has the first reason.
    """
    from fenics_ehd.study.pool import FailedCasesError
    from fenics_ehd.study.report.paper_statement import broke_down

    failures: dict[str, str] = {}
    for result in (result for machine in machines for result in machine.figures):
        if result.figure in figures:
            scene = result.figure.scene
            failures |= {f"{scene}/{name}": status for name, status in result.failed.items()}
    for machine in machines:
        asked = [row for row in machine.study.rows if row["run"] in runs[machine.scene]]
        failures |= {
            f"{machine.scene}/{row['run']}": row["status"]
            for row in asked
            if not row.complete and not broke_down(row)
        }
    if failures:
        name, status = next(iter(failures.items()))
        raise FailedCasesError(
            f"{len(failures)} runs failed, the first is {name}: {status}: the same command runs "
            "them again"
        )
