"""Comparisons of methods that both examples of the paper make."""

from __future__ import annotations

from collections.abc import Sequence

from fenics_ehd.report.needed import MissingRunsError, ended, every, near, need, of_size, runs_of
from fenics_ehd.report.statement import (
    FAILS,
    HOLDS,
    OPEN,
    WELL,
    Finding,
    clearly,
    errors,
    high_load_excess,
    listed,
    verdict,
)
from fenics_ehd.report.study_data import (
    FILM,
    PRESSURE,
    Quantity,
    Study,
    StudyRun,
    default_reduction,
)


def scene_m3(study: Study) -> dict[str, str]:
    """What the runs of M3 with the scene's own pressure set and selection have in common."""
    given = default_reduction(study.scene)
    return {"method": "m3", "pressure_set": given.pressure_set, "selection": given.selection}


def smaller(one: StudyRun, two: StudyRun, quantity: Quantity) -> bool | None:
    """Whether the first one's error is the smaller one; None within the reference's own error."""
    difference = two.visible_error(quantity) - one.visible_error(quantity)
    return clearly(difference > 0, difference, max(one.floor(quantity), two.floor(quantity)))


def many_modes(study: Study, method: str) -> Finding:
    """A method needs many coordinates before it follows both curves well."""
    runs = need(ended(study, method=method), method.upper())
    rival = [run for run in ended(study, **scene_m3(study)) if run.worst_error <= WELL]
    need(rival, "a run of M3 within 5 %")
    words = f"{listed(runs)}; M3: {listed(rival[:1])}"
    return Finding(words, needs_more(runs, WELL, 2 * rival[0].coordinates))


def needs_more(runs: Sequence[StudyRun], error: float, coordinates: float) -> str:
    """Whether an error takes at least so many coordinates.

    The number that it takes lies above the last run that is not as good and not above the first
    one that is; no such run, no bound on that side.
    """
    good = [run.coordinates for run in runs if run.worst_error <= error]
    first = min(good, default=float("inf"))
    last = max((run.coordinates for run in runs if run.coordinates < first), default=0.0)
    if last >= coordinates:
        return HOLDS
    return FAILS if first < coordinates else OPEN


def m2_ahead_of_m1(study: Study) -> Finding:
    """With equally many coordinates M2's errors are the smaller ones, in both curves."""
    rivals = every(study, method="m2")
    pairs = [
        (one, two)
        for one in runs_of(study, "M1", method="m1")
        for two in near(rivals, one.coordinates)[:1]
    ]
    need(pairs, "M1 and M2 with equally many coordinates")
    ahead = [smaller(two, one, quantity) for one, two in pairs for quantity in (PRESSURE, FILM)]
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
    above = (
        clearly(value > 0, value, run.floor(PRESSURE))
        for run, value in zip(runs, excess, strict=True)
    )
    return Finding(f"mean pressure error at high loads: {words}", verdict(above))


def at_size(study: Study, coordinates: float) -> dict[str, StudyRun]:
    """M1, M2 and the scene's M3 with about this many coordinates."""
    found = {
        "m1": of_size(study, coordinates, method="m1"),
        "m2": of_size(study, coordinates, method="m2"),
        "m3": of_size(study, coordinates, **scene_m3(study)),
    }
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
        smaller(runs["m3"], runs[other], quantity)
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
        smaller(runs[other], runs["m1"], quantity)
        for other in ("m2", "m3")
        for quantity in (PRESSURE, FILM)
    )
    return Finding(compared(runs), verdict(worst))
