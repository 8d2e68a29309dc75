"""M3: load-dependent dual basis, (26)-(35)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.errors import SettingsError, VerificationError
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.distributed import inner, load_columns, multiply, symmetric
from fenics_ehd.reduction.pressure_sets import PRESSURE_SETS
from fenics_ehd.reduction.projection import bore_flexibility, project
from fenics_ehd.reduction.residual_modes import SELECTIONS, energy_orthonormal
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure
from fenics_ehd.reduction.vibration_modes import vibration_modes

#: Largest defect of the reduced matrices from their block-diagonal form, relative.
DIAGONAL_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class LoadDependentBasis:
    """The part-size columns T of M3 with their reduced matrices, rows owned by this rank."""

    columns: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray
    frequencies: np.ndarray
    kinds: tuple[str, ...]
    accuracy: dict[str, float]


def load_dependent(
    structure: Structure,
    n_vibration: int,
    n_residual: int,
    pressure_set: str = "pc2",
    selection: str = "lowest-frequency",
    *,
    attachment_directions: tuple[int, ...] = (0, 1),
    estimate_error: bool = True,
    options_prefix: str = "",
) -> tuple[ReducedBody, LoadDependentBasis]:
    """Reduce a part with vibration, attachment and load-dependent residual modes.

    Parameters
    ----------
    structure
        The part, free or clamped.
    n_vibration
        Vibration modes ``n_v`` (27).
    n_residual
        Residual modes ``n_r`` kept of the pressure set (32).
    pressure_set
        ``"pc1"`` (34) or ``"pc2"`` (35).
    selection
        Which residual modes: see `SELECTIONS`.
    attachment_directions
        Components of the unit forces at every boundary point: ``n_a`` is their
        number times the number of points.
    estimate_error
        Also compute the bore flexibility that the basis misses, one static
        solve per pressure node.
    options_prefix
        Put before the prefixes ``static_`` and ``modes_`` of the PETSc options.

    Returns
    -------
    body : ReducedBody
        Frame at the mean axis; vibration coordinates first, then the static
        ones by frequency.
    basis : LoadDependentBasis
        Part-size columns, for displacement fields.

    Raises
    ------
    SettingsError
        An unknown set or selection, or more residual modes than the set has columns.
    """
    _check(structure, n_vibration, n_residual, pressure_set, selection)
    solver = StaticSolver(structure, options_prefix=f"{options_prefix}static_")
    prefix = f"{options_prefix}modes_"
    basis = _basis(
        solver, n_vibration, n_residual, pressure_set, selection, attachment_directions, prefix
    )
    body = project(
        structure,
        basis.columns,
        basis.stiffness,
        basis.mass,
        basis.frequencies,
        basis.kinds,
        method="m3",
        frame="mean-axis" if solver.rigid_modes.shape[1] else "clamped",
        full_flexibility=bore_flexibility(solver) if estimate_error else None,
        accuracy=basis.accuracy,
        provenance={
            "degrees_of_freedom": str(structure.size),
        },
    )
    return body, basis


def _check(
    structure: Structure, n_vibration: int, n_residual: int, pressure_set: str, selection: str
) -> None:
    for name, value, known in (
        ("pressure_set", pressure_set, PRESSURE_SETS),
        ("selection", selection, SELECTIONS),
    ):
        if value not in known:
            raise SettingsError(f"{name} {value!r} is not one of {', '.join(known)}")
    available = PRESSURE_SETS[pressure_set](structure.lubricated_bore).shape[1]
    if not 0 <= n_residual <= available:
        raise SettingsError(
            f"residual_modes {n_residual} is not between 0 and {available}, "
            f"the size of pressure set {pressure_set}"
        )
    if not 0 <= n_vibration <= structure.size // 4:
        raise SettingsError(
            f"vibration_modes {n_vibration} is not between 0 and {structure.size // 4}, "
            "a quarter of the degrees of freedom"
        )


def _basis(
    solver: StaticSolver,
    n_vibration: int,
    n_residual: int,
    pressure_set: str,
    selection: str,
    directions: tuple[int, ...],
    modes_prefix: str,
) -> LoadDependentBasis:
    structure = solver.structure
    omega, modes = vibration_modes(solver, n_vibration, options_prefix=modes_prefix)
    attachment_loads = np.column_stack(
        [vectors[d].array for vectors in structure.attachments.values() for d in directions]
        or [np.zeros((structure.stiffness.local_size[0], 0))]
    )
    bore = structure.lubricated_bore
    pressure_loads = load_columns(bore.load, PRESSURE_SETS[pressure_set](bore))
    loads = np.hstack([attachment_loads, pressure_loads])
    responses = _filtered_responses(solver, omega, modes, loads)

    n_attachment = attachment_loads.shape[1]
    comm = structure.comm
    mass_responses = multiply(structure.mass, responses)
    # K G is the equilibrated load less its modal part, and G is orthogonal to both, so G^T K G
    # needs the load alone.
    stiffness = symmetric(inner(responses, loads, comm))
    mass = symmetric(inner(responses, mass_responses, comm))
    candidates = slice(n_attachment, None)
    kept = SELECTIONS[selection](stiffness[candidates, candidates], mass[candidates, candidates])
    kept = kept[:, :n_residual]
    combination = np.zeros((len(stiffness), n_attachment + kept.shape[1]))
    combination[:n_attachment, :n_attachment] = np.eye(n_attachment)
    combination[n_attachment:, n_attachment:] = kept

    orthonormal = energy_orthonormal(combination.T @ stiffness @ combination)
    combination = combination @ orthonormal
    values, vectors = np.linalg.eigh(combination.T @ mass @ combination)
    # Ascending frequency is descending modal mass per unit strain energy.
    values, vectors = values[::-1], vectors[:, ::-1]
    combination = combination @ vectors / np.sqrt(values)
    columns = np.hstack([modes, responses @ combination])
    angular = np.concatenate([omega, 1.0 / np.sqrt(values)])
    rank = combination.shape[1]
    accuracy = {
        "static_candidates": float(len(stiffness)),
        "static_requested": float(n_attachment + n_residual),
        "static_rank": float(rank),
        "static_dropped": float(n_attachment + n_residual - rank),
    }
    return _verified(solver, columns, angular, n_vibration, accuracy)


def _filtered_responses(
    solver: StaticSolver, omega: np.ndarray, modes: np.ndarray, loads: np.ndarray
) -> np.ndarray:
    """Static responses (29) less what the vibration modes already cover (30)."""
    covered = inner(modes, loads, solver.structure.comm)
    return solver.solve(loads) - (modes / omega**2) @ covered


def _verified(
    solver: StaticSolver,
    columns: np.ndarray,
    angular: np.ndarray,
    n_vibration: int,
    accuracy: dict[str, float],
) -> LoadDependentBasis:
    """Reduced matrices from the columns themselves, checked against their diagonal form."""
    structure = solver.structure
    comm = structure.comm
    mass = symmetric(inner(columns, multiply(structure.mass, columns), comm))
    stiffness = symmetric(inner(columns, multiply(structure.stiffness, columns), comm))
    scaled = stiffness / np.outer(angular, angular)
    defects = {
        "mass_defect": np.abs(mass - np.eye(len(mass))).max(initial=0.0),
        "stiffness_defect": np.abs(scaled - np.eye(len(mass))).max(initial=0.0),
        "rigid_motion": np.abs(
            inner(multiply(structure.mass, solver.rigid_modes), columns, comm)
        ).max(initial=0.0),
    }
    for name, value in defects.items():
        if not value <= DIAGONAL_TOLERANCE:
            raise VerificationError(
                f"the reduced basis fails its check: {name} {value:.1e} "
                f"above {DIAGONAL_TOLERANCE:.0e}"
            )
    kinds = ("vibration",) * n_vibration + ("static",) * (len(angular) - n_vibration)
    return LoadDependentBasis(
        columns=columns,
        stiffness=np.diag(angular**2),
        mass=np.eye(len(angular)),
        frequencies=angular / (2 * np.pi),
        kinds=kinds,
        accuracy=accuracy | {name: float(value) for name, value in defects.items()},
    )
