"""Lines of a run's report: what a lubricated joint did over the last cycle, and where."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def cycle_line(summary: Mapping[str, Any]) -> list[str]:
    """Which cycle they are of."""
    if "cycle_used" not in summary:  # of an older version
        return []
    ends = summary["cycle_start_s"], summary["cycle_end_s"]
    return [
        f"  the cycle: {summary['cycle_used']}, from {ends[0] * 1e3:.3f} to {ends[1] * 1e3:.3f} ms"
    ]


def place_lines(joint: Mapping[str, Any]) -> list[str]:
    """Of one joint."""
    if "cycle_mean_force_N" not in joint:
        return []

    def at(name: str) -> str:
        return f"crank {joint[f'cycle_{name}_crank_angle_deg']:.1f} deg"

    def place(name: str) -> str:
        angle, height = (joint[f"cycle_{name}_{key}"] for key in ("angle_deg", "height_m"))
        return f"at {angle:.1f} deg of the bore, {height * 1e3:+.2f} mm, {at(name)}"

    return [
        f"    peak of the cycle       {joint['cycle_max_pressure_Pa'] * 1e-6:9.3f} MPa "
        + place("max_pressure"),
        f"    thinnest of the cycle   {joint['cycle_min_film_thickness_m'] * 1e6:9.4f} um  "
        + place("min_film"),
        f"    force                   {joint['cycle_mean_force_N']:9.4g} N   mean, "
        f"{joint['cycle_max_force_N']:.4g} N at {joint['cycle_max_force_angle_deg']:.1f} deg, "
        + at("max_force"),
        f"    eccentricity            {joint['cycle_max_eccentricity_ratio']:9.3f} c   at most in "
        f"the deformed bore, {at('max_eccentricity')}",
    ]


def multiplier_line(summary: Mapping[str, Any]) -> list[str]:
    """How stable a periodic solution is, where that was asked for."""
    if "multiplier_failure" in summary:
        return [f"  largest multiplier: not found, {summary['multiplier_failure']}"]
    if "largest_multiplier" not in summary:
        return []
    return [
        f"  largest multiplier      {summary['largest_multiplier']:9.3g}     of a change is left "
        f"after a cycle, +- {summary['largest_multiplier_residual']:.1g}"
    ]
