"""Settings of an elastic part's reduction, what to choose from, output.

Read by ``--help``: nothing else is imported.
"""

from __future__ import annotations

import attrs

from fenics_ehd.base.fields import NONE, choice, count, flag, names, number, text

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
    modes: int = count(37, "fixed-boundary modes (m1, m2)", least=1)
    interior_modes: int = count(20, "fixed-interface modes of the first step (m2)")
    vibration_modes: int = count(6, "free-floating vibration modes n_v (m3, m4, full)")
    residual_modes: int = count(31, "residual modes n_r (m3)")
    pressure_set: str = choice("pc2", PRESSURE_SETS, "unit pressures (34), shapes (35) (m3)")
    snapshots: str = text(
        NONE,
        "folder of a former run: the main patterns of its pressures are kept, whatever "
        "pressure_set and selection say, or none (m3)",
    )
    selection: str = choice("lowest-frequency", SELECTIONS, "which residual modes are kept (m3)")
    residual_truncation: float = number(
        1e-4, "relative displacement of dropped residual patterns (m4)", least=0, below=1
    )
    solver: str = choice("auto", SOLVERS, "of the static responses, by size or as named")
    estimate_error: bool = flag(True, "also solve for the bore flexibility the basis misses")


@attrs.frozen
class OutputSettings:
    """Files that a run writes beside history and summary."""

    plots: bool = flag(True, "curves as pictures")
    error_budget: bool = flag(True, "whether the run says what its figures are worth")
    error_limit: float = number(
        0.2,
        "largest estimated error of a peak pressure or thinnest film of a run that is complete; "
        "above it the run is untrustworthy",
        above=0,
        example="0.1 for 10 %",
    )
    part_mesh_error: bool = flag(
        True, "whether parts are meshed again, more finely, to know what their meshes are worth"
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
    accuracy_keeps: tuple[str, ...] = names(
        "keys that stay as written, of those that accuracy chooses: tolerance, joints.pin.cells"
    )
    paraview: bool = flag(False, "ParaView series of bodies and films")
    frames: int = count(60, "of the series", least=2)
