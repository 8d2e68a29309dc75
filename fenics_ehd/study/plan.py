"""The runs of a study, what each of them is compared with, and where it stands in the table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.scenes.scene import Scene, lubricated_joints, meshed
from fenics_ehd.scenes.scene_text import as_stored
from fenics_ehd.study.case import Case, checksum, identity, make_case
from fenics_ehd.study.keys import with_values
from fenics_ehd.study.scope import Scope, usual_scope
from fenics_ehd.study.variants import FILM, Variant, film, steps, values_in

#: Name of the run that all methods are measured against.
REFERENCE = "reference"

#: Share of the simulated time from which on errors count: before, the film builds up from no
#: pressure at all. A cycle that repeats counts from its beginning.
START = 0.02

#: Largest steps that must fit between the start of errors and the end: three steps at least.
LEAST_STEPS = 2

#: Groups of rows, in the order of the table.
METHODS, TOLERANCE, FILMS, OWN = "methods", "tolerance", "film", "reference"


@dataclass(frozen=True)
class Row:
    """A run in the table.

    Attributes
    ----------
    run, group
        Its name; ``"methods"``, ``"tolerance"``, ``"film"`` or ``"reference"``.
    against
        The run that its errors are relative to; empty: none, it is the finest.
    own
        The same bodies with very fine steps, which shows the error of the steps alone; empty: none.
    """

    run: str
    group: str
    against: str
    own: str = ""


@dataclass(frozen=True)
class Check:
    """One of the reference's own errors: the run that shows it, and what is different there."""

    run: str
    meaning: str


@dataclass(frozen=True, eq=False)
class Study:
    """A study.

    Attributes
    ----------
    scene, quick
        What all runs have in common, and whether the scope is the short one.
    start
        Time from which on errors count [s].
    cases
        By name; the reference is `REFERENCE`.
    identities
        Checksums of all that their results depend on, by name.
    rows
        Of the table.
    checks
        Of the reference: ``"step"``, ``"film"``, ``"basis"``.
    """

    scene: Scene
    quick: bool
    start: float
    cases: Mapping[str, Case]
    identities: Mapping[str, str]
    rows: tuple[Row, ...]
    checks: Mapping[str, Check]

    @property
    def joints(self) -> tuple[str, ...]:
        """Lubricated joints."""
        return lubricated_joints(self.scene)


class _Cases:
    """Cases by name, each of them once."""

    def __init__(self, scene: Scene):
        self._scene = scene
        self._names: dict[str, str] = {}
        self.found: dict[str, Case] = {}

    def add(self, variant: Variant) -> str:
        """Add a case, unless there is one of these settings; returns its name."""
        case = make_case(variant.name, self._scene, values_in(self._scene, variant.values))
        same = checksum(identity(case.scene) | {n: b.name for n, b in case.bodies.items()})
        if same not in self._names:
            assert variant.name not in self.found, f"two runs are called {variant.name}"
            self.found[variant.name] = case
            self._names[same] = variant.name
        return self._names[same]

    @property
    def identities(self) -> dict[str, str]:
        """Checksums by name."""
        return {name: same for same, name in self._names.items()}


def make_study(
    source: str,
    *,
    quick: bool = False,
    scope: Scope | None = None,
    start: float | None = None,
) -> Study:
    """Study of a scene.

    Parameters
    ----------
    source
        Shipped scene, or a scene file, whose settings hold for all that is not varied.
    quick
        The small selection for people who try it out.
    scope
        What to run instead.
    start
        Time from which on errors count [s]; None: after 2 % of the simulated time, from the
        beginning of a cycle that repeats.

    Raises
    ------
    SettingsError
        The scene has no film or no part to reduce, or settings that cannot be used.
    """
    scene = as_stored(source)
    if not (meshed(scene) and lubricated_joints(scene)):
        raise SettingsError(
            f"scene {scene.name}: there is nothing to study, it needs a flexible body with a "
            "model and a lubricated joint"
        )
    if scope is not None:
        scene = with_values(scene, values_in(scene, scope.settings))
    scope = scope or usual_scope(scene, quick=quick)
    if start is None:
        start = 0.0 if scene.time.periodic else START * scene.span
    _require_long_enough(scene, start)
    cases = _Cases(scene)
    cases.add(Variant(REFERENCE, {**scope.reference.values, **scope.reference_steps}))
    rows = [
        *(Row(cases.add(variant), METHODS, REFERENCE) for variant in scope.methods),
        *_tolerance_rows(cases, scope, scene.time.tolerance),
        *_film_rows(cases, scope),
    ]
    checks = _checks(cases, scope)
    others = dict.fromkeys(check.run for check in checks.values())
    own = [Row(REFERENCE, OWN, ""), *(Row(run, OWN, REFERENCE) for run in others)]
    unique = tuple(dict.fromkeys([*own, *rows]))
    return Study(scene, quick, start, cases.found, cases.identities, unique, checks)


def _require_long_enough(scene: Scene, start: float) -> None:
    time = scene.time
    step = time.largest_step * scene.span / (time.revolutions or 1.0)
    if not 0.0 <= start <= scene.span - LEAST_STEPS * step:
        raise SettingsError(
            f"errors count from start = {start:.3g} s, a step may take {step:.3g} s, and the scene "
            f"ends at {scene.span:.3g} s: choose another start or simulate more"
        )


def _tolerance_rows(cases: _Cases, scope: Scope, usual: float) -> list[Row]:
    rows = []
    for variant in scope.stepped:
        own = cases.add(variant.but("finest", scope.finest_steps))
        for tolerance in scope.tolerances:
            run = cases.add(_stepped(variant, tolerance, usual))
            rows.append(Row(run, TOLERANCE, REFERENCE, own if run != own else ""))
        rows.append(Row(own, TOLERANCE, REFERENCE))
    for variant in scope.loose:
        run = cases.add(_stepped(variant, scope.tolerances[0], usual))
        rows.append(Row(run, TOLERANCE, REFERENCE))
    return rows


def _stepped(variant: Variant, tolerance: float, usual: float) -> Variant:
    if tolerance == usual:
        return variant
    return variant.but(f"tol-{tolerance:.0e}", steps(tolerance))


def _film_rows(cases: _Cases, scope: Scope) -> list[Row]:
    rows = []
    for variant in scope.meshed:
        runs = [cases.add(_meshed(variant, factor)) for factor in scope.films]
        rows += [Row(run, FILMS, runs[-1]) for run in runs[:-1]]
        rows += [Row(run, FILMS, "") for run in runs[-1:]]
    return rows


def _meshed(variant: Variant, factor: float) -> Variant:
    return variant if factor == 1.0 else variant.but(f"film-{factor:g}", film(factor))


def _checks(cases: _Cases, scope: Scope) -> dict[str, Check]:
    basis, other = scope.basis_check
    changed = {
        "film": (scope.reference, scope.film_check),
        "basis": (basis, {**basis.values, **other}),
    }
    if scope.step_check is not None:
        changed = {"step": (scope.reference, scope.step_check)} | changed
    checks = {}
    for kind, (variant, values) in changed.items():
        merged = {**variant.values, **scope.reference_steps, **values}
        run = cases.add(Variant(f"{REFERENCE}-{kind}", merged))
        words = (f"{'film cells times' if k == FILM else f'{k} ='} {v}" for k, v in values.items())
        checks[kind] = Check(run, f"with {', '.join(words)}")
    return {"step": checks["basis"]} | checks
