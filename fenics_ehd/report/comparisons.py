"""Comparisons of methods that both examples of the paper make."""

from __future__ import annotations

from fenics_ehd.report.statement import (
    FAILS,
    HOLDS,
    OPEN,
    WELL,
    Finding,
    MissingRunsError,
    errors,
    high_load_excess,
    listed,
    near,
    need,
    runs_of,
    verdict,
)
from fenics_ehd.report.study_data import FILM, PRESSURE, Study, StudyRun, default_reduction


def default_m3(study: Study) -> list[StudyRun]:
    """Runs of M3 with the scene's own pressure set and selection, by coordinates."""
    given = default_reduction(study.scene)
    return study.pick(method="m3", pressure_set=given.pressure_set, selection=given.selection)


def many_modes(study: Study, method: str) -> Finding:
    """A method needs many coordinates before it follows both curves well."""
    runs = runs_of(study, method.upper(), method=method)
    enough = [run for run in runs if run.worst_error <= WELL]
    rival = [run for run in default_m3(study) if run.worst_error <= WELL]
    need(rival, "a run of M3 within 5 %")
    if enough:
        result = HOLDS if enough[0].coordinates >= 2 * rival[0].coordinates else FAILS
    else:
        result = HOLDS if runs[-1].coordinates >= 2 * rival[0].coordinates else OPEN
    return Finding(f"{listed(runs)}; M3: {listed(rival[:1])}", result)


def m2_ahead_of_m1(study: Study) -> Finding:
    """With equally many coordinates M2's errors are the smaller ones, in both curves."""
    pairs = [
        (one, two)
        for one in runs_of(study, "M1", method="m1")
        for two in near(study.pick(method="m2"), one.coordinates)[:1]
    ]
    need(pairs, "M1 and M2 with equally many coordinates")
    ahead = [
        two.error(quantity) < one.error(quantity)
        for one, two in pairs
        for quantity in (PRESSURE, FILM)
    ]
    words = "; ".join(
        f"{one.coordinates:.0f}: M1 {errors(one)}, M2 {errors(two)}" for one, two in pairs
    )
    return Finding(words, verdict(ahead))


def too_stiff(study: Study, runs: list[StudyRun]) -> Finding:
    """Peak pressures come out too high where loads are high."""
    excess = [high_load_excess(study, run) for run in runs]
    words = ", ".join(
        f"{run.method.upper()} with {run.coordinates:.0f}: {100 * value:+.1f} %"
        for run, value in zip(runs, excess, strict=True)
    )
    above = (value > run.floor(PRESSURE) for run, value in zip(runs, excess, strict=True))
    return Finding(f"mean pressure error at high loads: {words}", verdict(above))


def at_size(study: Study, coordinates: float) -> dict[str, StudyRun]:
    """M1, M2 and the scene's M3 with about this many coordinates."""
    candidates = {
        "m1": study.pick(method="m1"),
        "m2": study.pick(method="m2"),
        "m3": default_m3(study),
    }
    found = {name: near(runs, coordinates)[:1] for name, runs in candidates.items()}
    missing = [name.upper() for name, runs in found.items() if not runs]
    if missing:
        raise MissingRunsError(f"{', '.join(missing)} with about {coordinates:.0f} coordinates")
    return {name: runs[0] for name, runs in found.items()}


def compared(runs: dict[str, StudyRun]) -> str:
    """Errors of the three methods."""
    return ", ".join(f"{name.upper()} {errors(run)}" for name, run in runs.items())


def m3_best(study: Study, sizes: tuple[float, ...]) -> Finding:
    """M3 is nearest to the reference in both curves."""
    sets = [at_size(study, size) for size in sizes]
    best = [
        runs["m3"].visible_error(quantity) < runs[other].visible_error(quantity)
        for runs in sets
        for other in ("m1", "m2")
        for quantity in (PRESSURE, FILM)
    ]
    words = "; ".join(
        f"{size:.0f}: {compared(runs)}" for size, runs in zip(sizes, sets, strict=True)
    )
    return Finding(words, verdict(best))


def m1_worst(study: Study, size: float) -> Finding:
    """M1 is farthest from the reference in both curves."""
    runs = at_size(study, size)
    worst = (
        runs["m1"].visible_error(quantity) > runs[other].visible_error(quantity)
        for other in ("m2", "m3")
        for quantity in (PRESSURE, FILM)
    )
    return Finding(compared(runs), verdict(worst))
