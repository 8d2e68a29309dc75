"""Pictures of runs by the name of their quantity, for selected joints of one or more runs.

Imports inside functions: pictures of runs need neither films nor rotor maps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.figure import Figure

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.columns import DIMENSIONLESS, split_unit
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import near_names
from fenics_ehd.multibody.history import History
from fenics_ehd.plotting.curves import Curves, Panel, Paths, Rows, load, orbit
from fenics_ehd.plotting.maps import Bores, Map
from fenics_ehd.plotting.picture import FILMS, PRESSURES, SETTINGS, plt, save_in_formats
from fenics_ehd.plotting.shown import STORED, ShownJoint, ShownRun

if TYPE_CHECKING:
    from fenics_ehd.analysis.bearing import BearingResult
    from fenics_ehd.analysis.rotor_map import RotorMap
    from fenics_ehd.scenes.bearing_map import BearingMap

#: Type of the runs of a figure: one, several in a sequence, or several by name.
Run = str | Path | History
Runs = Run | Sequence[Run] | Mapping[str, Run]

#: Type of a picture of joints.
Picture = Curves | Paths | Map | Bores

#: Pictures by the name of their quantity, in the order of `fenics_ehd.base.files.PICTURES`.
QUANTITIES: dict[str, Picture] = {
    "max_pressure": Curves(
        (
            Panel(
                "peak oil film pressure, POFP [MPa]",
                {"max_pressure_Pa": ""},
                np.argmax,
                budget="max_pressure",
            ),
        ),
    ),
    "min_film_thickness": Curves(
        (
            Panel(
                "minimum oil film thickness, MOFT [µm]",
                {"min_film_thickness_m": ""},
                np.argmin,
                budget="min_film_thickness",
            ),
        ),
    ),
    "orbit": Paths(
        "eccentricity / clearance",
        orbit,
        ("eccentricity_in_bore_x_m", "eccentricity_in_bore_y_m", "eccentricity_ratio"),
        "clearance",
        of_shaft=True,
    ),
    "force": Paths("load on the bore [kN]", load, ("force_N", "force_angle_deg")),
    "specific_load": Curves(
        (Panel("specific load F / (2 R B) [MPa]", {"specific_load_Pa": ""}, np.argmax),),
    ),
    "eccentricity": Curves(
        (Panel("eccentricity / clearance", {"eccentricity_ratio": ""}, np.argmax),),
    ),
    "places": Curves(
        (
            Panel(
                "angle on the bore [°]",
                {
                    "max_pressure_angle_deg": "peak pressure",
                    "min_film_angle_deg": "minimum film",
                },
                scale="angle",
            ),
        ),
    ),
    "friction": Curves(
        (
            Panel(
                "friction torque [N m]",
                {"friction_torque_Nm": "on the journal", "bore_friction_torque_Nm": "on the bore"},
                mean=True,
            ),
            Panel(
                "friction power loss [W]",
                {
                    "friction_power_W": "of the film",
                    "contact_power_W": "touching asperities",
                },
                mean=True,
            ),
        ),
    ),
    "flow": Curves((Panel("flow of oil [cm³/s]", {"*flow_m3_per_s": ""}, mean=True),)),
    "contact": Curves(
        (
            Panel("contact force [N]", {"contact_force_N": ""}, mean=True),
            Panel("contact pressure [MPa]", {"max_contact_pressure_Pa": "largest"}, np.argmax),
            Panel(
                "shares [%]",
                {"contact_share": "load on asperities", "contact_area_share": "area in contact"},
                mean=True,
            ),
            Panel(
                "film / combined roughness (lambda ratio)",
                {"min_lambda_ratio": ""},
                np.argmin,
            ),
        ),
    ),
    "oil_content": Curves((Panel("oil in the film [mm³]", {"oil_content_m3": ""}, mean=True),)),
    "basis_error": Curves(
        (
            Panel(
                "film, error of the gap [µm]",
                {
                    "min_film_thickness_m": "minimum film thickness",
                    "basis_error_estimate_m": "estimated error of its gap",
                },
                scale="log",
            ),
        ),
        needed="basis_error_estimate_m",
    ),
    "error_budget": Curves(
        (
            Panel("pressure error [% of the peak]", {"*.pressure_error": ""}, scale="linear"),
            Panel("film error [%]", {"*.film_error": ""}, scale="linear"),
        ),
    ),
    "pressure_map": Map(
        "largest pressure [MPa]",
        "pressure",
        PRESSURES,
        np.max,
        ("max_pressure_Pa", "max_pressure_angle_deg", "max_pressure_height_m"),
    ),
    "film_map": Map(
        "least film thickness [µm]",
        "gap",
        FILMS,
        np.min,
        ("min_film_thickness_m", "min_film_angle_deg", "min_film_height_m"),
    ),
    "contact_map": Map("mean contact pressure [MPa]", "contact", PRESSURES),
    "bore": Bores(),
    "energy": Curves(
        (
            Panel(
                "energy, work [J]",
                {
                    STORED: "kinetic and strain energy",
                    "drive_work_J": "drive",
                    "applied_work_J": "applied forces",
                },
                scale="linear",
            ),
            Panel(
                "losses [J]",
                {
                    "film_work_J": "film",
                    "damping_work_J": "structural damping",
                    "drag_work_J": "drag on the oil (gained)",
                },
                scale="linear",
            ),
            Panel("defect [J]", {"energy_defect_J": "defect of the balance"}, scale="linear"),
        ),
        of_run=True,
    ),
}

#: Quantities that `fenics-ehd run` draws: their pictures need the history of the run only.
OF_EVERY_RUN = tuple(n for n, q in QUANTITIES.items() if isinstance(q, Curves | Paths))


def plot_run(directory: str | Path) -> list[Path]:
    """Write the pictures `OF_EVERY_RUN` into the folder of a run, except those without data."""
    pictures = Pictures({"": directory})
    return [path for name in OF_EVERY_RUN for path in pictures.draw(name, directory)]


class Pictures:
    """Pictures of the last cycle of one or more runs.

    Parameters
    ----------
    runs
        Folders or histories of the runs, by their names in legends.
    joints
        Names of the lubricated joints to draw; empty for all.
    difference
        Whether differences are drawn: second run minus first run.
    option
        Form of an argument in messages: ``--{}`` for options of the command.

    Raises
    ------
    InputError
        A folder has no history of a run.
    SettingsError
        A joint does not exist, or a difference is not of two runs with a common joint.
    """

    def __init__(
        self,
        runs: Mapping[str, str | Path | History],
        joints: Sequence[str] = (),
        *,
        difference: bool = False,
        option: str = "--{}",
    ):
        self._option = option
        if difference and len(runs) != 2:
            raise SettingsError(
                f"{option.format('difference')} needs 2 runs, not {len(runs)}: give two directories"
            )
        self._runs = [ShownRun(name, folder) for name, folder in runs.items()]
        self._difference = difference
        self._joints = joints
        rows = self._rows(joints)
        if difference and all(len(same) < 2 for same in rows.values()):
            first, second = (", ".join(run.joints) or "none" for run in self._runs)
            raise SettingsError(
                f"{option.format('difference')}: the runs have no common lubricated joint: {first} "
                f"in the first, {second} in the second"
            )

    @property
    def names(self) -> list[str]:
        """Names of the quantities for which a picture can be drawn."""
        return [name for name in QUANTITIES if self._having(name)]

    def require(self, names: Sequence[str]) -> None:
        """Refuse quantities for which the runs have no data.

        Parameters
        ----------
        names
            Names of quantities, or of columns without units: ``max_pressure`` for all joints,
            ``big_end.max_pressure`` for one.

        Raises
        ------
        SettingsError
            A quantity or joint is unknown; the message has the known ones.
        """
        known = self._joints_of_runs
        option = self._option.format("quantity")
        for name in names:
            joint = name.rpartition(".")[0]
            if joint and joint not in known:
                raise SettingsError(
                    f"{option} {name}: {self._runs[0].origin} has no lubricated joint "
                    f"{joint}: choose from {', '.join(known) or 'none'}"
                )
            quantity, joints = self._selected(name)
            if self._picture(quantity) is None or not self._having(name):
                of = " and ".join(run.origin for run in self._runs)
                whose = f" for {', '.join(joints)}" if joints else ""
                what = "no difference of this quantity" if self._difference else "no such quantity"
                near = near_names(self.names, quantity)
                hint = f"did you mean {' or '.join(near)}? " if near else ""
                raise SettingsError(
                    f"{option} {name}: {what}{whose} in {of}: {hint}choose from "
                    f"{', '.join(self.names)}"
                )

    def full_name(self, name: str) -> str:
        """Name of a quantity with its joint, ``JOINT.QUANTITY``, if the runs have only one joint.

        With several joints, the name is returned unchanged.
        """
        quantity, selected = self._selected(name)
        if selected or len(self._joints_of_runs) != 1 or _is_of_run(quantity):
            return name
        return f"{self._joints_of_runs[0]}.{name}"

    @cached_property
    def _joints_of_runs(self) -> list[str]:
        """Names of the lubricated joints of all runs."""
        return list(dict.fromkeys(joint for run in self._runs for joint in run.joints))

    def _picture(self, quantity: str) -> Picture | None:
        """Picture of a quantity: one of `QUANTITIES`, or the curve of a column of the joints."""
        if quantity in QUANTITIES:
            return QUANTITIES[quantity]
        for joint in chain.from_iterable(run.joints.values() for run in self._runs):
            for column in joint.columns:
                name, unit = split_unit(column)
                if name == quantity:
                    label = name.replace("_", " ") + f" [{unit}]" * (unit != DIMENSIONLESS)
                    panel = Panel(label, {column: ""}, scale="linear", unchanged=True)
                    return Curves((panel,))
        return None

    def _selected(self, name: str) -> tuple[str, Sequence[str]]:
        """Split a name ``JOINT.QUANTITY`` into the quantity and its joint.

        A name ``QUANTITY`` belongs to the joints that were chosen for all pictures.
        """
        joint, _, quantity = name.rpartition(".")
        return quantity, [joint] if joint else self._joints

    def figure(self, name: str) -> Figure | None:
        """Figure of a quantity; None if the runs have no data for it."""
        rows = self._having(name)
        quantity = self._picture(self._selected(name)[0])
        if not rows or quantity is None:
            return None
        with plt.rc_context(SETTINGS):
            if not self._difference:
                return quantity.draw(rows)
            assert isinstance(quantity, Curves | Paths)
            return quantity.difference(
                {_title_of_difference(t, *joints): joints for t, joints in rows.items()}
            )

    def draw(self, name: str, directory: str | Path) -> list[Path]:
        """Draw a quantity, write the picture in each format, and return the paths of the files.

        Files of several runs have other names than files of one run, and do not replace them.
        """
        figure = self.figure(name)
        if figure is None:
            return []
        with plt.rc_context(SETTINGS):
            return save_in_formats(figure, directory, self._file(name))

    def _file(self, name: str) -> str:
        quantity, joints = self._selected(name)
        several = ["difference" if self._difference else "comparison"] * (len(self._runs) > 1)
        return "-".join([quantity, *joints, *several])

    def _rows(self, joints: Sequence[str]) -> Rows:
        """Joints of the runs by name; if every run has only one joint, one entry for all."""
        runs = self._runs
        known = self._joints_of_runs
        for name in joints:
            if name not in known:
                raise SettingsError(
                    f"{self._option.format('joint')} {name}: {runs[0].origin} has no such "
                    f"lubricated joint: choose from {', '.join(known) or 'none'}"
                )
        if not joints and all(len(run.joints) == 1 for run in runs):
            return {" / ".join(known): [joint for run in runs for joint in run.joints.values()]}
        return {
            name: [run.joints[name] for run in runs if name in run.joints]
            for name in joints or known
        }

    def _having(self, name: str) -> Rows:
        """Joints for which a quantity can be drawn, by title; whole runs for a quantity of runs."""
        selected, joints = self._selected(name)
        quantity = self._picture(selected)
        if quantity is None:
            return {}
        rows = self._rows(joints)
        of_run = _is_of_run(selected)
        # The energies of two runs start at different instants.
        if self._difference and (of_run or not isinstance(quantity, Curves | Paths)):
            return {}
        if of_run:
            rows = {"": [run.whole for run in self._runs]}
        drawn = {
            title: [joint for joint in joints if quantity.has(joint)]
            for title, joints in rows.items()
        }
        least = 2 if self._difference else 1
        return {title: joints for title, joints in drawn.items() if len(joints) >= least}


def _is_of_run(quantity: str) -> bool:
    """True if a quantity belongs to a run, such as ``energy``, and not to a joint."""
    picture = QUANTITIES.get(quantity)
    return isinstance(picture, Curves) and picture.of_run


def _title_of_difference(title: str, first: ShownJoint, second: ShownJoint) -> str:
    """Title of a difference: joint, name of the second run, "less", name of the first run."""
    return ": ".join(filter(None, (title, f"{second.run.name} less {first.run.name}")))


def plot(
    runs: Runs | BearingResult | BearingMap | RotorMap,
    quantity: str = "",
    *,
    difference: bool = False,
    speed: float | str | None = None,
) -> Figure:
    """Draw a quantity over the last cycle of one or more runs, as ``fenics-ehd plot`` does.

    Results of bearings and rotor maps are drawn as by ``fenics-ehd bearing`` and ``rotor``.

    Parameters
    ----------
    runs
        History or folder of a run, several of them in a sequence, or several by their names in the
        legend; or a result of `bearing`, `bearing_map` or `rotor_map`.
    quantity
        Name of the quantity, with the joint if only one joint is wanted:
        ``"big_end.min_film_thickness"``. The message about an unknown name lists those that the
        runs have. A rotor map has ``"campbell"``, its default, and others, see `RotorMap.plot`.
    difference
        Whether the difference of two runs is drawn: second run minus first run.
    speed
        Speed of the mode shapes of a rotor map, see `RotorMap.plot` [rad/s], or a text with a unit.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, which a notebook shows; ``figure.savefig("film.png")`` writes it.

    Raises
    ------
    InputError
        A folder has no history of a run.
    SettingsError
        The quantity or its joint is unknown; the message lists the known ones.
    """
    require_class("quantity", quantity, str)
    if not isinstance(runs, str | Path | History | Sequence | Mapping):
        return _closed(_figure_of_result(runs, quantity, speed))
    if speed is not None:
        raise SettingsError(f"speed = {speed!r} has an effect on a rotor map only: drop speed")
    pictures = Pictures(_named(runs), difference=difference, option="{}")
    pictures.require([quantity])
    figure = pictures.figure(quantity)
    assert figure is not None
    return _closed(figure)


def _figure_of_result(
    result: BearingResult | BearingMap | RotorMap, quantity: str, speed: float | str | None
) -> Figure:
    """Draw a result of `bearing`, `bearing_map` or `rotor_map`, see `plot`.

    Raises
    ------
    SettingsError
        The result has no picture of this name, the speed has no effect, or it is no result.
    """
    from fenics_ehd.analysis.bearing import BearingResult
    from fenics_ehd.analysis.rotor_map import RotorMap
    from fenics_ehd.plotting.bearing_map import bearing_map_figure
    from fenics_ehd.plotting.maps import bearing_figure
    from fenics_ehd.plotting.rotor import CAMPBELL, map_figure
    from fenics_ehd.scenes.bearing_map import BearingMap

    require_class("runs", result, str, Path, History, BearingResult, BearingMap, RotorMap)
    if isinstance(result, RotorMap):
        return map_figure(result, quantity or CAMPBELL, speed)
    if quantity or speed is not None:
        raise SettingsError(
            f"quantity = {quantity!r}, speed = {speed!r}: a bearing has one picture: drop both"
        )
    return bearing_map_figure(result) if isinstance(result, BearingMap) else bearing_figure(result)


def _closed(figure: Figure) -> Figure:
    """Lay out a figure and close it; it can still be shown and saved."""
    for _ in range(2):  # titles move as soon as the ticks have their positions
        figure.draw_without_rendering()
    # Else a notebook would show it twice: as a result, and as a figure that is still open.
    plt.close(figure)
    return figure


def _named(runs: Runs) -> dict[str, str | Path | History]:
    """Runs by their names in a legend: names of folders or scenes, or numbers if there are none."""
    if isinstance(runs, Mapping) and runs:
        return dict(runs)
    require_class("runs", runs, str, Path, History, Sequence, Mapping)
    several = [runs] if isinstance(runs, str | Path | History) else list(runs)
    if not several:
        raise SettingsError("runs is empty: give at least one history or folder of a run")
    names = [_name_of(run) for run in several]
    if len(names) == 1:
        names = [names[0] or "the run"]
    if not all(names) or len(set(names)) < len(names):
        names = [f"{name or 'run'} ({number})" for number, name in enumerate(names, 1)]
    return dict(zip(names, several, strict=True))


def _name_of(run: str | Path | History) -> str:
    """Name of a run's folder, or of its scene; empty if it has neither."""
    require_class("runs", run, str, Path, History)
    if isinstance(run, History):
        return run.folder.name if run.folder else str(run.entries.get("scene", ""))
    return Path(run).name or str(run)
