"""Mechanisms that several tests run."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from fenics_ehd.film import Film, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.film.layout import film_grid
from fenics_ehd.multibody.flexible_body import FlexibleBody
from fenics_ehd.multibody.joints import Revolute, Slider, Speed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.result import JointResult
from fenics_ehd.multibody.rigid_body import RigidBody

CRANK, ROD, SPEED = 0.048, 0.16, 500.0
REVOLUTION = 2 * np.pi / SPEED
GOLDEN = Path(__file__).parent / "golden"


def film(radius, width, clearance, viscosity, cells=(40, 4)):
    """A film on a uniform mesh of 9-node elements."""
    grid = uniform_grid(radius, width, cells, "lagrange")
    return Film(FilmParameters(grid, clearance, Lubricant(viscosity), rate=SPEED))


def short_films():
    """Big and small end a tenth as wide, with oil a thousand times as viscous: short bearings."""
    return film(22.5e-3, 2.2e-3, 17e-6, 10.0), film(11e-3, 2e-3, 12e-6, 10.0)


def slider_crank(rod, big_end, gudgeon=None, **joint):
    """Crank at constant speed, a rod with ``pin`` and a bore at its origin, piston on a line."""
    bore = "rod.bore" if isinstance(rod, FlexibleBody) else "rod"
    return Mechanism(
        bodies={
            "crank": RigidBody(1.0, 1e-3, {"pin": (CRANK, 0.0)}),
            "rod": rod,
            "piston": RigidBody(0.5, 1e-3, position=(CRANK + ROD, 0.0)),
        },
        joints={
            "main": Revolute("ground", "crank"),
            "big_end": LubricatedJoint("crank.pin", bore, big_end, **joint),
            "gudgeon": Revolute("rod.pin", "piston")
            if gudgeon is None
            else LubricatedJoint("piston", "rod.pin", gudgeon),
            "cylinder": Slider("ground", "piston"),
        },
        drives={"crank": Speed(SPEED)},
    )


def rigid_rod(**changes):
    """The paper's rod."""
    rod = RigidBody(0.973, 4e-3, {"pin": (ROD, 0.0)}, centre=(0.0677, 0.0), position=(CRANK, 0.0))
    return replace(rod, **changes)


def flexible_slider_crank(body, **joint):
    """The paper's machine with a reduced rod, the film on its bore's own cells."""
    bore_film = Film(
        FilmParameters(film_grid(body.pressure_nodes), 17e-6, Lubricant(0.01), rate=SPEED)
    )
    rod = FlexibleBody(body, 1e-3, position=(CRANK, 0.0))
    return slider_crank(rod, bore_film, **joint)


def deviation(name, time, joint: JointResult, start=2e-4) -> Mapping[str, float]:
    """Largest difference from a golden curve, pressure over its peak and film pointwise."""
    golden = np.genfromtxt(GOLDEN / f"{name}.csv", delimiter=",", names=True)
    if "cycle" in golden.dtype.names:
        golden = golden[golden["cycle"] == golden["cycle"].max()]
    clock = golden["cycle_time_s" if "cycle_time_s" in golden.dtype.names else "time_s"]
    late = time > start
    pressure, film_thickness = (
        np.interp(time[late], clock, golden[column])
        for column in ("max_pressure_Pa", "min_film_thickness_m")
    )
    peak = golden["max_pressure_Pa"].max()
    return {
        "pressure": float(np.abs(joint.max_pressure[late] - pressure).max() / peak),
        "film": float(np.abs(joint.min_film_thickness[late] / film_thickness - 1).max()),
    }
