"""Columns and summary entries by names without their joint, as in version 0.3.

Version 0.3 had names without joint in runs with one lubricated joint. Such a name is accepted, with
a `DeprecationWarning`, if only one joint has the quantity.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from fenics_ehd.base.described import Described, unknown_name, value_text
from fenics_ehd.base.renamed import joint_of_bare_name, warn_renamed


class Columns(Described, dict[str, np.ndarray]):
    """Columns of ``history.csv`` by name.

    A name without its joint is accepted if only one joint has the column.

    Attributes
    ----------
    joints
        Names of the lubricated joints.
    """

    joints: Collection[str] = ()

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield the number of columns, and the range of each."""
        yield "columns", f"{len(self)} arrays over the steps, by name with unit"
        for name, values in self.items():
            yield name, value_text(values)

    def __missing__(self, name: str) -> np.ndarray:
        columns = {
            joint: [key.removeprefix(f"{joint}.") for key in self if key.startswith(f"{joint}.")]
            for joint in self.joints
        }
        joint = joint_of_bare_name(name, columns)
        if joint is None:
            raise unknown_name("columns", name, self, "list(columns)")
        return self[f"{joint}.{name}"]

    def get(self, name: str, default: Any = None) -> Any:
        """Column of a name, which may omit the joint; `default` if no column has this name."""
        try:
            return self[name]
        except KeyError:
            return default


class Summary(Described, dict[str, Any]):
    """Entries of ``summary.json`` by name.

    The entry of a joint is accepted without the joint if only one joint has it.
    """

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield the number of entries, and each of them; those of joints by their names."""
        yield "summary", f"{len(self)} entries, dict(summary) has all of them"
        for name, value in self.items():
            yield name, value_text(value)

    def __missing__(self, name: str) -> Any:
        joints = super().get("joints", {})
        if name == "joint" and len(joints) == 1:
            warn_renamed("joint", "the key under joints", depth=1)
            return next(iter(joints))
        joint = joint_of_bare_name(name, joints, before="joints.")
        if joint is None:
            raise unknown_name("summary", name, self, "list(summary)")
        return joints[joint][name]

    def get(self, name: str, default: Any = None) -> Any:
        """Entry of the run with this name, or of the only joint that has it; else `default`."""
        try:
            return self[name]
        except KeyError:
            return default
