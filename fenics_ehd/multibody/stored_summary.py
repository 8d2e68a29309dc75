"""Reading of ``summary.json`` from the folder of a run, also of version 0.3."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.files import SUMMARY, read_json
from fenics_ehd.base.sealed_file import named

#: Allowed types of the entries that are read from a summary.
SUMMARY_KINDS: Mapping[str, tuple[type, ...]] = {
    "status": (str,),
    "cycles": (int,),
    "joints": (dict,),
    "cycle_used": (str,),
    "cycle_start_s": (float, int),
    "cycle_end_s": (float, int),
}


def read_summary(folder: Path) -> dict[str, Any]:
    """Read the summary in a folder; it is empty if the file does not exist yet."""
    path = folder / SUMMARY
    if not path.exists():
        return {}
    with named(InputError, f"{path}: not a summary of a run"):
        entries = read_json(path)
        if not isinstance(entries, dict):
            raise ValueError("not an object")
        for name, kinds in SUMMARY_KINDS.items():
            if not isinstance(entries.get(name, kinds[0]()), kinds):
                raise ValueError(f"{name} = {entries[name]!r} has the wrong type")
        return _with_nan(_with_joints(entries))


def _with_joints(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return a summary with the entries of every joint under ``joints``.

    Summaries of version 0.3 with one lubricated joint have its name as ``joint``, followed by its
    entries up to ``cycle_used``.
    """
    names = list(summary)
    if "joint" not in summary or "cycle_used" not in summary:
        return dict(summary)
    first = names.index("joint")
    end = names.index("cycle_used")
    entries = {name: summary[name] for name in names[first + 1 : end]}
    before = {name: summary[name] for name in names[:first]}
    after = {name: summary[name] for name in names[end:]}
    return {**before, "joints": {summary["joint"]: entries}, **after}


def _with_nan(value: Any) -> Any:
    """Replace None by NaN in a value from JSON, where null is a number that is not finite."""
    if isinstance(value, dict):
        return {name: _with_nan(entry) for name, entry in value.items()}
    return float("nan") if value is None else value
