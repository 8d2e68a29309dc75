"""What there is to draw of a run, by the name of its picture."""

from __future__ import annotations

from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np
from matplotlib.figure import Figure

from fenics_ehd.plotting.bores import Bores
from fenics_ehd.plotting.curves import Curves, Panel, Rows, mean
from fenics_ehd.plotting.maps import Map, least, most
from fenics_ehd.plotting.paths import Paths, load, orbit
from fenics_ehd.plotting.picture import FILMS, PRESSURES
from fenics_ehd.plotting.shown import STORED, ShownJoint


class Picture(Protocol):
    """One picture of one or more runs."""

    @property
    def name(self) -> str:
        """Of the quantity and of the files."""

    def has(self, joint: ShownJoint) -> bool:
        """Whether there is anything to draw of a joint."""

    def draw(self, rows: Rows) -> Figure:
        """Of joints by name, each of one or more runs."""


@runtime_checkable
class Subtractable(Protocol):
    """One that has a difference of two runs."""

    def difference(self, rows: Rows) -> Figure:
        """Of joints by name, the second run less the first."""


_ALL: tuple[Picture, ...] = (
    Curves(
        "max_pressure",
        (
            Panel(
                "maximum pressure [MPa]",
                {"max_pressure_Pa": ""},
                1e-6,
                np.argmax,
                budget="max_pressure",
            ),
        ),
    ),
    Curves(
        "min_film_thickness",
        (
            Panel(
                "minimum film thickness [µm]",
                {"min_film_thickness_m": ""},
                1e6,
                np.argmin,
                budget="min_film_thickness",
            ),
        ),
    ),
    Paths(
        "orbit",
        "eccentricity / clearance",
        orbit,
        ("eccentricity_in_bore_x_m", "eccentricity_in_bore_y_m", "eccentricity_ratio"),
        "clearance",
    ),
    Paths("force", "load on the bore [kN]", load, ("force_N", "force_angle_deg")),
    Curves(
        "eccentricity",
        (Panel("eccentricity / clearance", {"eccentricity_ratio": ""}, 1.0, np.argmax),),
    ),
    Curves(
        "places",
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
    Curves(
        "friction",
        (
            Panel(
                "friction torque [N m]",
                {"friction_torque_Nm": "on the journal", "bore_friction_torque_Nm": "on the bore"},
                mean=True,
            ),
            Panel(
                "power [W]",
                {
                    "friction_power_W": "friction",
                    "dissipated_power_W": "dissipated",
                    "contact_power_W": "touching asperities",
                },
                mean=True,
            ),
        ),
    ),
    Curves("flow", (Panel("flow of oil [cm³/s]", {"*flow_m3_per_s": ""}, 1e6, mean=True),)),
    Curves(
        "contact",
        (
            Panel("contact force [N]", {"contact_force_N": ""}, mean=True),
            Panel(
                "contact pressure [MPa]", {"max_contact_pressure_Pa": "largest"}, 1e-6, np.argmax
            ),
            Panel(
                "shares [%]",
                {"contact_share": "of the force", "contact_area_share": "of the area"},
                100.0,
                mean=True,
            ),
        ),
    ),
    Curves(
        "oil_content", (Panel("oil in the film [mm³]", {"oil_content_m3": ""}, 1e9, mean=True),)
    ),
    Curves(
        "basis_error",
        (
            Panel(
                "film, error of the gap [µm]",
                {
                    "min_film_thickness_m": "minimum film thickness",
                    "basis_error_estimate_m": "estimated error of its gap",
                },
                1e6,
                scale="log",
            ),
        ),
        needed="basis_error_estimate_m",
    ),
    Curves(
        "error_budget",
        (
            Panel(
                "pressure error [% of the peak]", {"*.pressure_error": ""}, 100.0, scale="linear"
            ),
            Panel("film error [%]", {"*.film_error": ""}, 100.0, scale="linear"),
        ),
    ),
    Map(
        "pressure_map",
        "largest pressure [MPa]",
        "pressure",
        most,
        1e-6,
        PRESSURES,
        ("max_pressure_Pa", "max_pressure_angle_deg", "max_pressure_height_m"),
    ),
    Map(
        "film_map",
        "least film thickness [µm]",
        "gap",
        least,
        1e6,
        FILMS,
        ("min_film_thickness_m", "min_film_angle_deg", "min_film_height_m"),
    ),
    Map("contact_map", "mean contact pressure [MPa]", "contact", mean, 1e-6, PRESSURES),
    Bores("bore"),
    Curves(
        "energy",
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
        whole=True,
    ),
)

#: In the order in which they are drawn.
QUANTITIES = MappingProxyType({quantity.name: quantity for quantity in _ALL})

#: Those that `fenics-ehd run` draws: what needs no more than its history.
OF_EVERY_RUN = tuple(q.name for q in _ALL if isinstance(q, Curves | Paths))
