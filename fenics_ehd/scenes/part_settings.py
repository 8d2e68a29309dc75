"""Settings of a part's reduction, their choices, and settings of the output.

The module is imported by ``--help``, and imports nothing that is slow.
"""

from __future__ import annotations

import attrs

from fenics_ehd.base.fields import choice, count, flag, names, number, text
from fenics_ehd.base.needs import NONE, not_with, only_with

ELEMENTS = ("serendipity", "lagrange")
METHODS = ("m1", "m2", "m3", "m4", "full", "rigid")
SOLVERS = ("auto", "direct", "iterative")
CELLS = ("hex", "tet")
PRESSURE_SETS = ("pc1", "pc2", "pc2-long", "pc2-short", "journal")
SELECTIONS = (
    "lowest-frequency",
    "largest-eigenvalue",
    "smallest-eigenvalue",
    "every-column",
)


@attrs.frozen
class ReductionSettings:
    """Reduction of an elastic part."""

    method: str = choice("m4", METHODS, "the last one without elasticity")
    modes: int = only_with(
        count(37, "fixed-boundary modes (m1, m2)", least=1), "method", among=("m1", "m2")
    )
    interior_modes: int = only_with(
        count(20, "fixed-interface modes of the first step (m2)"), "method", among=("m2",)
    )
    vibration_modes: int = only_with(
        count(6, "free-floating vibration modes n_v (m3, m4, full)"),
        "method",
        among=("m3", "m4", "full"),
    )
    residual_modes: int = only_with(count(31, "residual modes n_r (m3)"), "method", among=("m3",))
    pressure_set: str = not_with(
        only_with(
            choice("pc2", PRESSURE_SETS, "unit pressures (34), shapes (35) (m3)"),
            "method",
            among=("m3",),
        ),
        "snapshots",
    )
    snapshots: str = only_with(
        text(
            NONE,
            "folder of a former run, whose main pressure patterns are kept in place of "
            "pressure_set and selection, or none (m3)",
        ),
        "method",
        among=("m3",),
    )
    selection: str = not_with(
        only_with(
            choice("lowest-frequency", SELECTIONS, "which residual modes are kept (m3)"),
            "method",
            among=("m3",),
        ),
        "snapshots",
    )
    flexibility_tolerance: float = only_with(
        number(
            2e-3,
            "largest verified error of the bore's displacement under pressure, 0: every nodal "
            "pressure is solved for (m4)",
            least=0,
            below=1,
        ),
        "method",
        among=("m4",),
    )
    solver: str = choice("auto", SOLVERS, "of the static responses, by size or as named")
    estimate_error: bool = flag(True, "also solve for the bore flexibility that the basis lacks")


def method_keys(method: str) -> tuple[str, ...]:
    """Keys of [reduction] that this method reads, of those that not all methods read."""
    conditions = (
        (field.name, condition)
        for field in attrs.fields(ReductionSettings)
        for condition in field.metadata.get("needs", ())
    )
    return tuple(
        name
        for name, condition in conditions
        if condition.keys == ("method",) and method in condition.among
    )


@attrs.frozen
class OutputSettings:
    """Files that a run writes in addition to history and summary, and its accuracy."""

    plots: bool = flag(True, "curves as pictures")
    error_budget: bool = flag(True, "whether the errors of the run's figures are estimated")
    error_limit: float = only_with(
        number(
            0.2,
            "largest estimated error of a peak pressure or thinnest film of a run that is "
            "complete; above it the run is untrustworthy",
            above=0,
            example="0.1 for 10 %",
        ),
        "error_budget",
        among=(True,),
    )
    part_mesh_error: bool = flag(
        True, "whether parts are meshed again, more finely, to estimate the errors of their meshes"
    )
    accuracy: float = number(
        0.0,
        "that estimated errors of peak pressures and thinnest films must meet: meshes, steps and "
        "modes are chosen for it, 0: as written",
        least=0,
        below=0.5,
        usual=(1e-3, 0.1),
        example="0.01 for 1 %",
    )
    accuracy_keeps: tuple[str, ...] = only_with(
        names(
            "keys that stay as written, of those that accuracy chooses: tolerance, joints.pin.cells"
        ),
        "accuracy",
    )
    paraview: bool = flag(False, "ParaView series of bodies and films")
    frames: int = only_with(count(60, "of the series", least=2), "paraview", among=(True,))
