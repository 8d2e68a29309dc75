"""Settings of an elastic part's reduction, and what to choose from."""

from __future__ import annotations

import attrs

from fenics_ehd.base.fields import choice, count, flag, number, text

ELEMENTS = ("serendipity", "lagrange")
FILM_ELEMENTS = ("lagrange", "serendipity", "bilinear")
METHODS = ("m1", "m2", "m3", "m4", "full", "rigid")
SOLVERS = ("auto", "direct", "iterative")
TRANSFERS = ("conservative", "mortar")
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
        "none",
        "folder of a former run: the main patterns of its pressures are kept, whatever "
        "pressure_set and selection say, or none (m3)",
    )
    selection: str = choice("lowest-frequency", SELECTIONS, "which residual modes are kept (m3)")
    residual_truncation: float = number(
        1e-4, "relative displacement of dropped residual patterns (m4)", least=0, below=1
    )
    solver: str = choice("auto", SOLVERS, "of the static responses, by size or as named")
    estimate_error: bool = flag(True, "also solve for the bore flexibility the basis misses")
