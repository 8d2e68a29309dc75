"""What the reductions of one part have in common, each of it computed once.

The smallest reduction is here too: a part taken as rigid, its inertia and bores without elastic
coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import cached_property
from typing import Any, TypedDict, TypeVar, Unpack

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction.body import ReducedBody, ResidualFlexibility
from fenics_ehd.reduction.checks import check_structure
from fenics_ehd.reduction.eigenmodes import LowestModes
from fenics_ehd.reduction.loads import bore_flexibility
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.projection import Basis, BoreFlexibility, project
from fenics_ehd.reduction.rigid_body import rigid_body_modes
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure

T = TypeVar("T")


class Options(TypedDict, total=False):
    """How a `Reductor` is made of a structure."""

    attachment_directions: tuple[int, ...]
    solver: str
    options_prefix: str


class Reductor:
    """A part with what its reductions share: give it to any of them in place of the structure.

        part = Reductor(structure)
        bodies = [craig_bampton(part, 37), load_dependent(part, 6, 31), full_interface(part)]

    Nothing is computed before a reduction asks for it, nothing twice: factors of the stiffness
    matrix, and of its interior for M2; the flexibility of the bore; modes, of which a smaller
    number is cut from a larger one (ask for the largest first); the first step of M2; the basis
    of M4. Of static responses to pressure sets, as tall as the part, those asked for last are
    kept: reductions with the same set in turn share them.

    Parameters
    ----------
    structure
        The part, free or clamped.
    attachment_directions
        Components of the unit forces at every boundary point, and of its boundary dofs in M1
        and M2.
    solver
        ``"direct"``, ``"iterative"`` or ``"auto"``, by size.
    options_prefix
        Put before the prefixes ``static_``, ``modes_`` and ``interior_`` of the PETSc options.

    Raises
    ------
    StructureError
        From `check_structure`.
    """

    def __init__(
        self,
        structure: Structure,
        *,
        attachment_directions: tuple[int, ...] = (0, 1),
        solver: str = "auto",
        options_prefix: str = "",
    ):
        check_structure(structure)
        self.structure, self.solver, self.options_prefix = structure, solver, options_prefix
        self._directions = attachment_directions
        self._kept: dict[str, tuple[Hashable, Any]] = {}

    @staticmethod
    def of(part: Structure | Reductor, **options: Unpack[Options]) -> Reductor:
        """The given one, or one of a structure.

        Raises
        ------
        SettingsError
            Options that the given one was not made with.
        """
        if isinstance(part, Structure):
            return Reductor(part, **options)
        if options:
            raise SettingsError(f"{', '.join(options)}: say so where the Reductor is made")
        return part

    @cached_property
    def mass(self) -> MassOperator:
        """Products with M."""
        return MassOperator(self.structure.mass)

    @cached_property
    def free(self) -> bool:
        """Whether nothing clamps the part."""
        return rigid_body_modes(self.structure).shape[1] > 0

    @cached_property
    def static(self) -> StaticSolver:
        """Static responses, from one factorisation."""
        prefix = f"{self.options_prefix}static_"
        return StaticSolver(
            self.structure, mass=self.mass, solver=self.solver, options_prefix=prefix
        )

    @cached_property
    def vibration(self) -> LowestModes:
        """Vibration modes, free-floating or clamped."""
        return LowestModes(self.static, f"{self.options_prefix}modes_")

    @cached_property
    def points(self) -> np.ndarray:
        """Unit forces ``J_a`` at the boundary points, owned rows (owned dofs, n_a)."""
        points = self.structure.attachments.values()
        vectors = [point[d].array for point in points for d in self._directions]
        return np.column_stack(vectors or [np.zeros((self.structure.stiffness.local_size[0], 0))])

    @cached_property
    def flexibility(self) -> BoreFlexibility:
        """Static response of the whole part's bore to every nodal pressure."""
        return bore_flexibility(self.static)

    def once(self, name: str, key: Hashable, make: Callable[[], T]) -> T:
        """What `make` gives for a key; the last one of each name is kept."""
        if name not in self._kept or self._kept[name][0] != key:
            self._kept.pop(name, None)
            self._kept[name] = key, make()
        return self._kept[name][1]

    def project(
        self,
        basis: Basis,
        method: str,
        *,
        frame: str = "mean-axis",
        residual: ResidualFlexibility | None = None,
        estimate_error: bool = True,
        keep_basis: bool = False,
    ) -> ReducedBody:
        """Reduced body of a basis; parameters as in `ReducedBody` and `load_dependent`."""
        return project(
            self.structure,
            self.mass,
            basis,
            method=method,
            frame=frame if self.free else "clamped",
            residual=residual,
            full_flexibility=self.flexibility if estimate_error else None,
            keep_basis=keep_basis,
        )


# Without modes


def rigid(
    part: Structure | Reductor,
    *,
    estimate_error: bool = False,
    keep_basis: bool = False,
    **options: Unpack[Options],
) -> ReducedBody:
    """Body without elastic coordinates; nothing is factorised unless the error is asked for.

    Parameters
    ----------
    part
        The part, free or clamped, or a `Reductor` of it.
    estimate_error
        Also compute the bore flexibility that is left out, one static solve per
        pressure node.
    keep_basis
        Leave the basis of no columns in the body.
    options
        As in `load_dependent`.
    """
    reductor = Reductor.of(part, **options)
    nothing = np.zeros((0, 0))
    columns = np.zeros((reductor.structure.stiffness.local_size[0], 0))
    return reductor.project(
        Basis(columns, nothing, nothing, (), (), {}),
        "rigid",
        estimate_error=estimate_error,
        keep_basis=keep_basis,
    )
