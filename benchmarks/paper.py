"""Figures and statements of the paper from studies of its two machines.

    python benchmarks/paper.py --run slider-crank-paper CRANK
    python benchmarks/paper.py --run rotor-paper ROTOR
    python benchmarks/paper.py CRANK ROTOR

The first two make studies of the scenes with the paper's numbers of modes; a study that was stopped
continues. The third one reads studies that are there, those of ``fenics-ehd study`` as well.

Krinner and Rixen, Interface reduction methods for mechanical systems with elastohydrodynamic
lubricated revolute joints: figures 5 to 8, 10 and 11, and the statements of sections 4.2, 5.2 and 6
in our words, each with the rule by which we call it true. Each study's folder gets ``paper.md`` and
``paper/`` with the figures; the statements are printed as well.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import paper_rotor
import paper_slider_crank
from matplotlib.figure import Figure
from paper_statement import NOT_RUN, near, paper_m3

import fenics_ehd as ehd
from fenics_ehd.base.files import PICTURE_FORMATS, write_whole
from fenics_ehd.plotting.picture import SETTINGS, plt, save
from fenics_ehd.study.report.figures import best, draw_errors, draw_methods
from fenics_ehd.study.report.study_data import JointData, StudyData, StudyRow, read_study

#: By scene.
STATEMENTS = {
    "slider-crank-paper": paper_slider_crank.STATEMENTS,
    "rotor-paper": paper_rotor.STATEMENTS,
}

#: Typical safe film thickness of engine bearings, section 4.2 [um].
SAFE_FILM_THICKNESS = 2.5

#: Most curves in one panel with the reference.
MOST = 4

#: Overall modes of the errors over time of the slider-crank: M3 with 31 residual modes.
M3_SIZE = 39

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


def spread(rows: Sequence[StudyRow], most: int = MOST) -> list[StudyRow]:
    """At most so many of the runs, from few coordinates to many, evenly by rank."""
    ordered = sorted(rows, key=lambda row: row["coordinates"])
    if len(ordered) <= most:
        return ordered
    return [ordered[round(i * (len(ordered) - 1) / (most - 1))] for i in range(most)]


def of_size(joint: JointData, size: int) -> list[StudyRow]:
    """One run of each method with about so many coordinates, and M4 with its own."""
    kinds = ({"method": "m1"}, {"method": "m2"}, paper_m3(joint))
    rows = [near(joint.measured("methods", **kind), size)[:1] for kind in kinds]
    return [row for found in rows for row in found] + best(joint.study, "m4")


def figures(joint: JointData) -> Iterator[tuple[str, Figure | None, str]]:
    """Name, figure, None where there is nothing to draw, and caption of the paper's figures."""
    if joint.study.info["scene"] == "slider-crank-paper":
        yield from crank_figures(joint)
        return
    few, many = (of_size(joint, size) for size in (paper_rotor.FEW, paper_rotor.MANY))
    yield "curves", draw_methods(joint.study, few), f"About {paper_rotor.FEW} coordinates."
    yield "figure_10", draw_errors(joint.study, few), f"About {paper_rotor.FEW} coordinates."
    yield "figure_11", draw_errors(joint.study, many), f"About {paper_rotor.MANY} coordinates."


def crank_figures(joint: JointData) -> Iterator[tuple[str, Figure | None, str]]:
    """Those of the slider-crank, with the line of a safe film."""
    pc1 = joint.measured("methods", method="m3", pressure_set="pc1")
    rich = [row for row in pc1 if row["residual_modes"] in paper_slider_crank.RICH]
    wanted = {
        "figure_5": (sorted(rich, key=lambda row: row.worst_error)[:1], "the reference, here the "
                     "full interface, and the paper's, M3 with 60 residual modes of unit pressures "
                     "(61 here, where run so)"),
        "figure_6": (spread(joint.measured("methods", method="m1")), "M1"),
        "figure_7": (spread(joint.measured("methods", method="m2")), "M2"),
        "figure_8": (spread(joint.measured("methods", **paper_m3(joint))), "M3 with long and short "
                     "bearing shapes"),
        "selections": (joint.measured("methods", **paper_slider_crank.FEW), "M3 with 31 residual "
                       "modes by each selection; the smallest eigenvalues are (31)-(32) to the "
                       "letter"),
    }  # fmt: skip
    for name, (rows, caption) in wanted.items():
        figure = draw_methods(joint.study, rows)
        if figure is not None:
            axes = figure.axes[1]
            axes.axhline(SAFE_FILM_THICKNESS, color="0.3", linestyle=(0, (1, 2)), linewidth=1.2)
            axes.annotate("safe film of engine bearings", (0.02, SAFE_FILM_THICKNESS), fontsize=7.5,
                          xycoords=("axes fraction", "data"), va="top")  # fmt: skip
        yield name, figure, caption
    caption = f"about {M3_SIZE} coordinates"
    yield "errors_over_time", draw_errors(joint.study, of_size(joint, M3_SIZE)), caption


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
    """Write ``paper.md`` and ``paper/`` into a study's folder; lines of the page."""
    joint = read_paper(directory)
    lines = [f"## {joint.study.info['scene']}", "", *progress(joint.study)]
    lines += ["Errors are the largest ones of peak pressure / minimum film.", ""]
    lines += [*statement_table(joint), ""]
    with plt.rc_context(SETTINGS):
        for name, figure, caption in figures(joint):
            if figure is not None:
                save(
                    figure, [directory / "paper" / f"{name}.{ending}" for ending in PICTURE_FORMATS]
                )
                lines += [f"![{name}](paper/{name}.png)", "", f"*{name}: {caption}*", ""]
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
        print("\n".join(write_paper(directory)).partition("\n![")[0])


if __name__ == "__main__":
    main()
