"""The runs of a study, what each of them is compared with, and where it stands in the table."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fenics_ehd.errors import SettingsError
from fenics_ehd.study.film_check import film_check
from fenics_ehd.study.scope import SCOPES, Scope
from fenics_ehd.study.variants import Variant
from fenics_ehd.sweeps.keys import with_values
from fenics_ehd.sweeps.plan import Case, body_name, settings_identity
from fenics_ehd.sweeps.scenes import read_settings

#: Name of the run that all methods are measured against.
REFERENCE = "reference"

#: Largest steps that must fit between the start of errors and the end: three steps at least.
LEAST_STEPS = 2

#: Groups of rows, in the order of the table.
METHODS, TOLERANCE, FILM, OWN = "methods", "tolerance", "film", "reference"


@dataclass(frozen=True)
class StudyRun:
    """One run: its name, its case, and a checksum of all that its results depend on."""

    name: str
    case: Case
    identity: str

    @property
    def body(self) -> str:
        """Name of its reduced body."""
        assert self.case.body is not None
        return self.case.body


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
        The same body with very fine steps, which shows the error of the steps alone; empty: none.
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


@dataclass(frozen=True)
class Study:
    """A study.

    Attributes
    ----------
    scene, quick, settings
        What is studied; the settings that all runs have in common.
    start
        Time from which on errors count [s].
    runs
        By name; the reference is `REFERENCE`.
    rows
        Of the table.
    checks
        Of the reference: ``"step"``, ``"film"``, ``"basis"``.
    """

    scene: str
    quick: bool
    settings: Any
    start: float
    runs: Mapping[str, StudyRun]
    rows: tuple[Row, ...]
    checks: Mapping[str, Check]


class _Runs:
    """Runs by name, each of them once."""

    def __init__(self, base: Any):
        self._base = base
        self._names: dict[str, str] = {}
        self.found: dict[str, StudyRun] = {}

    def add(self, name: str, *values: Mapping[str, Any]) -> str:
        """Add a run of these settings, unless there is one; returns its name."""
        merged = {key: value for part in values for key, value in part.items()}
        settings = with_values(self._base, merged)
        same = identity(settings)
        if same not in self._names:
            assert name not in self.found, f"two runs are called {name}"
            case = Case(len(self.found) + 1, (), settings, body_name(settings))
            self.found[name] = StudyRun(name, case, same)
            self._names[same] = name
        return self._names[same]


def identity(settings: Any) -> str:
    """Checksum of all that a run's results depend on."""
    parts = settings_identity(settings, {}) | {"body": str(body_name(settings))}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def make_study(scene: str, *, quick: bool = False, scope: Scope | None = None) -> Study:
    """Study of a scene.

    Parameters
    ----------
    scene
        ``slider-crank``, ``rotor``, or a scene file of their kind, whose settings hold for all
        that is not varied.
    quick
        The small selection for people who try it out.
    scope
        What to run instead.

    Raises
    ------
    SettingsError
        The scene has no study, or settings that cannot be used.
    """
    given = read_settings(scene)
    kind = given.scene
    if scope is None:
        if (kind, quick) not in SCOPES:
            known = " or ".join(sorted({name for name, _ in SCOPES}))
            raise SettingsError(f"scene {kind}: there is no study of it, only of {known}")
        scope = SCOPES[kind, quick]
    base = with_values(given, scope.settings)
    _require_long_enough(base, scope.start)
    runs = _Runs(base)
    runs.add(REFERENCE, scope.reference.values, scope.reference_steps)
    rows = [
        *(Row(runs.add(v.name, v.values), METHODS, REFERENCE) for v in scope.methods),
        *_tolerance_rows(runs, scope, base.time),
        *_film_rows(runs, scope),
    ]
    checks = _checks(runs, scope, film_check(scope.film_check, base))
    others = dict.fromkeys(check.run for check in checks.values())
    rows = [Row(REFERENCE, OWN, ""), *(Row(run, OWN, REFERENCE) for run in others), *rows]
    return Study(kind, quick, base, scope.start, runs.found, tuple(rows), checks)


def _require_long_enough(settings: Any, start: float) -> None:
    if settings.scene == "rotor":
        key, turns, speed = "shaft.revolutions", settings.shaft.revolutions, settings.shaft.speed
    else:
        mechanism = settings.mechanism
        key, turns, speed = "mechanism.revolutions", mechanism.revolutions, mechanism.crank_speed
    end = 2 * math.pi * turns / speed
    step = math.radians(settings.time.largest_step) / speed
    if not end >= start + LEAST_STEPS * step:
        raise SettingsError(
            f"{key} = {turns:g} ends at {end:.3g} s, errors count from {start:g} s, a step may "
            f"take {step:.3g} s: simulate more"
        )


def _tolerance_rows(runs: _Runs, scope: Scope, base: Any) -> list[Row]:
    rows = []
    for variant in scope.stepped:
        finest = variant.but("finest", scope.finest_steps)
        own = runs.add(finest.name, finest.values)
        for tolerance in scope.tolerances:
            asked = _stepped(variant, tolerance, base.tolerance)
            rows.append(Row(runs.add(asked.name, asked.values), TOLERANCE, REFERENCE, own))
        rows.append(Row(own, TOLERANCE, REFERENCE))
    for variant in scope.loose:
        asked = _stepped(variant, scope.tolerances[0], base.tolerance)
        rows.append(Row(runs.add(asked.name, asked.values), TOLERANCE, REFERENCE))
    return rows


def _stepped(variant: Variant, tolerance: float, default: float) -> Variant:
    if tolerance == default:
        return variant
    return variant.but(f"tol-{tolerance:.0e}", {"time.tolerance": tolerance})


def _film_rows(runs: _Runs, scope: Scope) -> list[Row]:
    rows = []
    for variant in scope.meshed:
        meshed = [_meshed(variant, cells) for cells in scope.meshes]
        finest = runs.add(meshed[-1].name, meshed[-1].values)
        rows += [Row(runs.add(v.name, v.values), FILM, finest) for v in meshed[:-1]]
        rows.append(Row(finest, FILM, ""))
    return rows


def _meshed(variant: Variant, cells: tuple[int, int]) -> Variant:
    around, along = cells
    return variant.but(f"film-{around}x{along}", {"film.cells": cells})


def _checks(runs: _Runs, scope: Scope, film: Mapping[str, Any]) -> dict[str, Check]:
    reference, fine = scope.reference.values, scope.reference_steps
    variant, values = scope.basis_check
    changed = {"film": (reference, film), "basis": (variant.values, values)}
    if scope.step_check is not None:
        changed = {"step": (reference, scope.step_check)} | changed
    checks = {}
    for kind, (basis, other) in changed.items():
        run = runs.add(f"reference-{kind}", basis, fine, other)
        words = _words(other if basis is reference else {**basis, **other})
        checks[kind] = Check(run, f"with {words}")
    return {"step": checks["basis"]} | checks


def _words(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {value}" for key, value in values.items())
