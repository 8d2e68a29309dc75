"""Results of the paper's figures: errors, run times and verdicts as tables, files and one page.

A folder of ``fenics-ehd paper`` has a study of each machine. The figures whose runs have ended are
drawn; ``paper.csv`` and ``paper.json`` have the errors and run times of their runs, and the page
``report.html`` has figures, tables, and the verdicts on the statements of the paper.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.files import claim, require_writable, to_json, write_whole
from fenics_ehd.plotting.picture import SETTINGS, plt, save_in_formats
from fenics_ehd.study.cases import finite, write_table
from fenics_ehd.study.paper import OWN_ERROR, ROTOR, SLIDER_CRANK, PaperFigure, figures_of
from fenics_ehd.study.plan import REFERENCE
from fenics_ehd.study.report import paper_rotor, paper_slider_crank
from fenics_ehd.study.report.figures import family
from fenics_ehd.study.report.page import Table, percent, render
from fenics_ehd.study.report.paper_figures import draw_figure
from fenics_ehd.study.report.paper_statement import MEANINGS, NOT_RUN, OPEN, Finding, Statement
from fenics_ehd.study.report.study_data import CURVES, StudyData, StudyRow, read_study
from fenics_ehd.study.report.write import bounded

#: Statements of the paper, by scene.
STATEMENTS: Mapping[str, tuple[Statement, ...]] = {
    SLIDER_CRANK: paper_slider_crank.STATEMENTS,
    ROTOR: paper_rotor.STATEMENTS,
}

#: Names of the files with results: a table, all results, and the page.
TABLE_NAME = "paper.csv"
RESULTS_NAME = "paper.json"
PAGE_NAME = "report.html"

#: Columns of ``paper.csv`` from the table of a study: settings, errors, and cost of a run.
COLUMNS = (
    "run", "method", "pressure_set", "selection", "coordinates", "pressure_error_max",
    "pressure_error_l2", "film_error_max", "film_error_l2", "steps", "offline_s", "online_s",
    "status",
)  # fmt: skip

#: Headings of the table of a figure's runs.
HEADS = (
    "run", "coordinates", "pressure", "rms", "film", "rms", "steps", "integration", "reduction",
)  # fmt: skip

#: Meaning of the columns of this table.
NOTE = (
    "pressure, film: largest error of peak pressure over the reference's highest peak, and of "
    "minimum film thickness over the reference's; rms: root mean square of the error over that of "
    "the reference's curve; integration, reduction: processor times of the time integration and "
    "of the reduction of the body"
)

#: Headings of the table of statements.
STATEMENT_HEADS = ("where", "statement", "we call it true if", "measured", "verdict")


@dataclass(frozen=True)
class Judged:
    """Statement of the paper with its finding."""

    statement: Statement
    finding: Finding

    def document(self) -> dict[str, str]:
        """Entry of ``paper.json`` for the statement."""
        return {
            "section": self.statement.section,
            "statement": self.statement.text,
            "rule": self.statement.rule,
            "measured": self.finding.measured,
            "verdict": self.finding.verdict,
        }


@dataclass(frozen=True, eq=False)
class FigureResult:
    """Results of a figure whose runs have ended.

    Attributes
    ----------
    figure, study
        The figure, and the study with its runs.
    rows
        Rows of its runs in the table of the study, reference first.
    statements
        Statements about the figure with their findings.
    """

    figure: PaperFigure
    study: StudyData
    rows: tuple[StudyRow, ...]
    statements: tuple[Judged, ...]

    @property
    def failed(self) -> dict[str, str]:
        """Status of the runs that failed, by name."""
        return {row["run"]: row["status"] for row in self.rows if not row.complete}

    def table(self) -> Table:
        """Table of the runs of the figure with their errors and times."""
        return Table(HEADS, tuple(map(_cells, self.rows)))

    def document(self, directory: Path) -> dict[str, Any]:
        """Entry of ``paper.json`` for the figure; `directory` has the files of the figure."""
        names = [f"{self.figure.name}.{ending}" for ending in ("png", "svg")]
        return {
            "figure": self.figure.number,
            "scene": self.figure.scene,
            "caption": self.figure.caption,
            "files": [name for name in names if (directory / name).is_file()],
            "runs": [{name: _value(row[name]) for name in COLUMNS} for row in self.rows],
            "statements": [each.document() for each in self.statements],
            "failed": self.failed,
        }


@dataclass(frozen=True, eq=False)
class MachineResult:
    """Results of a machine of the paper.

    Attributes
    ----------
    study
        Study with the runs.
    figures
        Results of the figures whose runs have ended.
    others
        Statements that belong to no figure, with their findings.
    missing
        Numbers of the figures that have a run that has not ended.
    """

    study: StudyData
    figures: tuple[FigureResult, ...]
    others: tuple[Judged, ...]
    missing: tuple[int, ...]

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return str(self.study.info["scene"])

    @property
    def own_error(self) -> str:
        """Text with the reference's own errors of both curves; empty if they are unknown."""
        floors = [
            max((row.floor(curve) for row in self.study.rows), default=0.0) for curve in CURVES
        ]
        return " / ".join(map(percent, floors)) if any(floors) else ""


def _value(value: Any) -> Any:
    """Value of a cell for JSON: None for an empty cell, and a whole number without fraction."""
    if isinstance(value, float):
        return int(value) if value.is_integer() else finite(value)
    return value or None


def _cells(row: StudyRow) -> tuple[str, ...]:
    """Texts of a run's row in the table of its figure."""
    prefixes = {REFERENCE: "reference, ", OWN_ERROR: "coarser steps, "}
    name = prefixes.get(row["run"], "") + family(row)
    if not row.complete:
        return (f"{name}: {row['status']}", *[""] * (len(HEADS) - 1))
    errors = []
    for curve in CURVES:
        known = row["run"] != REFERENCE and row.measured
        errors.append(bounded(row, curve) if known else "")
        errors.append(percent(row[f"{curve.key}_error_l2"]) if known else "")
    times = (f"{row[name]:.1f} s" for name in ("online_s", "offline_s"))
    return (name, f"{row['coordinates']:.0f}", *errors, f"{row['steps']:.0f}", *times)


def read_results(directory: str | Path) -> list[MachineResult]:
    """Read and judge the runs in a folder of ``fenics-ehd paper``, for each machine.

    Raises
    ------
    InputError
        The folder has no study of a machine of the paper, or a file cannot be read.
    """
    folders = {scene: Path(directory) / scene for scene in STATEMENTS}
    studies = {
        scene: read_study(folder)
        for scene, folder in folders.items()
        if (folder / "study.json").is_file()
    }
    if not studies:
        raise InputError(
            f"{directory} has no runs of the paper's figures, because it has neither "
            f"{' nor '.join(f'{scene}/study.json' for scene in folders)}: fenics-ehd paper -o "
            f"{directory} computes them"
        )
    return [_result_of(study) for study in studies.values()]


def _result_of(study: StudyData) -> MachineResult:
    """Results of a machine from its study."""
    joint = study.joints[0]
    scene = study.info["scene"]
    rows = {row["run"]: row for row in joint.planned("reference", "methods")}
    judged = [Judged(each, each.judge(joint)) for each in STATEMENTS[scene]]
    figures = []
    missing = []
    for figure in figures_of(scene):
        runs = [rows[name] for name in figure.runs if name in rows]
        if len(runs) < len(figure.runs) or any(row["status"] == NOT_RUN for row in runs):
            missing.append(figure.number)
            continue
        about = tuple(each for each in judged if each.statement.figure == figure.number)
        figures.append(FigureResult(figure, study, tuple(runs), about))
    others = tuple(each for each in judged if each.statement.figure is None)
    return MachineResult(study, tuple(figures), others, tuple(missing))


def draw_figures(
    machines: Iterable[MachineResult], directory: Path, former: Mapping[str, bytes]
) -> dict[str, bytes]:
    """Draw the figures of machines whose runs have ended, except those of `former`.

    Returns
    -------
    dict
        Contents of the SVG files by name of the figure, those of `former` included.
    """
    drawn = dict(former)
    results = [result for machine in machines for result in machine.figures]
    with plt.rc_context(SETTINGS):
        for result in results:
            if result.figure.name in drawn:
                continue
            picture = draw_figure(result.figure, result.study)
            if picture is not None:
                _, vector = save_in_formats(picture, directory, result.figure.name)
                drawn[result.figure.name] = vector.read_bytes()
    return drawn


def write_paper_page(
    directory: str | Path, former: Mapping[str, bytes] | None = None
) -> list[MachineResult]:
    """Draw the paper's figures whose runs have ended, and write tables and the page.

    The same runs give the same files.

    Parameters
    ----------
    directory
        Folder of ``fenics-ehd paper``.
    former
        Contents of the SVG files of figures that are not drawn again, as `draw_figures` returns
        them.

    Returns
    -------
    list of MachineResult
        Results of each machine, as `read_results` returns them.

    Raises
    ------
    InputError
        The folder has no runs of the paper's figures, or it cannot be written to.
    """
    folder = Path(directory)
    machines = read_results(folder)
    require_writable(folder)
    claim(folder, (TABLE_NAME, RESULTS_NAME, PAGE_NAME))
    drawn = draw_figures(machines, folder, former or {})
    missing = missing_figures(machines)
    rows = [
        {"figure": result.figure.number, **{name: _value(row[name]) for name in COLUMNS}}
        for result in (result for machine in machines for result in machine.figures)
        for row in result.rows
    ]
    write_table(folder / TABLE_NAME, ("figure", *COLUMNS), rows)
    write_whole(folder / RESULTS_NAME, to_json(document(machines, folder, missing)))
    text = render(
        "paper.jinja",
        "html",
        drawn,
        machines=machines,
        missing=missing,
        directory=shlex.quote(str(folder)),
        statement_table=statement_table,
        verdicts=verdict_counts(machines),
        meanings=MEANINGS,
        note=NOTE,
    )
    write_whole(folder / PAGE_NAME, text)
    return machines


def missing_figures(machines: Iterable[MachineResult]) -> list[int]:
    """Numbers of the paper's figures that have a run that has not ended.

    `machines` are all machines with a study; the figures of the others have no runs yet.
    """
    missing = {scene: tuple(each.number for each in figures_of(scene)) for scene in STATEMENTS}
    missing |= {machine.scene: machine.missing for machine in machines}
    return [number for numbers in missing.values() for number in numbers]


def document(
    machines: Iterable[MachineResult], directory: Path, missing: Sequence[int]
) -> dict[str, Any]:
    """Content of ``paper.json``: figures with runs and statements, and all other statements.

    `missing` are the numbers of the figures that have a run that has not ended.
    """
    machines = list(machines)
    return {
        "figures": [
            result.document(directory) for machine in machines for result in machine.figures
        ],
        "statements": {
            machine.scene: [each.document() for each in machine.others] for machine in machines
        },
        "missing_figures": list(missing),
    }


def statement_table(statements: Iterable[Judged]) -> Table:
    """Table of statements: section, statement, rule, measured values, verdict."""
    rows = (
        (s.section, s.text, s.rule, finding.measured, finding.verdict)
        for s, finding in ((each.statement, each.finding) for each in statements)
    )
    return Table(STATEMENT_HEADS, tuple(rows), len(STATEMENT_HEADS))


def all_statements(machines: Iterable[MachineResult]) -> list[Judged]:
    """Statements with their findings: those of the figures, then all others."""
    judged: list[Judged] = []
    for machine in machines:
        for result in machine.figures:
            judged += result.statements
        judged += machine.others
    return judged


def verdict_counts(machines: Iterable[MachineResult]) -> str:
    """Text with the number of statements for each verdict."""
    counts = Counter(each.finding.verdict for each in all_statements(machines))
    return ", ".join(f"{counts[name]} {name}" for name in MEANINGS if counts[name])


def undecided(machines: Iterable[MachineResult]) -> bool:
    """True if there are statements for whose verdict more runs may be needed."""
    return any(each.finding.verdict in (NOT_RUN, OPEN) for each in all_statements(machines))


def statement_lines(statements: Iterable[Judged]) -> list[str]:
    """Printed lines of statements: verdict and statement, then the measured values."""
    lines = []
    for each in statements:
        lines.append(f"  {each.finding.verdict}: {each.statement.text}")
        lines.append(f"      {each.statement.section}: {each.finding.measured}")
    return lines
