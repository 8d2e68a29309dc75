"""Whether a study is of the machine that the paper's statements are about."""

from __future__ import annotations

from typing import Any

import attrs

from fenics_ehd.report.nested import flat
from fenics_ehd.report.study_data import SETTINGS, Study

#: How a machine is computed, which a study varies; the rest is the machine.
COMPUTED = ("reduction.", "time.", "film.")

#: What of these belongs to the machine.
PHYSICAL = ("film.friction",)

#: Sizes of a part, which have no default but that of its Gmsh model.
SIZES = ".geometry."


def other_settings(study: Study) -> dict[str, Any]:
    """Settings of the machine, ``section.key``, that are not the paper's.

    Those that an older or newer version knows alone are left out.
    """
    usual = dict(flat(attrs.asdict(SETTINGS[study.scene]())))
    return {
        key: value
        for key, value in flat(study.info.get("settings") or {})
        if (key in PHYSICAL or not key.startswith(COMPUTED))
        and (SIZES in key or value != usual.get(key, value))
    }


def machine_remark(study: Study) -> str:
    """In what the machine is not the paper's; empty where it is."""
    differing = [f"{key} = {_plain(value)}" for key, value in other_settings(study).items()]
    if not differing:
        return ""
    return f"Not the paper's machine, which the statements are about: {', '.join(differing)}."


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
