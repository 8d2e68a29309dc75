"""Plan of a study: variants of a scene, and the run that each of them is compared with.

A variant has a name, and settings that differ from those of the scene. The scope of a study lists
its variants and the reference. Variants differ in the method and the number of modes, in the step
tolerance, or in the film mesh.

Numbers of modes are close to those of Krinner and Rixen, sections 4.2 and 5.2; some numbers are
added. Variants of M1 and M2 have as many modes as variants of M3 have vibration and residual modes
together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.needs import NONE
from fenics_ehd.scenes.films import planned_cells
from fenics_ehd.scenes.part_settings import ReductionSettings
from fenics_ehd.scenes.scene import Scene, as_stored, meshed
from fenics_ehd.scenes.schema import FEWEST_CELLS
from fenics_ehd.study.cases import Case, make_case, with_values

#: Key of the film meshes in a variant; its value is a factor on the scene's numbers of cells.
FILM = "film"

#: Default tolerance of M4.
M4_TOLERANCE = ReductionSettings().flexibility_tolerance


@dataclass(frozen=True)
class Variant:
    """Variant of a scene: its name, which is also a file name, and its changed settings.

    `values` has the changed settings by key. A key is a full key, ``reduction.KEY`` for all parts
    of the scene, or `FILM` for the film meshes of all joints.
    """

    name: str
    values: Mapping[str, Any]

    def but(self, suffix: str, values: Mapping[str, Any]) -> Variant:
        """Copy of the variant with further settings, and with a suffix after its name."""
        return Variant(f"{self.name}-{suffix}", {**self.values, **values})


def m1(modes: int) -> Variant:
    """Variant with method M1, Craig-Bampton; `modes` is the number of fixed-boundary modes."""
    return _reduction(f"m1-{modes}", method="m1", modes=modes)


def m2(modes: int) -> Variant:
    """Variant with method M2, two Craig-Bampton steps; `modes` remain after the second step."""
    return _reduction(f"m2-{modes}", method="m2", modes=modes)


def m3(pressure_set: str, selection: str, modes: int) -> Variant:
    """Variant with method M3, load-dependent reduction; `modes` is the number of residual modes."""
    return _reduction(
        f"m3-{pressure_set}-{selection}-{modes}",
        method="m3",
        pressure_set=pressure_set,
        snapshots=NONE,
        selection=selection,
        residual_modes=modes,
    )


def m4(vibration_modes: int, tolerance: float = M4_TOLERANCE) -> Variant:
    """Variant with method M4, residual flexibility; `tolerance` limits its relative error.

    With a tolerance of 0, the flexibility includes the response to every nodal pressure.
    """
    return _reduction(
        f"m4-{vibration_modes}-{tolerance:.0e}",
        method="m4",
        vibration_modes=vibration_modes,
        flexibility_tolerance=tolerance,
    )


def full(vibration_modes: int) -> Variant:
    """Variant with the full interface: a static mode for the pressure at each bore node, (34)."""
    return _reduction(f"full-{vibration_modes}", method="full", vibration_modes=vibration_modes)


def rigid() -> Variant:
    """Variant without elasticity."""
    return _reduction("rigid", method="rigid")


def _reduction(name: str, **values: Any) -> Variant:
    return Variant(name, {f"reduction.{key}": value for key, value in values.items()})


def steps(tolerance: float) -> dict[str, Any]:
    """Settings of a variant with a step tolerance."""
    return {"time.tolerance": tolerance}


def film(factor: float) -> dict[str, Any]:
    """Settings of a variant with film meshes refined by a factor in both directions."""
    return {FILM: factor}


def values_in(scene: Scene, values: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a variant by full key of a scene, from `values` as in `Variant`."""
    by_key: dict[str, Any] = {}
    for key, value in values.items():
        if key.startswith("reduction."):
            by_key |= {f"bodies.{name}.{key}": value for name in meshed(scene)}
        elif key == FILM:
            joints = tuple(scene.films)
            by_key |= {f"joints.{joint}.cells": _times(scene, joint, value) for joint in joints}
        else:
            by_key[key] = value
    return by_key


def _times(scene: Scene, joint: str, factor: float) -> list[int]:
    """Numbers of film cells around and along a joint: those of the scene, times a factor."""
    if factor == 1.0:
        return list(scene.joints[joint].cells)
    scene_cells = planned_cells(scene, joint)
    return [
        max(int(factor * cells + 0.5), least)
        for cells, least in zip(scene_cells, FEWEST_CELLS, strict=True)
    ]


#: Selections of residual modes, see (31)-(32): most flexible, slowest, and as printed in the paper.
SELECTIONS = ("largest-eigenvalue", "lowest-frequency", "smallest-eigenvalue")

#: Numbers of residual modes in a study, over the scene's number.
SIZES = (0.5, 1, 2, 4)


@dataclass(frozen=True)
class Scope:
    """Variants of a study, and its reference.

    Attributes
    ----------
    methods
        Variants of the reduction, with the time steps of the scene.
    tolerances, stepped
        Step tolerances, and the variants that are run with each of them.
    films, meshed
        Factors on the film cells, finest last, and the variants that are run with each of them.
    finest_steps
        Settings for very fine steps, with which `stepped` variants are run to show step errors.
    reference, reference_steps
        Variant of the reference, which has the full interface, and settings of its steps.
    step_check, film_check
        Settings with which the reference is run again, to show its own step error and film mesh
        error. If `step_check` is None, the run of `basis_check` shows the sum of step and basis
        error. If `film_check` is None, the film mesh error is not computed.
    basis_check
        Variant whose parts have another basis than those of the reference, and settings of its run.
        It shows the basis error of the reference.
    loose
        Further variants, which are run only with the first of the tolerances, because their errors
        are too large to need finer steps.
    settings
        Settings that replace those of the scene in all runs.
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
    film_check: Mapping[str, Any] | None
    basis_check: tuple[Variant, Mapping[str, Any]]
    loose: tuple[Variant, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


def usual_scope(scene: Scene, *, quick: bool) -> Scope:
    """Scope of a study of any scene.

    It depends on the scene's number of vibration modes, its settings of M3 and its step tolerance.
    If the scene has several parts, the settings of the first part are used.
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
                m4(n, 0.0),
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
            # The largest number is more than four times that with which M3 has an error of one per
            # cent.
            *(m2(n + size(factor)) for factor in (*SIZES, 5, 8)),
            *(m3("pc1", way, size(factor)) for way in SELECTIONS for factor in SIZES),
            *(m3("pc2", way, size(factor)) for way in SELECTIONS for factor in SIZES[:-1]),
            m3("journal", "largest-eigenvalue", size(0.5)),
            m3("journal", "largest-eigenvalue", size(1)),
            usual,
            m4(n, 0.0),
            m4(n, 0.1 * M4_TOLERANCE),
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


#: Name of the run with which all variants are compared.
REFERENCE = "reference"

#: Start of the errors over the simulated time: before, the film builds up from zero pressure. In a
#: periodic run, errors start with the cycle.
START = 0.02

#: Smallest factor on the film cells in both directions with which the error of a mesh is visible.
FINER = 1.2

#: Least number of largest steps between the start of the errors and the end of the run.
LEAST_STEPS = 2

#: Groups of rows in the table, in this order.
METHODS = "methods"
TOLERANCE = "tolerance"
FILMS = "film"
OWN = "reference"


@dataclass(frozen=True)
class Row:
    """Row of the table of a study: one run in one group.

    Attributes
    ----------
    run, group
        Name of the run; group, ``"methods"``, ``"tolerance"``, ``"film"`` or ``"reference"``.
    against
        Name of the run to which errors are relative; empty for the finest run.
    fine_run
        Name of the run of the same bodies with very fine steps, which shows the step error; empty
        if there is none.
    """

    run: str
    group: str
    against: str
    fine_run: str = ""


@dataclass(frozen=True, eq=False)
class Study:
    """Plan of a study: its cases, and the rows of its table.

    Attributes
    ----------
    scene, quick
        Scene common to all runs, and whether the scope is the small one.
    start
        Time after which errors are evaluated [s].
    cases
        Cases by name; the reference is named `REFERENCE`.
    rows
        Rows of the table.
    checks
        Runs that show the reference's own error, by ``"step"``, ``"film"`` or ``"basis"``: name of
        the run, and text with its settings.
    """

    scene: Scene
    quick: bool
    start: float
    cases: Mapping[str, Case]
    rows: tuple[Row, ...]
    checks: Mapping[str, tuple[str, str]]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the lubricated joints of the scene."""
        return tuple(self.scene.films)


#: Type of a function that adds a variant's case to a study and returns its name. If a case with the
#: same settings exists, its name is returned.
Add = Callable[[Variant], str]


def make_study(
    source: str,
    *,
    quick: bool = False,
    scope: Scope | None = None,
    start: float | None = None,
) -> Study:
    """Plan the study of a scene.

    Parameters
    ----------
    source
        Name of a shipped scene or path of a scene file; it has the settings that are not varied.
    quick
        Whether the small scope is used.
    scope
        Scope that replaces the usual one.
    start
        Time after which errors are evaluated [s]; by default 2 % of the simulated time, and 0 for a
        periodic scene.

    Raises
    ------
    SettingsError
        The scene has no lubricated joint or no part to reduce, or a setting cannot be used.
    """
    scene = as_stored(source)
    if not (meshed(scene) and scene.films):
        raise SettingsError(
            f"scene {scene.name} cannot be studied: it needs a flexible body with a model and a "
            "lubricated joint"
        )
    if scope is not None:
        scene = with_values(scene, values_in(scene, scope.settings))
    scope = scope or usual_scope(scene, quick=quick)
    if scope.film_check is not None and scope.film_check.get(FILM, 1.0) < FINER:
        raise SettingsError(
            f"film_check has film({scope.film_check.get(FILM, 1.0):g}), a film mesh that is too "
            f"coarse to show the error of the film mesh: use film({FINER:g}) or more"
        )
    if start is None:
        start = 0.0 if scene.time.periodic else START * scene.span
    _require_long_enough(scene, start)
    cases: dict[str, Case] = {}

    def add(variant: Variant) -> str:
        case = make_case(variant.name, scene, values_in(scene, variant.values))
        return cases.setdefault(case.identity, case).name

    add(Variant(REFERENCE, {**scope.reference.values, **scope.reference_steps}))
    rows = [
        *(Row(add(variant), METHODS, REFERENCE) for variant in scope.methods),
        *_tolerance_rows(add, scope),
        *_film_rows(add, scope),
    ]
    checks = _checks(add, scope)
    others = dict.fromkeys(run for run, _ in checks.values())
    own_rows = [Row(REFERENCE, OWN, ""), *(Row(run, OWN, REFERENCE) for run in others)]
    unique = tuple(dict.fromkeys([*own_rows, *rows]))
    by_name = {case.name: case for case in cases.values()}
    assert len(by_name) == len(cases), "two runs of a scope have one name"
    return Study(scene, quick, start, by_name, unique, checks)


def _require_long_enough(scene: Scene, start: float) -> None:
    time = scene.time
    step = time.largest_step * scene.span / (time.revolutions or 1.0)
    if not 0.0 <= start <= scene.span - LEAST_STEPS * step:
        raise SettingsError(
            f"errors are evaluated after {start:.3g} s, a step may be {step:.3g} s long, and the "
            f"run ends at {scene.span:.3g} s, which leaves too few steps: choose an earlier start "
            "or simulate a longer time"
        )


def _tolerance_rows(add: Add, scope: Scope) -> list[Row]:
    def stepped(variant: Variant, tolerance: float) -> str:
        return add(variant.but(f"tol-{tolerance:.0e}", steps(tolerance)))

    rows = []
    for variant in scope.stepped:
        finest_row = add(variant.but("finest", scope.finest_steps))
        for tolerance in scope.tolerances:
            run = stepped(variant, tolerance)
            rows.append(Row(run, TOLERANCE, REFERENCE, finest_row if run != finest_row else ""))
        rows.append(Row(finest_row, TOLERANCE, REFERENCE))
    loose = [stepped(variant, scope.tolerances[0]) for variant in scope.loose]
    return rows + [Row(run, TOLERANCE, REFERENCE) for run in loose]


def _film_rows(add: Add, scope: Scope) -> list[Row]:
    rows = []
    for variant in scope.meshed:
        runs = [add(variant.but(f"film-{size:g}", film(size))) for size in scope.films]
        rows += [Row(run, FILMS, runs[-1] if run != runs[-1] else "") for run in runs]
    return rows


def _checks(add: Add, scope: Scope) -> dict[str, tuple[str, str]]:
    basis, other = scope.basis_check
    changed = {
        "step": (scope.reference, scope.step_check),
        "film": (scope.reference, scope.film_check),
        "basis": (basis, {**basis.values, **other}),
    }
    checks = {}
    for kind, (variant, values) in changed.items():
        if values is None:
            continue
        merged = {**variant.values, **scope.reference_steps, **values}
        run = add(Variant(f"{REFERENCE}-{kind}", merged))
        words = (f"{'film cells times' if k == FILM else f'{k} ='} {v}" for k, v in values.items())
        checks[kind] = run, f"with {', '.join(words)}"
    return {"step": checks["basis"]} | checks
