"""``fenics-ehd rotor``: modes, critical speeds, stability limit and unbalance response of a rotor.

Imports inside functions: ``--help`` must work without NumPy and films, and quickly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees, isclose
from pathlib import Path
from time import perf_counter, process_time
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.base.errors import EhdError, SettingsError
from fenics_ehd.base.fields import FILM_MESHES
from fenics_ehd.base.files import require_kept, require_made_by, versions
from fenics_ehd.base.printed import scatter_text
from fenics_ehd.cli.options import (
    Whole,
    aligned,
    answer,
    flag,
    json_option,
    no_cache_option,
    output_option,
    question,
    warn_of,
)

if TYPE_CHECKING:
    from fenics_ehd.analysis.rotor_map import RotorMap
    from fenics_ehd.multibody.forces import Unbalance
    from fenics_ehd.study.rotor_folder import RotorFolder


#: Largest number of modes that are printed for a map with one speed, from the lowest frequency.
LISTED_MODES = 8

#: Relative difference up to which a speed of ``--shapes`` is a speed of the map.
SAME_SPEED = 1e-9


class FailedSpeedsError(EhdError):
    """A rotor map has no equilibrium at some speeds; results at all other speeds are stored."""


#: Syntax of ``--unbalance``, for messages.
SYNTAX = (
    "POINT=MAGNITUDE or POINT=MAGNITUDE@PHASE, for instance shaft.disk=4e-4 or shaft.disk=4e-4@90"
)


def parse_unbalance(text: str) -> Unbalance:
    """Unbalance from the text of an option, ``shaft.disk=4e-4`` or ``shaft.disk=400 g mm@90``.

    Raises
    ------
    SettingsError
        The text is malformed, or a value has another unit.
    """
    from fenics_ehd.multibody.forces import Unbalance

    point, equals, value = (part.strip() for part in text.partition("="))
    magnitude, at, phase = (part.strip() for part in value.partition("@"))
    if not (point and equals and magnitude) or (at and not phase):
        raise SettingsError(f"--unbalance {text!r} must be {SYNTAX}")
    try:
        return Unbalance(point, _number(magnitude, "kg m"), _number(phase or "0", "degrees"))
    except SettingsError as error:
        raise SettingsError(f"--unbalance {text!r}: {error}") from None


def _number(text: str, unit: str) -> float:
    from fenics_ehd.base.units import in_unit, parse_number

    try:
        return parse_number(text)
    except ValueError:
        return in_unit(text, unit)


@question("What are a rotor's critical speeds, and does it whirl?")
@click.command()
@click.argument("scene")
@click.option(
    "--speeds",
    required=True,
    metavar="VALUES",
    help="Speeds of the rotor [rad/s], or with a unit: a list, 1000rpm,2000rpm, or a range, "
    "first:last:count or first:last:count:log. Speeds are added where modes change quickly.",
)
@click.option(
    "--of",
    metavar="BODY",
    default="",
    help="Body whose speed is varied [default: all that rotate].",
)
@click.option(
    "--unbalance",
    "unbalances",
    multiple=True,
    metavar="POINT=MAGNITUDE[@PHASE]",
    help="Unbalance [kg m] at a point, with its phase [degrees]: shaft.disk=4e-4@90. Its response "
    "is computed in place of that of the scene's unbalances. Repeatable.",
)
@click.option(
    "--shapes",
    metavar="VALUES",
    help="Speeds at which mode shapes are drawn, written as for --speeds and within their range; "
    "they are added to the map [default: the stability limit, or the middle of the range].",
)
@click.option(
    "--meshes",
    type=Whole(min=1, max=FILM_MESHES),
    default=FILM_MESHES,
    show_default=True,
    help="Number of film meshes over which stiffness and damping are averaged: the mesh of the "
    "scene, then meshes with 2, 4 and 6 more cells around.",
)
@output_option("directory", "Folder for tables and pictures [default: results/SCENE-rotor].")
@click.option(
    "--plots/--no-plots",
    default=True,
    show_default=True,
    help="Draw the diagrams; --no-plots: write tables and summary only.",
)
@flag("--overwrite", "Discard the results in the folder, and compute all speeds anew.")
@no_cache_option
@json_option
def rotor(
    scene: str,
    speeds: str,
    of: str,
    unbalances: tuple[str, ...],
    shapes: str | None,
    meshes: int,
    directory: str | None,
    plots: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Campbell diagram, stability limit and unbalance response of the rotor in SCENE.

    At each speed the equilibrium of the rotor in its bearings is computed, and the modes of small
    vibrations about it. Modes are followed over the speed. At a critical speed, a mode with a
    damping ratio below 0.4 has the frequency of rotation (1x). Above the stability limit, a
    vibration grows (oil whip); whirl ratio is its frequency over the speed. With one speed, its
    modes are printed.

    Speeds in the folder that are already complete are not computed again.
    """
    from fenics_ehd.scenes.rotor_map import plan_map
    from fenics_ehd.scenes.scene import as_stored, input_files
    from fenics_ehd.study.cases import parse_quantities
    from fenics_ehd.study.rotor_folder import MADE, RotorFolder

    target = Path(directory or Path("results") / f"{Path(scene).stem}-rotor")
    require_made_by(target, RotorFolder.command)
    source = as_stored(scene)
    require_kept(target, input_files(scene, source), MADE)
    values = parse_quantities("--speeds", speeds, "rad/s")
    asked = parse_quantities("--shapes", shapes, "rad/s") if shapes else ()
    asked = tuple(_within(values, speed) for speed in asked)
    unbalance = [parse_unbalance(text) for text in unbalances] or None
    every = tuple(dict.fromkeys((*values, *asked)))
    plan = plan_map(source, every, of=of, unbalance=unbalance, meshes=meshes, option="--{}")
    warn_of(source.warnings)
    begin = perf_counter(), process_time()
    with RotorFolder(target, plan, overwrite=overwrite) as folder:
        warn_of(folder.points.notices)
        chart = _solved(folder)
        warn_of(chart.notices)
        shown = shown_speeds(chart, asked)
        folder.write(chart, shown)
        if plots:
            from fenics_ehd.plotting.rotor import plot_map

            plot_map(chart, folder.path, shown)
        summary = _summary(chart, folder, begin)
        folder.write_summary(summary)
    files = "tables and pictures" if plots else "tables"
    answer(summary, "\n".join(report(chart, summary, files)), as_json)
    if chart.failures:
        speed, reason = next(iter(chart.failures.items()))
        raise FailedSpeedsError(
            f"{len(chart.failures)} of {len(plan.speeds)} speeds have no equilibrium, the first is "
            f"{speed:.6g} rad/s: {reason}"
        )


def _within(speeds: Sequence[float], shown: float) -> float:
    """Speed of `--shapes`, as the equal speed of the map if there is one [rad/s].

    Raises
    ------
    SettingsError
        The speed is not between the speeds of the map.
    """
    nearest = min(speeds, key=lambda speed: abs(speed - shown))
    if isclose(nearest, shown, rel_tol=SAME_SPEED):
        return nearest
    if not min(speeds) < shown < max(speeds):
        raise SettingsError(
            f"--shapes: {_speed(shown)} is not between the speeds of the map, "
            f"{_speed(min(speeds))} and {_speed(max(speeds))}: extend --speeds, or drop this speed"
        )
    return shown


def _solved(folder: RotorFolder) -> RotorMap:
    """Compute the rotor map of a folder, and show the progress on standard error."""
    from fenics_ehd.base.processes import interrupt_between_steps
    from fenics_ehd.base.progress import shown_progress
    from fenics_ehd.scenes.rotor_map import solve_map

    progress = shown_progress(logs=True)
    with interrupt_between_steps() as check:
        return solve_map(folder.plan, stored=folder.points, progress=progress, between=check)


def shown_speeds(chart: RotorMap, asked: Sequence[float]) -> list[int]:
    """Indices of the requested speeds of a map, without speeds that failed, for mode shapes.

    Without requested speeds, the result is the first stability limit or a speed in the middle.
    """
    if not asked:
        middle = chart.points[len(chart.points) // 2].speed
        asked = [chart.limits[0].speed if chart.limits else middle]
    speeds = chart.speeds.tolist()
    return [speeds.index(speed) for speed in asked if speed in speeds]


def _summary(chart: RotorMap, folder: RotorFolder, begin: tuple[float, float]) -> dict[str, Any]:
    from fenics_ehd.study.rotor_folder import figures_of_map

    failed = len(chart.failures)
    return {
        "status": f"incomplete: {failed} speeds have no equilibrium" if failed else "complete",
        "scene": folder.plan.scene.name,
        "directory": str(folder.path),
        "rotating": list(folder.plan.rotating),
        "meshes": folder.plan.meshes,
        **figures_of_map(chart),
        "warnings": [*folder.plan.scene.warnings, *chart.notices],
        "wall_time_s": perf_counter() - begin[0],
        "processor_time_s": process_time() - begin[1],
        "versions": versions(),
    }


def report(
    chart: RotorMap, summary: Mapping[str, Any], written: str = "tables and pictures"
) -> list[str]:
    """Lines of the printed results of a rotor map; `written` are the files in its folder."""
    first = chart.speeds[0]
    last = chart.speeds[-1]
    from fenics_ehd.analysis.modes import whirl_name

    single = len(chart.points) == 1
    span = f"speed, {_speed(first)}" if single else f"speeds from {_speed(first)} to {_speed(last)}"
    lines = [f"{summary['scene']}: {len(chart.points)} {span}"]
    if not summary["stable_at_first_speed"]:
        lines.append(f"unstable at {'this' if single else 'the lowest'} speed")
    elif not chart.limits:
        lines.append(f"stable at {'this speed' if single else 'all these speeds'}")
    for limit in chart.limits:
        whirl = f"{limit.whirl_ratio:.4f}{scatter_text(limit.whirl_ratio_scatter or None)}"
        bound = scatter_text(limit.scatter or None, " rad/s")
        lines.append(
            f"stability {'lost' if limit.lost else 'regained'} at {_speed(limit.speed)}{bound}, "
            f"mode {limit.mode + 1}, whirl ratio {whirl}"
        )
    scatters = [limit.scatter for limit in chart.limits]
    if any((*scatters, *(each.scatter for each in chart.critical_speeds))):
        lines.append(f"+-: half the range over {summary['meshes']} film meshes")
    if chart.critical_speeds:
        rows = [["critical speed", "1/min", "mode", "damping ratio", "whirl", ""]]
        rows += [
            [
                f"{each.speed:.5g}{scatter_text(each.scatter or None)} rad/s",
                f"{_rpm(each.speed):.0f}",
                str(each.mode + 1),
                f"{each.damping_ratio:.3f}{scatter_text(each.damping_ratio_scatter or None)}",
                f"{whirl_name(each.direction).removesuffix(' whirl')} {each.direction:+.2f}",
                _unstable(chart, each.speed),
            ]
            for each in chart.critical_speeds
        ]
        lines += aligned(rows)
    elif single:
        lines += _mode_lines(chart)
    else:
        lines.append("no critical speed with a damping ratio below 0.4 in this range of speeds")
    lines += _response_lines(chart)
    lines.append(f"{written} in {summary['directory']}")
    return lines


def _mode_lines(chart: RotorMap) -> list[str]:
    """Lines on the modes of a map with one speed: frequency, damping ratio and whirl."""
    from fenics_ehd.analysis.modes import damping_ratio, damping_ratio_scatter, whirl_name
    from fenics_ehd.analysis.rotor_map import OVERDAMPED

    rows = [["mode", "rad/s", "1/min", "damping ratio", "whirl", ""]]
    for track, root in enumerate(chart.roots[:, 0].tolist()):
        if not (root.imag > 0.0 and damping_ratio(root) < OVERDAMPED):
            continue
        direction = chart.direction(0, track)
        scatter = complex(chart.scatter[track, 0])
        bound = scatter_text(damping_ratio_scatter(root, scatter) or None)
        rows.append(
            [
                str(track + 1),
                f"{root.imag:.5g}{scatter_text(scatter.imag or None)}",
                f"{_rpm(root.imag):.0f}",
                f"{damping_ratio(root):.3f}{bound}",
                f"{whirl_name(direction).removesuffix(' whirl')} {direction:+.2f}",
                "unstable" if root.real > 0.0 else "",
            ]
        )
    rows[LISTED_MODES + 1 :] = []
    return [*aligned(rows), "critical speeds and limits need several speeds"]


def _response_lines(chart: RotorMap) -> list[str]:
    """Lines on the response to unbalances: resonances of all points; amplitudes at one speed."""
    if chart.response is None:
        return []
    if len(chart.points) == 1:
        rows = [["unbalance response of", "amplitude", "phase"]]
        for point in chart.response.points:
            amplitude = float(chart.response.amplitude(point)[0])
            phase = degrees(float(chart.response.phase(point)[0]))
            rows.append([point, f"{1e6 * amplitude:.4g} um", f"{phase:.0f} deg"])
        return aligned(rows)
    rows = [["resonance of", "rad/s", "1/min", "amplitude", "amplification", ""]]
    for peak in chart.response.resonances:
        factor = "-" if peak.amplification is None else f"{peak.amplification:.3g}"
        rows.append(
            [
                peak.point,
                f"{peak.speed:.5g}",
                f"{_rpm(peak.speed):.0f}",
                f"{1e6 * peak.amplitude:.4g} um",
                factor,
                _unstable(chart, peak.speed),
            ]
        )
    if len(rows) == 1:
        return ["no resonance in this range of speeds"] if chart.response.excited else []
    without = any(row[-2] == "-" for row in rows)
    note = ["-: no amplification factor, the amplitude falls by less than 3 dB on one side"]
    return [*aligned(rows), *(note if without else [])]


def _unstable(chart: RotorMap, speed: float) -> str:
    """Mark of a resonance or critical speed [rad/s] at which the rotor is unstable; else empty."""
    return "" if chart.stable_at(speed) else "unstable"


def _rpm(speed: float) -> float:
    from fenics_ehd.base.units import RPM

    return speed * RPM


def _speed(speed: float) -> str:
    return f"{speed:.5g} rad/s ({_rpm(speed):.0f} 1/min)"
