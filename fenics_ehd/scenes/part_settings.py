"""Settings of the reduction of a part, and settings of the output of a run.

``--help`` imports this module, which therefore imports nothing that is slow.
"""

from __future__ import annotations

import attrs

from fenics_ehd.base.described import Described
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
    """Reduction of an elastic part to modes."""

    method: str = choice("m4", METHODS, "reduction method, rigid: no elasticity")
    modes: int = only_with(
        count(37, "number of fixed-boundary modes (m1, m2)", least=1), "method", among=("m1", "m2")
    )
    interior_modes: int = only_with(
        count(20, "number of fixed-interface modes in the first step (m2)"),
        "method",
        among=("m2",),
    )
    vibration_modes: int = only_with(
        count(6, "number of free-floating vibration modes n_v (m3, m4, full)"),
        "method",
        among=("m3", "m4", "full"),
    )
    residual_modes: int = only_with(
        count(31, "number of residual modes n_r (m3)"), "method", among=("m3",)
    )
    pressure_set: str = not_with(
        only_with(
            choice(
                "pc2",
                PRESSURE_SETS,
                "pressures for residual modes: pc1 unit pressures (34), others shapes (35) (m3)",
            ),
            "method",
            among=("m3",),
        ),
        "snapshots",
    )
    snapshots: str = only_with(
        text(
            NONE,
            "folder of a former run; its main pressure patterns replace pressure_set and "
            "selection (m3)",
        ),
        "method",
        among=("m3",),
    )
    selection: str = not_with(
        only_with(
            choice("lowest-frequency", SELECTIONS, "criterion for the residual modes kept (m3)"),
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
    solver: str = choice("auto", SOLVERS, "solver for static responses, auto: chosen by size")
    estimate_error: bool = flag(
        True, "whether the part of the bore flexibility that the basis lacks is also computed"
    )


def method_keys(method: str) -> tuple[str, ...]:
    """Keys of ``[reduction]`` that this method reads, but that some other method ignores."""
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
class OutputSettings(Described):
    """Output of a run: files besides history and summary, error estimates, required accuracy."""

    plots: bool = flag(True, "whether curves are drawn as pictures")
    error_budget: bool = flag(True, "whether errors of the results are estimated")
    error_limit: float = only_with(
        number(
            0.2,
            "largest allowed relative error of a peak pressure or thinnest film; a run with a "
            "larger estimate has the status untrustworthy",
            above=0,
            example="0.1 for 10 %",
        ),
        "error_budget",
        among=(True,),
    )
    part_mesh_error: bool = flag(
        True, "whether parts are also meshed more finely, to estimate the errors of their meshes"
    )
    accuracy: float = number(
        0.0,
        "required relative error of peak pressures and thinnest films: meshes, steps and modes are "
        "chosen to meet it; 0: used as written",
        least=0,
        below=0.5,
        usual=(1e-3, 0.1),
        example="0.01 for 1 %",
    )
    accuracy_keeps: tuple[str, ...] = only_with(
        names(
            "keys that accuracy would choose, but that are kept as written: tolerance, "
            "joints.pin.cells"
        ),
        "accuracy",
    )
    paraview: bool = flag(False, "whether a ParaView series of bodies and films is written")
    frames: int = only_with(
        count(60, "number of instants in the ParaView series", least=2), "paraview", among=(True,)
    )
