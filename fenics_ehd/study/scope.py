"""What a study runs: methods and numbers of modes, tolerances, film meshes, the reference.

Numbers of modes are about those of Krinner and Rixen, sections 4.2 and 5.2, for their machines, and
some more: M1 and M2 get as many modes as M3 has vibration and residual modes together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fenics_ehd.scenes.scene import Scene, meshed
from fenics_ehd.study.variants import Variant, film, full, m1, m2, m3, m4, rigid, steps

#: Of residual modes, in the sense of (31)-(32): the most flexible, the slowest, to the letter.
SELECTIONS = ("largest-eigenvalue", "lowest-frequency", "smallest-eigenvalue")

#: Numbers of residual modes, as many times the scene's own.
SIZES = (0.5, 1, 2, 4)


@dataclass(frozen=True)
class Scope:
    """What a study runs.

    Attributes
    ----------
    methods
        Judged as the scene integrates them.
    tolerances, stepped
        Step tolerances, and what is run with each of them.
    films, meshed
        Factors on the cells of every film, finest last, and what is run with each of them.
    finest_steps
        Against which runs at the tolerances are measured: the same bodies, their steps very fine.
    reference, reference_steps
        What all are measured against, the full interface, and its steps.
    step_check, film_check
        Settings that replace those of the reference for its own step and film error.
        Without a `step_check` the other steps of `basis_check` show the sum of both errors.
    basis_check
        The reference's parts with another basis, and its settings.
    loose
        What else is run with the first of the tolerances: errors as large as those of these methods
        need no finer steps.
    settings
        Replace those of the scene.
    """

    methods: tuple[Variant, ...]
    tolerances: tuple[float, ...]
    stepped: tuple[Variant, ...]
    films: tuple[float, ...]
    meshed: tuple[Variant, ...]
    finest_steps: Mapping[str, Any]
    reference: Variant
    reference_steps: Mapping[str, Any]
    step_check: Mapping[str, Any] | None
    film_check: Mapping[str, Any]
    basis_check: tuple[Variant, Mapping[str, Any]]
    loose: tuple[Variant, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


def usual_scope(scene: Scene, *, quick: bool) -> Scope:
    """The scope of any scene: its own number of vibration modes, its own M3, its tolerance.

    With several parts these are those of the first one.
    """
    reduction = scene.bodies[meshed(scene)[0]].reduction
    n = reduction.vibration_modes
    selection = reduction.selection if reduction.selection in SELECTIONS else SELECTIONS[1]
    usual = m3(reduction.pressure_set, selection, reduction.residual_modes)

    def size(factor: float) -> int:
        return 1 + round(factor * (reduction.residual_modes - 1))

    def times(factor: float) -> float:
        return float(f"{factor * scene.time.tolerance:.6g}")

    shared: dict[str, Any] = {
        "stepped": (usual, m4(n)),
        "meshed": (usual,),
        "reference": full(max(20, n + 10)),
        "reference_steps": steps(times(0.01)),
        "basis_check": (full(n), steps(times(0.1))),
    }
    if quick:
        return Scope(
            methods=(
                *(method(n + size(factor)) for method in (m1, m2) for factor in (1, 2)),
                m3("pc1", "largest-eigenvalue", size(1)),
                m3("pc2", "largest-eigenvalue", size(1)),
                m3("pc2", "smallest-eigenvalue", size(1)),
                m3("pc2", "lowest-frequency", size(0.5)),
                usual,
                m4(n, 1e-2),
                m4(n),
            ),
            tolerances=tuple(map(times, (30, 10, 1))),
            films=(0.5, 1, 1.5),
            finest_steps=steps(times(0.01)),
            step_check=None,
            film_check=film(1.5) | steps(times(10)),
            **shared,
        )
    return Scope(
        methods=(
            *(m1(n + size(factor)) for factor in SIZES),
            # Some more than four times as many as M3 needs for one per cent.
            *(m2(n + size(factor)) for factor in (*SIZES, 5, 8)),
            *(m3("pc1", way, size(factor)) for way in SELECTIONS for factor in SIZES),
            *(m3("pc2", way, size(factor)) for way in SELECTIONS for factor in SIZES[:-1]),
            m3("journal", "largest-eigenvalue", size(0.5)),
            m3("journal", "largest-eigenvalue", size(1)),
            usual,
            m4(n, 1e-2),
            m4(n, 1e-3),
            m4(n),
            m4(2),
            m4(20),
            rigid(),
        ),
        tolerances=tuple(map(times, (30, 10, 1, 0.1, 0.01))),
        loose=(m1(n + size(1)), m2(n + size(1))),
        films=(0.5, 1, 1.5, 2, 3),
        finest_steps=steps(times(0.001)),
        step_check=steps(times(0.1)),
        film_check=film(2) | steps(times(1)),
        **shared,
    )
