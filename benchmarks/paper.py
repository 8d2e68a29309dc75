"""Statements of the paper, judged from studies of its two machines.

    python benchmarks/paper.py --run slider-crank-paper DIR/slider-crank-paper
    python benchmarks/paper.py --run rotor-paper DIR/rotor-paper
    python benchmarks/paper.py DIR/slider-crank-paper DIR/rotor-paper

The first two make studies of the scenes with the paper's numbers of modes and some more; a study
that was stopped continues, and the runs of ``fenics-ehd paper -o DIR``, which draws the paper's
figures, are used. The third one reads studies that exist, those of ``fenics-ehd study`` as well.

Krinner and Rixen, Interface reduction methods for mechanical systems with elastohydrodynamic
lubricated revolute joints: the statements of sections 4.2, 5.2 and 6 in our words, each with the
rule by which we call it true. The table is printed, and written to ``paper.md`` in the folder of
the study.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import paper_rotor
import paper_slider_crank
from paper_statement import NOT_RUN

import fenics_ehd as ehd
from fenics_ehd.base.files import write_whole
from fenics_ehd.study.paper import ROTOR, SLIDER_CRANK
from fenics_ehd.study.report.study_data import JointData, StudyData, read_study

#: By scene.
STATEMENTS = {
    SLIDER_CRANK: paper_slider_crank.STATEMENTS,
    ROTOR: paper_rotor.STATEMENTS,
}

HEADS = ("where", "statement", "we call it true if", "measured", "verdict")


def read_paper(directory: Path) -> JointData:
    """The bearing of a study of one of the paper's machines.

    Raises
    ------
    ehd.errors.InputError
        It is the study of something else.
    """
    study = read_study(directory)
    if study.info["scene"] not in STATEMENTS:
        known = " or ".join(STATEMENTS)
        raise ehd.errors.InputError(
            f"{directory}: scene = {study.info['scene']}, the paper's are {known}"
        )
    return study.joints[0]


def statement_table(joint: JointData) -> list[str]:
    """Statements, what was measured and the verdict, as rows of a Markdown table."""
    rows = [HEADS, ("---",) * len(HEADS)]
    for statement in STATEMENTS[joint.study.info["scene"]]:
        finding = statement.judge(joint)
        rows.append(
            (statement.place, statement.text, statement.rule, finding.measured, finding.verdict)
        )
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]


def write_paper(directory: Path) -> list[str]:
    """Write the statements and verdicts to ``paper.md`` in a study's folder; lines of the page."""
    joint = read_paper(directory)
    lines = [f"## {joint.study.info['scene']}", "", *progress(joint.study)]
    lines += ["Errors are the largest ones of peak pressure / minimum film.", ""]
    lines += [*statement_table(joint), ""]
    write_whole(directory / "paper.md", "\n".join(lines))
    return lines


def progress(study: StudyData) -> list[str]:
    """A line that names what is missing, if anything is."""
    missing = {row["run"] for row in study.rows if row["status"] == NOT_RUN}
    quick = ["Of a quick study.", ""] if study.info.get("quick") else []
    return quick + ([f"{len(missing)} runs are still to come.", ""] if missing else [])


def run_paper(scene: str, directory: Path, workers: int) -> None:
    """Study a scene with the paper's numbers of modes, as far as it has not been done."""
    from paper_scope import SCOPES

    from fenics_ehd.study import compare, plan, pool

    scope, start = SCOPES[scene]
    study = plan.make_study(scene, scope=scope, start=start)
    with pool.open_pool(workers) as processes, compare.StudyFolder(directory, study) as held:
        compare.run_study(held, processes)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("studies", nargs="+", type=Path, help="folders of studies")
    parser.add_argument("--run", choices=STATEMENTS, metavar="SCENE", help="study it there first")
    parser.add_argument("--workers", type=int, default=1, help="with 1 no run disturbs another")
    asked = parser.parse_args()
    for directory in asked.studies:
        if asked.run:
            run_paper(asked.run, directory, asked.workers)
        print("\n".join(write_paper(directory)))


if __name__ == "__main__":
    main()
