"""What there is to draw of a run, by the name of its picture."""

from __future__ import annotations

from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np
from matplotlib.figure import Figure

from fenics_ehd.base.pictures import PICTURES
from fenics_ehd.plotting.bores import Bores
from fenics_ehd.plotting.curves import Curves, Panel, Rows, mean
from fenics_ehd.plotting.maps import Map, least, most
from fenics_ehd.plotting.paths import Paths, load, orbit
from fenics_ehd.plotting.picture import FILMS, PRESSURES
from fenics_ehd.plotting.shown import STORED, ShownJoint


class Picture(Protocol):
    """One picture of one or more runs."""

    def has(self, joint: ShownJoint) -> bool:
        """Whether there is anything to draw of a joint."""

    def draw(self, rows: Rows) -> Figure:
        """Of joints by name, each of one or more runs."""


@runtime_checkable
class Subtractable(Protocol):
    """One that has a difference of two runs."""

    def difference(self, rows: Rows) -> Figure:
        """Of joints by name, the second run less the first."""


_BY_NAME: dict[str, Picture] = {
    "max_pressure": Curves(
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
    "min_film_thickness": Curves(
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
    "orbit": Paths(
        "eccentricity / clearance",
        orbit,
        ("eccentricity_in_bore_x_m", "eccentricity_in_bore_y_m", "eccentricity_ratio"),
        "clearance",
    ),
    "force": Paths("load on the bore [kN]", load, ("force_N", "force_angle_deg")),
    "eccentricity": Curves(
        (Panel("eccentricity / clearance", {"eccentricity_ratio": ""}, 1.0, np.argmax),),
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
                "power [W]",
                {
                    "dissipated_power_W": "dissipated",
                    "contact_power_W": "touching asperities",
                },
                mean=True,
            ),
        ),
    ),
    "flow": Curves((Panel("flow of oil [cm³/s]", {"*flow_m3_per_s": ""}, 1e6, mean=True),)),
    "contact": Curves(
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
    "oil_content": Curves(
        (Panel("oil in the film [mm³]", {"oil_content_m3": ""}, 1e9, mean=True),)
    ),
    "basis_error": Curves(
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
    "error_budget": Curves(
        (
            Panel(
                "pressure error [% of the peak]", {"*.pressure_error": ""}, 100.0, scale="linear"
            ),
            Panel("film error [%]", {"*.film_error": ""}, 100.0, scale="linear"),
        ),
    ),
    "pressure_map": Map(
        "largest pressure [MPa]",
        "pressure",
        most,
        1e-6,
        PRESSURES,
        ("max_pressure_Pa", "max_pressure_angle_deg", "max_pressure_height_m"),
    ),
    "film_map": Map(
        "least film thickness [µm]",
        "gap",
        least,
        1e6,
        FILMS,
        ("min_film_thickness_m", "min_film_angle_deg", "min_film_height_m"),
    ),
    "contact_map": Map("mean contact pressure [MPa]", "contact", mean, 1e-6, PRESSURES),
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
        whole=True,
    ),
}

#: In the order in which they are drawn.
QUANTITIES = MappingProxyType({name: _BY_NAME[name] for name in PICTURES})

#: Those that `fenics-ehd run` draws: what needs no more than its history.
OF_EVERY_RUN = tuple(n for n, q in QUANTITIES.items() if isinstance(q, Curves | Paths))
