"""Curves of what the models of lubricated joints add to a history, where they are on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fenics_ehd.plotting.picture import in_formats, over_time, plt, save, style


class Picture(NamedTuple):
    """One picture over time: its name, label, and the columns in it with what they are called."""

    name: str
    label: str
    columns: Mapping[str, str]


#: In the order in which they are drawn. Curves of one joint have one colour.
PICTURES = (
    Picture(
        "friction_torque",
        "friction torque [N m]",
        {"friction_torque_Nm": "on the journal", "bore_friction_torque_Nm": "on the bore"},
    ),
    Picture(
        "leaving_flow", "flow of oil [m³/s]", {"leaving_flow_m3_per_s": "leaves, with the heat"}
    ),
)

#: Lines of a joint's columns.
LINES = ("-", "--", ":", "-.")


def plot_joint_rates(
    joints: Mapping[str, Mapping[str, np.ndarray]], directory: str | Path
) -> list[Path]:
    """Pictures of the columns that histories have.

    Parameters
    ----------
    joints
        Columns of lubricated joints by the name to show in the legend.
    directory
        Where the pictures go.

    Returns
    -------
    list of Path
        In each of `FORMATS`, none of a model that is off everywhere.
    """
    written = []
    for picture in PICTURES:
        shown = {
            name: {c: called for c, called in picture.columns.items() if c in columns}
            for name, columns in joints.items()
        }
        if not any(shown.values()):
            continue
        figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
        for number, (name, columns) in enumerate(shown.items()):
            for line, (column, called) in zip(LINES, columns.items(), strict=False):
                curve = {"color": style(number)["color"], "linestyle": line}
                history, label = joints[name], ", ".join(filter(None, (name, called)))
                axes.plot(1e3 * history["time_s"], history[column], label=label, **curve)
        over_time(axes, picture.label)
        written += save(figure, in_formats(directory, picture.name))
    return written
