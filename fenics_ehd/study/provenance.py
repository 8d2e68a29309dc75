"""``study.json``: what was studied, with which programs, on which machine."""

from __future__ import annotations

import json
import os
import platform
from datetime import UTC, datetime
from pathlib import Path

import attrs

from fenics_ehd import __version__
from fenics_ehd.interrupt import interrupt_kept
from fenics_ehd.output import versions
from fenics_ehd.study.plan import Study

#: What the times of the table are.
CLOCK = "processor time of one core with one thread, compilation left out"


def describe_study(study: Study) -> dict[str, object]:
    """Scene, settings, versions and machine."""
    with interrupt_kept():  # Gmsh may be imported for its version
        found = versions(installed=True)
    return {
        "scene": study.scene,
        "quick": study.quick,
        "version": __version__,
        "machine": machine(),
        "clock": CLOCK,
        "errors_count_from_s": study.start,
        "runs": len(study.runs),
        "versions": found,
        "settings": attrs.asdict(study.settings),
    }


def call(workers: int, runs: int) -> dict[str, object]:
    """One call of the program: when, how many runs it had to make, how many at a time."""
    date = datetime.now(UTC).strftime("%Y-%m-%d")
    return {"date": date, "version": __version__, "workers": workers, "runs": runs}


def former_calls(path: Path) -> list[dict[str, object]]:
    """Calls that an earlier ``study.json`` tells of, some of whose runs may have stayed."""
    try:
        return list(json.loads(path.read_text())["calls"])
    except (OSError, ValueError, KeyError, TypeError):
        return []


def machine() -> dict[str, object]:
    """Processor, cores that this process may use, memory [GB] and operating system."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    return {
        "cpu": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_GB": round(memory, 1),
        "os": _system(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _system() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return platform.system()
