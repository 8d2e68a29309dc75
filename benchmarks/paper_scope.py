"""What the paper ran: its numbers of modes, sections 4.2 and 5.2, and some more around them.

M1 and M2 get as many modes as M3 has vibration and residual modes together.
"""

from __future__ import annotations

from fenics_ehd.study.paper import (
    HOUSING_M3,
    REFERENCES,
    ROD_M3,
    ROD_MODES,
    ROD_RESIDUAL_MODES,
    ROTOR,
    SLIDER_CRANK,
)
from fenics_ehd.study.plan import (
    SELECTIONS,
    Scope,
    Variant,
    film,
    m1,
    m2,
    m3,
    m4,
    rigid,
    steps,
)


def _selections(pressure_set: str, modes: tuple[int, ...]) -> list[Variant]:
    return [m3(pressure_set, selection, n) for selection in SELECTIONS for n in modes]


#: The paper's M3 of either machine, and its reference.
ROD = m3(*ROD_M3, 31)
HOUSING = m3(*HOUSING_M3, 20)
ROD_REFERENCE = REFERENCES[SLIDER_CRANK]
HOUSING_REFERENCE = REFERENCES[ROTOR]

ROD_SCOPE = Scope(
    methods=(
        *map(m1, ROD_MODES),
        # Some more than four times as many as M3 needs for one per cent.
        *map(m2, (*ROD_MODES, 157, 247)),
        *_selections("pc1", (16, 31, 61, 121)),
        *_selections("pc2", ROD_RESIDUAL_MODES),
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
    stepped=(ROD, m4(6)),
    loose=(m1(37), m2(37)),
    films=(0.5, 1, 1.5, 2, 3),
    meshed=(ROD,),
    finest_steps=steps(1e-8),
    reference=ROD_REFERENCE.variant,
    reference_steps=ROD_REFERENCE.steps,
    step_check=ROD_REFERENCE.step_check,
    film_check=film(2) | steps(1e-5),
    basis_check=ROD_REFERENCE.basis_check,
)

HOUSING_SCOPE = Scope(
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
    stepped=(HOUSING, m4(10)),
    films=(0.5, 1, 1.5, 2),
    meshed=(HOUSING,),
    finest_steps=steps(1e-6),
    reference=HOUSING_REFERENCE.variant,
    reference_steps=HOUSING_REFERENCE.steps,
    step_check=HOUSING_REFERENCE.step_check,
    film_check=film(1.5) | steps(1e-5),
    basis_check=HOUSING_REFERENCE.basis_check,
)

#: By scene: what is run, and when errors begin to count [s]. Before, the film builds up.
SCOPES = {
    SLIDER_CRANK: (ROD_SCOPE, ROD_REFERENCE.start),
    ROTOR: (HOUSING_SCOPE, HOUSING_REFERENCE.start),
}
