"""What a study runs: methods and numbers of modes, tolerances, film meshes, the reference.

Numbers of modes are those of the paper, sections 4.2 and 5.2, and some more: M1 and M2 get as
many modes as M3 has vibration and residual modes together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fenics_ehd.study.variants import Variant, film, full, m1, m2, m3, m4, rigid, steps

#: Of residual modes, in the sense of (31)-(32): the most flexible, the slowest, to the letter.
SELECTIONS = ("largest-eigenvalue", "lowest-frequency", "smallest-eigenvalue")


@dataclass(frozen=True)
class Scope:
    """What a study runs.

    Attributes
    ----------
    start
        Time from which on errors count [s]: before, the film builds up from no pressure at all.
    methods
        Judged as the scene integrates them.
    tolerances, stepped
        Step tolerances, and what is run with each of them.
    meshes, meshed
        Cells of the film, finest last, and what is run with each of them.
    finest_steps
        Against which runs at the tolerances are measured: the same body, its steps very fine.
    reference, reference_steps
        What all are measured against, the full interface, and its steps.
    step_check, film_check
        Settings that replace those of the reference for its own step and film error. A film mesh
        that is not finer than the scene's is replaced by one that is.
        Without a `step_check` the other steps of `basis_check` show the sum of both errors.
    basis_check
        The reference's part with another basis, and its settings.
    loose
        What else is run with the first of the tolerances: errors as large as those of these methods
        need no finer steps.
    settings
        Replace those of the scene.
    """

    start: float
    methods: tuple[Variant, ...]
    tolerances: tuple[float, ...]
    stepped: tuple[Variant, ...]
    meshes: tuple[tuple[int, int], ...]
    meshed: tuple[Variant, ...]
    finest_steps: Mapping[str, Any]
    reference: Variant
    reference_steps: Mapping[str, Any]
    step_check: Mapping[str, Any] | None
    film_check: Mapping[str, Any]
    basis_check: tuple[Variant, Mapping[str, Any]]
    loose: tuple[Variant, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


def _selections(pressure_set: str, modes: tuple[int, ...]) -> list[Variant]:
    return [m3(pressure_set, selection, n) for selection in SELECTIONS for n in modes]


#: The default of the slider-crank, and what it is run beside.
_ROD = m3("pc2", "lowest-frequency", 31)

SLIDER_CRANK = Scope(
    start=2e-4,
    methods=(
        *map(m1, (22, 37, 67, 127)),
        # Some more than four times as many as M3 needs for one per cent.
        *map(m2, (22, 37, 67, 127, 157, 247)),
        *_selections("pc1", (16, 31, 61, 121)),
        *_selections("pc2", (16, 31, 61, 80)),
        m3("pc2-long", "every-column", 40),
        m3("pc2-short", "every-column", 40),
        m3("journal", "largest-eigenvalue", 16),
        m3("journal", "largest-eigenvalue", 31),
        m4(6, 1e-2),
        m4(6, 1e-3),
        m4(6),
        m4(2),
        m4(20),
        rigid(),
    ),
    tolerances=(1e-3, 1e-4, 1e-5, 1e-6, 1e-7),
    stepped=(_ROD, m4(6)),
    loose=(m1(37), m2(37)),
    meshes=((10, 3), (20, 5), (30, 7), (40, 10), (60, 15)),
    meshed=(_ROD,),
    finest_steps=steps(1e-8, 3),
    reference=full(20),
    reference_steps=steps(1e-7, 3),
    step_check=steps(1e-6, 2),
    film_check=film(40, 10) | steps(1e-5, 3),
    basis_check=(full(6), steps(1e-6, 3)),
)

QUICK_SLIDER_CRANK = Scope(
    start=2e-4,
    methods=(
        m1(37),
        m1(67),
        m2(37),
        m2(67),
        m3("pc1", "largest-eigenvalue", 31),
        m3("pc2", "largest-eigenvalue", 31),
        m3("pc2", "lowest-frequency", 16),
        _ROD,
        m3("pc2", "smallest-eigenvalue", 31),
        m4(6, 1e-2),
        m4(6),
    ),
    tolerances=(1e-3, 1e-4, 1e-5),
    stepped=(_ROD, m4(6)),
    meshes=((10, 3), (20, 5), (30, 7)),
    meshed=(_ROD,),
    finest_steps=steps(1e-7, 3),
    reference=full(20),
    reference_steps=steps(1e-7, 3),
    step_check=None,
    film_check=film(30, 7) | steps(1e-4, 3),
    basis_check=(full(6), steps(1e-6, 3)),
)

#: The default of the rotor.
_HOUSING = m3("pc1", "largest-eigenvalue", 20)

#: A tenth of a revolution [s]: the force is there at once and the film is not.
_ROTOR_START = 1.05e-3

ROTOR = Scope(
    start=_ROTOR_START,
    methods=(
        *map(m1, (30, 50, 90)),
        *map(m2, (30, 50, 90)),
        *_selections("pc1", (20, 40, 80)),
        *_selections("pc2", (20, 40, 80)),
        m4(10, 1e-2),
        m4(10),
        m4(20),
        rigid(),
    ),
    tolerances=(1e-3, 1e-4, 1e-5),
    stepped=(_HOUSING, m4(10)),
    meshes=((10, 3), (20, 5), (30, 7), (40, 10)),
    meshed=(_HOUSING,),
    finest_steps=steps(1e-6),
    reference=full(20),
    reference_steps=steps(1e-6),
    # Errors fall as tolerance^(2/3): what these steps differ by is the error of the reference's.
    step_check=steps(3e-6),
    film_check=film(30, 7) | steps(1e-5),
    basis_check=(full(10), steps(1e-6)),
)

#: The force grows over half a revolution: the shaft hardly nods, and few steps are enough.
QUICK_ROTOR = Scope(
    start=_ROTOR_START,
    settings={"force.ramp": 0.5},
    methods=(
        *map(m1, (30, 50)),
        *map(m2, (30, 50)),
        _HOUSING,
        m3("pc1", "largest-eigenvalue", 40),
        m3("pc1", "lowest-frequency", 20),
        m3("pc2", "largest-eigenvalue", 20),
        m4(10),
    ),
    tolerances=(1e-3, 1e-4, 1e-5),
    stepped=(_HOUSING, m4(10)),
    meshes=((10, 3), (20, 5), (24, 6)),
    meshed=(_HOUSING,),
    finest_steps=steps(1e-6),
    reference=full(20),
    reference_steps=steps(1e-6),
    step_check=None,
    film_check=film(24, 6) | steps(1e-4),
    basis_check=(full(10), steps(3e-6)),
)

#: By scene and whether it is a quick one.
SCOPES = {
    ("slider-crank", False): SLIDER_CRANK,
    ("slider-crank", True): QUICK_SLIDER_CRANK,
    ("rotor", False): ROTOR,
    ("rotor", True): QUICK_ROTOR,
}
