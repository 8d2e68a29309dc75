"""Friction torque over time in the reference of a study, joint by joint."""

from __future__ import annotations

from matplotlib.figure import Figure

from fenics_ehd.study.report.study_data import REFERENCE_RUN, StudyData
from fenics_ehd.study.report.style import REFERENCE, WIDTH, plt

#: Columns, what they are called, lines.
CURVES = (
    ("friction_torque_Nm", "on the journal", "-"),
    ("bore_friction_torque_Nm", "on the bore", "--"),
)


def draw_friction(study: StudyData) -> Figure | None:
    """A panel for each joint with friction; None without any, or before there is a reference."""
    histories = {
        joint: history
        for joint in study.joints
        if (history := joint.history(REFERENCE_RUN)) is not None and CURVES[0][0] in history
    }
    if not histories:
        return None
    figure, panels = plt.subplots(
        len(histories), figsize=(WIDTH, 3.2 * len(histories)), layout="constrained", squeeze=False
    )
    for axes, (joint, history) in zip(panels.flat, histories.items(), strict=True):
        for column, called, line in CURVES:
            values = history[column]
            axes.plot(1e3 * history["time_s"], values, line, color=REFERENCE, label=called)
        if joint.title:
            axes.set_title(joint.title, loc="left", fontweight="bold")
        axes.set(xlabel="time [ms]", ylabel="friction torque [N m]")
        axes.margins(x=0)
        axes.legend()
    return figure
