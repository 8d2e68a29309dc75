"""``study.json``: what was studied, with which programs, on which machine."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from fenics_ehd import __version__
from fenics_ehd.base.interrupt import interrupt_kept
from fenics_ehd.base.output import versions
from fenics_ehd.base.text_file import read_json
from fenics_ehd.study.plan import Study

#: What the times of the table are.
CLOCK = "processor time of one core with one thread, compilation left out"


def describe_study(study: Study) -> dict[str, object]:
    """Scene, settings, versions and machine."""
    with interrupt_kept():  # Gmsh may be imported for its version
        found = versions(installed=True)
    return {
        "scene": study.scene.name,
        "joints": list(study.joints),
        "quick": study.quick,
        "version": __version__,
        "machine": machine(),
        "clock": CLOCK,
        "start": study.start,
        "runs": len(study.cases),
        "versions": found,
        "settings": dict(study.scene.tables),
    }


def call(workers: int, runs: int) -> dict[str, object]:
    """One call of the program: when, how many runs it had to make, how many at a time."""
    date = datetime.now(UTC).strftime("%Y-%m-%d")
    return {"date": date, "version": __version__, "workers": workers, "runs": runs}


def former_calls(path: Path) -> list[dict[str, object]]:
    """Calls that an earlier ``study.json`` tells of, some of whose runs may have stayed."""
    try:
        return list(read_json(path)["calls"])
    except (OSError, ValueError, KeyError, TypeError):
        return []


def machine() -> dict[str, object]:
    """Processor, cores that this process may use, memory [GB] and operating system."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    return {
        "cpu": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_GB": round(memory, 1),
        "os": platform.platform(),
    }


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.machine()
