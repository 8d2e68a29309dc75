"""Figures 5 to 8, 10 and 11 of Krinner and Rixen: their runs, and estimates of the time they take.

The paper has two machines, the slider-crank of section 4 and the rotor of section 5, which are the
shipped scenes ``slider-crank-paper`` and ``rotor-paper``. The runs of all figures of a machine are
a study of its scene. A figure needs the reference and some variants, which other figures of the
same machine share. Statements of the paper that belong to no figure need further variants.

M1 and M2 have as many modes as M3 has vibration and residual modes together, as in the paper.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.study.compare import StudyFolder
from fenics_ehd.study.plan import (
    REFERENCE,
    SELECTIONS,
    Scope,
    Study,
    Variant,
    full,
    m1,
    m2,
    m3,
    m4,
    make_study,
    steps,
)

#: Names of the scenes of the paper's machines.
SLIDER_CRANK = "slider-crank-paper"
ROTOR = "rotor-paper"

#: M3 of either machine: pressure set, and selection of residual modes. The paper prints (31)-(32),
#: the smallest eigenvalues; with these, the errors exceed 50 %.
ROD_M3 = ("pc2", "lowest-frequency")
HOUSING_M3 = ("pc1", "largest-eigenvalue")

#: Quantities of a figure: peak pressure and minimum film thickness, or the errors of both.
VALUES = "values"
ERRORS = "errors"


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper.

    Attributes
    ----------
    number
        Number of the figure in the paper.
    scene
        Name of the scene of its machine.
    variants
        Variants of the scene that are drawn, in addition to the reference.
    shown
        Quantities over time, `VALUES` or `ERRORS`.
    caption
        Contents of the figure in words.
    """

    number: int
    scene: str
    variants: tuple[Variant, ...]
    shown: str
    caption: str

    @property
    def name(self) -> str:
        """Stem of the figure's files, ``figure_5``."""
        return f"figure_{self.number}"

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of all runs that the figure needs, reference first."""
        own_error = () if self.shown == VALUES else (OWN_ERROR,)
        return (REFERENCE, *own_error, *(variant.name for variant in self.variants))


#: Name of the run that shows the step error of the reference itself, its largest error.
OWN_ERROR = f"{REFERENCE}-step"

#: Modes of M1 and M2 in figures 6 and 7, and residual modes of M3 in figure 8: P_c2 has only 80
#: columns.
ROD_MODES = (22, 37, 67, 127)
ROD_RESIDUAL_MODES = (16, 31, 61, 80)


def _alike(modes: int) -> tuple[Variant, ...]:
    """M1, M2 and M3 of the rotor with equally many modes, and M4 with its 10 vibration modes."""
    return (m1(modes), m2(modes), m3(*HOUSING_M3, modes - 10), m4(10))


FIGURES = {
    figure.number: figure
    for figure in (
        PaperFigure(
            5,
            SLIDER_CRANK,
            (m3("pc1", "lowest-frequency", 60),),
            VALUES,
            "full interface, and the paper's reference, M3 with 60 residual modes of unit "
            "pressures",
        ),
        PaperFigure(6, SLIDER_CRANK, tuple(map(m1, ROD_MODES)), VALUES, "M1, Craig-Bampton"),
        PaperFigure(7, SLIDER_CRANK, tuple(map(m2, ROD_MODES)), VALUES, "M2, two Craig-Bampton "
                    "steps"),
        PaperFigure(8, SLIDER_CRANK, tuple(m3(*ROD_M3, n) for n in ROD_RESIDUAL_MODES), VALUES,
                    "M3 with long and short bearing shapes"),
        PaperFigure(10, ROTOR, _alike(30), ERRORS, "M1, M2, M3 with 30 modes"),
        PaperFigure(11, ROTOR, _alike(50), ERRORS, "M1, M2, M3 with 50 modes"),
    )
}  # fmt: skip


@dataclass(frozen=True)
class Reference:
    """Reference of a machine: the full interface with fine steps.

    Attributes
    ----------
    variant, steps
        Variant with the full interface, and settings of its steps.
    step_check, basis_check
        Settings of other steps, and another variant with its steps, which show the error of the
        reference itself.
    start
        Time after which errors are evaluated [s]: before, the film builds up.
    """

    variant: Variant
    steps: Mapping[str, Any]
    step_check: Mapping[str, Any]
    basis_check: tuple[Variant, Mapping[str, Any]]
    start: float


REFERENCES = {
    SLIDER_CRANK: Reference(full(20), steps(1e-7), steps(1e-6), (full(6), steps(1e-6)), 2e-4),
    # Errors fall as tolerance^(2/3): the difference of these steps is the error of the reference's.
    ROTOR: Reference(full(20), steps(1e-6), steps(3e-6), (full(10), steps(1e-6)), 1.05e-3),
}


def _selections(pressure_set: str, modes: Iterable[int]) -> tuple[Variant, ...]:
    """M3 with all selections of residual modes and several numbers of them."""
    return tuple(m3(pressure_set, selection, n) for n in modes for selection in SELECTIONS)


#: Variants that only statements of the paper need, by scene; variants of figures may be among them.
STATEMENT_VARIANTS: Mapping[str, tuple[Variant, ...]] = {
    SLIDER_CRANK: (
        # More than four times as many modes as M3 needs for one per cent.
        *map(m2, (157, 247)),
        *_selections("pc1", (16, 31, 61, 121)),
        *_selections("pc2", ROD_RESIDUAL_MODES),
        m3("pc2-long", "every-column", 40),
        m3("pc2-short", "every-column", 40),
    ),
    ROTOR: (
        m1(90),
        m2(90),
        *_selections("pc1", (20, 40, 80)),
        *_selections("pc2", (20, 40, 80)),
    ),
}


def figures_of(scene: str) -> list[PaperFigure]:
    """Figures of a machine, by the name of its scene."""
    return [figure for figure in FIGURES.values() if figure.scene == scene]


def paper_study(
    scene: str, settings: Mapping[str, object] | None = None, *, statements: bool = False
) -> Study:
    """Study with the runs of all figures of a machine.

    Parameters
    ----------
    scene
        Name of the scene of the machine.
    settings
        Settings that replace those of the scene in all runs, by full key.
    statements
        Whether the runs that only statements need are included.
    """
    reference = REFERENCES[scene]
    variants = {v.name: v for figure in figures_of(scene) for v in figure.variants}
    if statements:
        variants |= {v.name: v for v in STATEMENT_VARIANTS[scene]}
    scope = Scope(
        methods=tuple(variants.values()),
        tolerances=(),
        stepped=(),
        films=(),
        meshed=(),
        finest_steps={},
        reference=reference.variant,
        reference_steps=reference.steps,
        step_check=reference.step_check,
        film_check=None,
        basis_check=reference.basis_check,
        settings=settings or {},
    )
    return make_study(scene, scope=scope, start=reference.start)


def parse_figures(text: str) -> tuple[int, ...]:
    """Numbers of figures from a text with numbers and ranges, ``5 7``, ``5,7`` or ``5-8,10``.

    A range has the paper's figures within its ends. The result is in ascending order.

    Raises
    ------
    SettingsError
        The text is malformed, or a number is not one of `FIGURES`.
    """
    numbers: set[int] = set()
    for item in re.split(r"[\s,]+", text.strip()):
        match = re.fullmatch(r"([0-9]{1,3})(?:-([0-9]{1,3}))?", item)
        ends = [int(end) for end in match.groups() if end] if match else []
        if not ends or not {ends[0], ends[-1]} <= FIGURES.keys() or ends[0] > ends[-1]:
            known = ", ".join(map(str, FIGURES))
            raise SettingsError(
                f"--figures {text!r}: {item!r} is no figure of computed results in the paper: "
                f"choose from {known}, for instance --figures 5,7 or --figures 5-8"
            )
        numbers.update(n for n in FIGURES if ends[0] <= n <= ends[-1])
    return tuple(sorted(numbers))


#: Processor time of the runs, including their reductions, on one core of a virtual machine of 2026,
#: by scene and run [s].
SECONDS: Mapping[str, Mapping[str, float]] = {
    SLIDER_CRANK: {
        REFERENCE: 62,
        OWN_ERROR: 37,
        f"{REFERENCE}-basis": 31,
        "m1-22": 2.0,
        "m1-37": 2.5,
        "m1-67": 3.1,
        "m1-127": 8.1,
        "m2-22": 2.6,
        "m2-37": 3.5,
        "m2-67": 3.7,
        "m2-127": 4.9,
        "m3-pc1-lowest-frequency-60": 3.1,
        "m3-pc2-lowest-frequency-16": 2.4,
        "m3-pc2-lowest-frequency-31": 2.6,
        "m3-pc2-lowest-frequency-61": 3.3,
        "m3-pc2-lowest-frequency-80": 3.7,
        "m2-157": 5.4,
        "m2-247": 11,
        "m3-pc1-largest-eigenvalue-16": 2.6,
        "m3-pc1-lowest-frequency-16": 2.2,
        "m3-pc1-smallest-eigenvalue-16": 1.9,
        "m3-pc1-largest-eigenvalue-31": 2.6,
        "m3-pc1-lowest-frequency-31": 2.5,
        "m3-pc1-smallest-eigenvalue-31": 1.9,
        "m3-pc1-largest-eigenvalue-61": 3.0,
        "m3-pc1-lowest-frequency-61": 3.0,
        "m3-pc1-smallest-eigenvalue-61": 2.8,
        "m3-pc1-largest-eigenvalue-121": 4.3,
        "m3-pc1-lowest-frequency-121": 4.8,
        "m3-pc1-smallest-eigenvalue-121": 4.3,
        "m3-pc2-largest-eigenvalue-16": 1.9,
        "m3-pc2-smallest-eigenvalue-16": 1.6,
        "m3-pc2-largest-eigenvalue-31": 1.9,
        "m3-pc2-smallest-eigenvalue-31": 2.0,
        "m3-pc2-largest-eigenvalue-61": 2.8,
        "m3-pc2-smallest-eigenvalue-61": 2.4,
        "m3-pc2-largest-eigenvalue-80": 3.0,
        "m3-pc2-smallest-eigenvalue-80": 2.8,
        "m3-pc2-long-every-column-40": 3.1,
        "m3-pc2-short-every-column-40": 2.9,
    },
    ROTOR: {
        REFERENCE: 59,
        OWN_ERROR: 39,
        f"{REFERENCE}-basis": 57,
        "m1-30": 2.3,
        "m1-50": 3.2,
        "m2-30": 2.7,
        "m2-50": 3.5,
        "m3-pc1-largest-eigenvalue-20": 2.6,
        "m3-pc1-largest-eigenvalue-40": 3.4,
        "m4-10-2e-03": 7.1,
        "m1-90": 6.1,
        "m2-90": 7.6,
        "m3-pc1-lowest-frequency-20": 2.4,
        "m3-pc1-smallest-eigenvalue-20": 2.1,
        "m3-pc1-lowest-frequency-40": 3.1,
        "m3-pc1-smallest-eigenvalue-40": 2.3,
        "m3-pc1-largest-eigenvalue-80": 4.2,
        "m3-pc1-lowest-frequency-80": 4.4,
        "m3-pc1-smallest-eigenvalue-80": 3.1,
        "m3-pc2-largest-eigenvalue-20": 2.3,
        "m3-pc2-lowest-frequency-20": 2.4,
        "m3-pc2-smallest-eigenvalue-20": 2.4,
        "m3-pc2-largest-eigenvalue-40": 2.6,
        "m3-pc2-lowest-frequency-40": 2.9,
        "m3-pc2-smallest-eigenvalue-40": 2.9,
        "m3-pc2-largest-eigenvalue-80": 3.8,
        "m3-pc2-lowest-frequency-80": 3.9,
        "m3-pc2-smallest-eigenvalue-80": 3.8,
    },
}


@dataclass(frozen=True)
class Estimate:
    """Time that runs will take.

    Attributes
    ----------
    runs, missing
        Number of runs, and number of those that are not complete.
    seconds
        Estimated processor time of the missing runs [s].
    """

    runs: int
    missing: int
    seconds: float


def estimate(folder: StudyFolder, runs: Collection[str]) -> Estimate:
    """Time that some runs of a machine will take, from the runs in its folder.

    The times in `SECONDS` are multiplied by the ratio of measured to stored times of the runs that
    are complete.
    """
    stored = SECONDS[folder.study.scene.name]
    complete = {
        name: outcome
        for name, outcome in folder.outcomes.items()
        if outcome.complete and name in stored
    }
    measured = sum(
        outcome.figures["processor_time_s"] + outcome.figures["offline_s"]
        for outcome in complete.values()
    )
    expected = sum(stored[name] for name in complete)
    factor = measured / expected if complete else 1.0
    missing = [name for name in runs if name not in complete]
    return Estimate(len(runs), len(missing), factor * sum(stored[name] for name in missing))


def sum_of(estimates: Iterable[Estimate]) -> Estimate:
    """Sum of the estimates of several machines."""
    each = list(estimates)
    return Estimate(
        sum(e.runs for e in each), sum(e.missing for e in each), sum(e.seconds for e in each)
    )


def has_statement_runs(directory: Path, scene: str) -> bool:
    """True if a folder with the runs of a machine has runs that only statements need."""
    of_figures = {run for figure in figures_of(scene) for run in figure.runs}
    names = {variant.name for variant in STATEMENT_VARIANTS[scene]} - of_figures
    return any((directory / "runs" / name).is_dir() for name in names)


def needed_runs(figures: Iterable[PaperFigure], scene: str) -> Sequence[str]:
    """Names of the runs of a machine that some figures need, each once."""
    of_machine = [figure for figure in figures if figure.scene == scene]
    return tuple(dict.fromkeys(run for figure in of_machine for run in figure.runs))
