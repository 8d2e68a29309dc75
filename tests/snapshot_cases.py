"""M3 with patterns trained on snapshots, under a name in addition to those of the selections."""

import fenics_ehd as ehd
from fenics_ehd.reduction import SELECTIONS
from fenics_ehd.reduction.load_dependent_basis import pressure_patterns, proper_orthogonal

PROPER_ORTHOGONAL = "proper-orthogonal"
WAYS = (*SELECTIONS, PROPER_ORTHOGONAL)


def reduce_by(part, n_vibration, n_residual, pressures="pc2", way="lowest-frequency", **options):
    """`load_dependent`, its pressures' main patterns all kept where that is the way."""
    if way == PROPER_ORTHOGONAL:
        structure = getattr(part, "structure", part)
        patterns = proper_orthogonal(pressure_patterns(structure, pressures), n_residual)
        pressures, n_residual, way = patterns, patterns.shape[1], "every-column"
    return ehd.load_dependent(part, n_vibration, n_residual, pressures, way, **options)
