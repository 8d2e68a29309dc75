"""The report of a study: from its folder to pages and figures in the same folder."""

from __future__ import annotations

from pathlib import Path

from fenics_ehd.output import require_writable, write_whole
from fenics_ehd.report import statements_rotor, statements_slider_crank, tables
from fenics_ehd.report.document import Block, Document, Section, Text
from fenics_ehd.report.extremes import find_extremes
from fenics_ehd.report.paper_machine import machine_remark
from fenics_ehd.report.pictures import Pictures
from fenics_ehd.report.reading import read_study
from fenics_ehd.report.render import to_html, to_markdown
from fenics_ehd.report.statement import NOT_RUN
from fenics_ehd.report.study_data import Study
from fenics_ehd.report.style import house_style

#: Files in a study's folder.
PAGE, MARKDOWN, FIGURES, STATEMENTS_CSV = "report.html", "report.md", "figures", "statements.csv"

STATEMENTS = (*statements_slider_crank.STATEMENTS, *statements_rotor.STATEMENTS)


def write_report(directory: str | Path) -> Path:
    """Write ``report.html``, ``report.md``, ``figures/`` and ``statements.csv`` of a study.

    A study that goes on, or was stopped, is reported as far as it got. The same study gives
    the same files.

    Parameters
    ----------
    directory
        Of the study.

    Returns
    -------
    Path
        The HTML page, which needs no other file.

    Raises
    ------
    InputError
        The folder holds no study, or cannot be written to.
    """
    folder = Path(directory)
    study = read_study(folder)
    require_writable(folder)
    with house_style():
        document = make_document(study, folder / FIGURES)
    statements = tables.statement_table(study, STATEMENTS)
    write_whole(folder / STATEMENTS_CSV, tables.as_csv(statements))
    write_whole(folder / MARKDOWN, to_markdown(document, FIGURES))
    page = folder / PAGE
    write_whole(page, to_html(document, folder / FIGURES))
    return page


def make_document(study: Study, figures: Path) -> Document:
    """Content of the report, its figures drawn into a folder."""
    pictures = Pictures(study, figures)
    sections = (
        Section("What accuracy costs", _costs(study, pictures)),
        Section("The reference and its own errors", _reference(study)),
        Section("The paper's figures", tuple(pictures.curves())),
        Section("What the paper says, and what was measured", _paper(study)),
        Section("Step tolerance and film mesh", tuple(pictures.accuracy())),
        Section("What a run says of its own error", tuple(pictures.estimates())),
        Section("Modes and pressure on the bore", tuple(pictures.bore())),
        Section("All runs", (tables.run_table(study),)),
        Section("Stiff and extreme runs", _extremes(study)),
        Section("Versions, machine and mesh", _origin(study)),
    )
    kind = "Quick study" if study.info.get("quick") else "Study"
    kept = tuple(section for section in sections if section.blocks)
    return Document(f"{kind} of the {study.scene}: error against run time", kept)


def _costs(study: Study, pictures: Pictures) -> tuple[Block, ...]:
    intro = (
        f"{_progress(study)} Errors are those of two curves over time, peak pressure (relative to "
        "the reference's highest) and minimum film thickness (relative to the film at that time). "
        f"The reference is {tables.reference_name(study)}. {tables.floor_remark(study)} "
        f"{tables.film_mesh_remark(study)}"
    )
    return (Text(intro), *_some(tables.cost_table(study)), *pictures.cost())


def _progress(study: Study) -> str:
    """How many runs there are, and how many are missing."""
    ended = {run.run: run.complete for run in study.runs if run.status != NOT_RUN}
    total, complete = int(study.info.get("runs", len(ended))), sum(ended.values())
    failed, missing = len(ended) - complete, total - len(ended)
    words = [f"{complete} runs"]
    words += [f"{failed} more failed"] if failed else []
    words += [f"{missing} of {total} are still to come"] if missing > 0 else []
    return f"{', '.join(words)}."


def _some(*blocks: Block | None) -> tuple[Block, ...]:
    return tuple(block for block in blocks if block is not None)


def _reference(study: Study) -> tuple[Block, ...]:
    told = {
        key: value for key, value in study.reference.items() if key not in tables.REFERENCE_ERRORS
    }
    return _some(
        tables.reference_table(study),
        tables.properties_table("reference", told) if told else None,
    )


def _paper(study: Study) -> tuple[Block, ...]:
    intro = (
        "Statements of sections 4.2, 5.2 and 6 of Krinner and Rixen, Interface reduction methods "
        "for mechanical systems with elastohydrodynamic lubricated revolute joints, in our words. "
        "The rule by which we call one true stands beside it."
    )
    remark = machine_remark(study)
    own = [statement for statement in STATEMENTS if statement.scene == study.scene]
    others = [statement for statement in STATEMENTS if statement.scene != study.scene]
    return (
        Text(intro),
        *((Text(remark),) if remark else ()),
        tables.statement_table(study, own),
        Text("What the other example tells:"),
        tables.statement_table(study, others, folded=True),
    )


def _extremes(study: Study) -> tuple[Block, ...]:
    if study.scene != "slider-crank":
        return ()
    found = find_extremes(study)
    if found is None:
        how = (
            "Not here: python benchmarks/extremes.py -o extremes.md in a checkout makes the table, "
            "in about 20 minutes; laid into this folder, it becomes part of this report."
        )
        return (Text(how),)
    intro = (
        f"Not runs of this study but of the benchmark of the same machine, read from "
        f"{found.source}: what was expected stood there before anything ran. {found.summary}"
    )
    return (Text(intro), found.table)


def _origin(study: Study) -> tuple[Block, ...]:
    info = study.info
    known = {key: info[key] for key in ("version", "versions", "machine") if key in info}
    others = {key: value for key, value in info.items() if key not in (*known, "settings", "scene")}
    settings = info.get("settings")
    return _some(
        tables.properties_table("versions and machine", known | others),
        tables.mesh_table(study),
        tables.properties_table("settings of all runs", settings, folded=True)
        if settings
        else None,
    )
