"""Mechanisms that several tests run."""

from collections.abc import Mapping
from pathlib import Path

import attrs
import numpy as np
from golden_curves import at_nodes

import fenics_ehd as ehd
from fenics_ehd.base.columns import Quantity
from fenics_ehd.multibody.recorded_quantities import JointResult

CRANK, ROD, SPEED = 0.048, 0.16, 500.0
REVOLUTION = 2 * np.pi / SPEED
GOLDEN = Path(__file__).parent / "golden"


def film(radius, width, clearance, viscosity, cells=(40, 4), *, rate=SPEED):
    """A film on a uniform mesh of 9-node elements."""
    grid = ehd.uniform_grid(radius, width, cells, "lagrange")
    return ehd.Film(ehd.FilmParameters(grid, clearance, ehd.Lubricant(viscosity), rate=rate))


def short_films():
    """Big and small end a tenth as wide, with oil a thousand times as viscous: short bearings."""
    return film(22.5e-3, 2.2e-3, 17e-6, 10.0), film(11e-3, 2e-3, 12e-6, 10.0)


def slider_crank(rod, big_end, gudgeon=None, **joint):
    """Crank at constant speed, a rod with ``pin`` and a bore at its origin, piston on a line."""
    bore = "rod.bore" if isinstance(rod, ehd.FlexibleBody) else "rod"
    return ehd.Mechanism(
        bodies={
            "crank": ehd.RigidBody(1.0, 1e-3, {"pin": (CRANK, 0.0)}),
            "rod": rod,
            "piston": ehd.RigidBody(0.5, 1e-3, position=(CRANK + ROD, 0.0)),
        },
        joints={
            "main": ehd.Revolute(("ground", "crank")),
            "big_end": ehd.LubricatedJoint("crank.pin", bore, big_end, **joint),
            "gudgeon": ehd.Revolute(("rod.pin", "piston"))
            if gudgeon is None
            else ehd.LubricatedJoint("piston", "rod.pin", gudgeon),
            "cylinder": ehd.Slider("ground", "piston"),
        },
        drives={"crank": ehd.Speed(SPEED)},
    )


def rigid_rod(**changes):
    """The paper's rod."""
    rod = ehd.RigidBody(
        0.973, 4e-3, {"pin": (ROD, 0.0)}, centre=(0.0677, 0.0), position=(CRANK, 0.0)
    )
    return attrs.evolve(rod, **changes)


def flexible_slider_crank(body, **joint):
    """The paper's machine with a reduced rod, the film on its bore's own cells."""
    bore_film = ehd.Film(
        ehd.FilmParameters(
            ehd.film_grid(body.pressure_nodes), 17e-6, ehd.Lubricant(0.01), rate=SPEED
        )
    )
    rod = ehd.FlexibleBody(body, 1e-3, position=(CRANK, 0.0))
    return slider_crank(rod, bore_film, **joint)


def simulated_at_nodes(mechanism, end=None, **options):
    """A run, its largest pressures and thinnest films taken at nodes, as old curves have them."""
    samples = []
    result = ehd.simulate(
        mechanism, end, **options, progress=lambda step: samples.append(at_nodes(step))
    )
    rows = samples[-len(result.time) :]
    return result.changed({path: np.array([row[path] for row in rows]) for path in rows[0]})


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


def recorded(time, coordinates, rates, quasi_static, pressures):
    """A run that left these."""
    state = {"coordinates": coordinates, "rates": rates, "quasi_static": quasi_static}
    values = {"time": time} | {f"state/{name}": own for name, own in state.items()}
    values |= {f"joints/{name}/film/pressure": own for name, own in pressures.items()}
    return ehd.History({path: Quantity(own, "1") for path, own in values.items()})
