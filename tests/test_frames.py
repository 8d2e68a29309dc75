"""What a film answers does not depend on the frame, on names, or on units.

One small machine, a shaft in a bearing under a load at rest and one that turns with it, is seen in
other ways. Every film model must say the same of it.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import attrs
import numpy as np
import pytest
from film_cases import oval
from oil_cases import conserved as oil_kept
from rough_cases import surfaces

import fenics_ehd as ehd
from fenics_ehd.multibody.contact import JointContact
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.quantities import joint_row
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm

#: c / R, 5e-4, is what thin-film equations leave out.
R, C, WIDTH, ETA, OMEGA = 0.02, 10e-6, 0.02, 0.01, 300.0
LOAD = 6 * ETA * OMEGA * (R / C) ** 2 * R * WIDTH


@dataclass(frozen=True)
class View:
    """A way to see the machine.

    `sense` of rotation; `spin` of the frame over the shaft's speed; units of length, time and
    viscosity; whether the bearing is called the journal.
    """

    exchanged: bool = False
    sense: int = 1
    spin: float = 0.0
    length: float = 1.0
    time: float = 1.0
    viscosity: float = 1.0

    @property
    def pressure(self):
        return self.viscosity / self.time

    def seen(self, angle):
        """Of a place on either body: inside out, gaps are on the other side."""
        return self.sense * angle + np.pi * self.exchanged


VIEWS = {
    "as it is": View(),
    "exchange": View(exchanged=True),
    "mirror": View(sense=-1),
    "turning frame": View(spin=1.0),
    "similarity": View(length=3.0, time=0.5, viscosity=0.5),
}


def oil(v, **laws):
    return ehd.Lubricant(ETA * v.viscosity, **laws)


def conserved(v, **more):
    return {
        "family": "bilinear",
        "cells": (64, 8),
        "sides": ehd.Sides(1e5 * v.pressure, 1e5 * v.pressure),
        "joint": oil_kept(ambient="oil"),
    } | more


def compressible(v):
    # No step is short enough for the first film of a shaft without mass.
    return conserved(v, mass=0.5, oil=oil(v, density_law=ehd.DowsonHigginson()))


def groove(v):
    """Of the bearing, which is the journal when they are exchanged."""
    feed = ehd.AxialGrooveSupply(
        name="inlet",
        on="journal" if v.exchanged else "bore",
        angle=np.degrees(v.seen(2.0)),
        extent=50,
        length=0.6 * WIDTH * v.length,
        pressure=2e5 * v.pressure,
    )
    return {"feeds": (feed,), "cells": (40, 5)}


def rough(v):
    """The shaft the rougher one."""
    own = surfaces(0.4e-6 * v.length, 0.2 if v.exchanged else 0.8)
    stiff = attrs.evolve(own, modulus=own.modulus * v.pressure)
    return {"surfaces": stiff, "load": 0.4}


def worn(v):
    """Twice as rough under more load: the gap is two to three times the roughness."""
    own = surfaces(0.8e-6 * v.length, 0.2 if v.exchanged else 0.8)
    return {"surfaces": attrs.evolve(own, modulus=own.modulus * v.pressure), "load": 0.6}


def shaped(v):
    # What opens the gap of a bearing closes that of a journal.
    size = (-1 if v.exchanged else 1) * C * v.length
    bearing = oval(0.15 * size, v.seen(0.4), 2)
    shaft = oval(0.05 * size, v.seen(-0.3), 3)
    names = ("journal_shape", "bore_shape") if v.exchanged else ("bore_shape", "journal_shape")
    return {"joint": dict(zip(names, (bearing, shaft), strict=True))}


def warm(v):
    # One oil: heat alone is measured in other units.
    own = ehd.Oil(46.0, 6.645, specific_heat=2000.0 * v.pressure)
    return {
        "oil": ehd.Lubricant.of(own, 60.0),
        "joint": {"heat": ehd.Heat(supply_temperature=60.0, tolerance=1e-3)},
    }


#: Parameters of films by the view, and the units that they keep: laws with pressures of their own
#: that of pressure, one oil that of viscosity. Three models are quick.
PLAIN = ("time", "viscosity")
QUICK = ("streamers", "supply", "shapes")
MODELS = {
    "full": (lambda v: {"joint": {"shear_rule": "full"}}, ()),
    "streamers": (lambda v: {}, ()),
    "none": (lambda v: {"joint": {"shear_rule": "none"}}, ()),
    "bilinear": (lambda v: {"family": "bilinear", "cells": (64, 10)}, ()),
    "8-node": (lambda v: {"family": "serendipity"}, ()),
    "Barus": (lambda v: {"oil": oil(v, viscosity_law=ehd.Barus(2e-8 / v.pressure))}, ()),
    "Roelands": (lambda v: {"oil": oil(v, viscosity_law=ehd.Roelands(ETA))}, PLAIN),
    "Cross": (lambda v: {"oil": oil(v, shear_law=ehd.Cross(3e5 / v.time))}, ()),
    "heat": (warm, ("viscosity",)),
    "conserved": (conserved, ()),
    "compressible": (compressible, PLAIN),
    "supply": (groove, ()),
    "contact": (rough, ()),
    "worn": (worn, ()),
    "shapes": (shaped, ()),
}


def machine(name, view):
    """The machine as a view has it, and its period."""
    model, kept = MODELS[name]
    view = replace(view, **dict.fromkeys(kept, 1.0))
    values = {"family": "lagrange", "cells": (40, 4), "oil": oil(view), "load": 0.15, "joint": {},
              "mass": 0.0}  # fmt: skip
    values |= model(view)
    family, cells, lubricant, load, joint, mass = (values.pop(key) for key in list(values)[:6])
    size, speed = view.length, view.sense * OMEGA / view.time
    grid = ehd.uniform_grid(R * size, WIDTH * size, cells, family)
    film = ehd.Film(ehd.FilmParameters(grid, C * size, lubricant, OMEGA / view.time, **values))
    inertia = mass * view.pressure * size * view.time**2
    bodies = {"shaft": ehd.RigidBody(inertia, 0.0), "bearing": ehd.MasslessBody()}
    pair = ("bearing", "shaft") if view.exchanged else ("shaft", "bearing")
    joints = {
        "held": ehd.Revolute(("ground", "bearing")),
        "film": ehd.LubricatedJoint(*pair, film, friction=True, **joint),
    }
    turning = view.spin * speed
    force = load * LOAD * view.pressure * size**2
    return (
        ehd.Mechanism(
            bodies,
            joints,
            {"shaft": ehd.Speed(speed + turning), "bearing": ehd.Speed(turning)},
            {
                "at rest": ehd.RotatingForce("shaft", force, turning),
                "turning": ehd.RotatingForce("shaft", 0.6 * force, speed + turning),
            },
        ),
        2 * np.pi * view.time / OMEGA,
        view,
    )


@cache
def answer(name, way):
    """Power dissipated, torques on shaft and bearing, temperature, extremes, without units."""
    mechanism, period, view = machine(name, VIEWS[way])
    steps = {"tolerance": 2e-4, "order": 2, "first": 1e-6 * view.time}
    if name == "heat":
        found = ehd.simulate(mechanism, period=period, periodicity=5e-4, **steps)
    else:
        # What touches grows with the last nanometres of an extreme: worn ones end before they do.
        end = (0.3 if name == "worn" else 0.4 if name in QUICK else 0.7) * period
        found = ehd.simulate(mechanism, end, largest=0.02, **steps)
    figures, own = found.figures["film"], found.joints["film"]
    torques = [figures[f"mean_{body}friction_torque_Nm"] for body in ("", "bore_")]
    torque = view.pressure * view.length**3
    return {
        "power": figures["mean_friction_power_W"] * view.time / torque,
        "torque on the shaft": abs(torques[view.exchanged]) / torque,
        "torque on the bearing": abs(torques[not view.exchanged]) / torque,
        "temperature": figures.get("outlet_temperature_C", 0.0),
        "pressure": own.max_pressure.max() / view.pressure,
        "film": own.min_film_thickness.min() / view.length,
    }


#: What is seen in another way is the same film on the same mesh, and in a turning frame bodies that
#: have masses take other steps. In the exchange the mesh turns with the other body: c / R, mesh and
#: steps are left, in extremes of coarse nodes most.
LIMITS = {"exchange": 1e-3, "turning frame": 1e-4, "mirror": 1e-9, "similarity": 1e-9}

CASES = [
    pytest.param(name, way, marks=[] if name in QUICK else pytest.mark.slow, id=f"{name}-{way}")
    for name in MODELS
    for way in list(VIEWS)[1:]
]


@pytest.mark.parametrize(("name", "way"), CASES)
def test_the_film_does_not_know_who_looks(name, way):
    seen, here = answer(name, way), answer(name, "as it is")
    off = {key: abs(seen[key] / value - 1) for key, value in here.items() if value}
    if way == "exchange":
        assert max(off.pop(key) for key in ("pressure", "film")) < 1e-2
    assert max(off.values()) < LIMITS[way], off


def rubbing(exchanged, friction):
    """Shaft at rest in its bearing under a load of which asperities carry 0.32.

    Share of the contact, its force, power, thinnest film, and the shaft's place over the clearance.
    """
    grid = ehd.uniform_grid(R, WIDTH, (40, 4), "lagrange")
    rough = surfaces(0.8e-6, 0.2 if exchanged else 0.8, friction=abs(friction))
    # Less than none is no setting: the same force, reversed.
    object.__setattr__(rough, "boundary_friction", friction)
    film = ehd.Film(ehd.FilmParameters(grid, C, ehd.Lubricant(3.3e-4), OMEGA, surfaces=rough))
    start = 0.9 * C * np.array([np.cos(0.5), np.sin(0.5)])
    pair, seen, rate = ("shaft", "bearing"), start, (0.0, 0.0)
    if exchanged:
        pair, seen = pair[::-1], -start
        rate = (OMEGA * seen[1], -OMEGA * seen[0])
    joint = ehd.LubricatedJoint(
        *pair, film, friction=True, eccentricity=tuple(seen), eccentricity_rate=rate
    )
    found = ehd.equilibrium(
        ehd.Mechanism(
            {"shaft": ehd.RigidBody(1.0, 1e-3, position=start), "bearing": ehd.MasslessBody()},
            {"held": ehd.Revolute(("ground", "bearing")), "film": joint},
            {"shaft": ehd.Speed(OMEGA), "bearing": ehd.Speed(0.0)},
            {"load": ehd.PointForce("shaft", (1.0, 0.0), lambda _: (5000.0, 0.0))},
        )
    )
    row = joint_row(found.joints()["film"])
    names = ("contact_share", "contact_force_N", "friction_power_W", "min_film_thickness_m")
    place = found.z[found.system.bodies["shaft"]][:2] / C
    return np.array([row[name] for name in names]), place


def test_boundary_friction_breaks_the_exchange_by_its_own_force():
    """It pushes the journal's centre aside; inside out the side that touches is the other one."""
    plain, place = rubbing(exchanged=False, friction=0.0)
    inside_out, other_place = rubbing(exchanged=True, friction=0.0)
    assert plain[0] == pytest.approx(0.32, abs=0.01)
    np.testing.assert_allclose(inside_out, plain, rtol=1e-3)
    np.testing.assert_allclose(other_place, place, atol=1e-3)
    rubbed, pushed = rubbing(exchanged=False, friction=0.1)
    other, other_pushed = rubbing(exchanged=True, friction=0.1)
    off = np.abs(other / rubbed - 1.0)
    assert (off[1:] > 5e-3).all()
    assert off.max() < 0.03
    # Aside, and by as much to the other side.
    assert (pushed - place)[1] < -0.02
    np.testing.assert_allclose(other_pushed - place, place - pushed, atol=3e-3)


def test_with_boundary_friction_reversed_the_exchange_holds(monkeypatch):
    create = JointContact.__init__

    def with_friction(self, place):
        create(self, place)
        self.friction = True

    monkeypatch.setattr(JointContact, "__init__", with_friction)
    (share, force, _, film), place = rubbing(exchanged=False, friction=0.1)
    (own_share, own_force, _, own_film), own_place = rubbing(exchanged=True, friction=-0.1)
    np.testing.assert_allclose([own_share, own_force, own_film], [share, force, film], rtol=1e-3)
    np.testing.assert_allclose(own_place, place, atol=1e-3)


@pytest.mark.parametrize("held", ["bore", "journal"])
def test_what_is_held_at_an_angle_is_seen_from_there(held):
    def gap(angle):
        part = ehd.load_body(Path(__file__).parent / "golden/house/rod-m4.h5")
        rod = ehd.FlexibleBody(replace(part, frame="clamped"), angle=angle)
        other = ehd.RigidBody(mass=1.0, inertia=1e-3, angle=angle + 30.0)
        grid = ehd.uniform_grid(0.0225, 0.022, (20, 4))
        film = ehd.Film(ehd.FilmParameters(grid, C, ehd.Lubricant(ETA), OMEGA))
        markers = ("shaft", "rod.bore") if held == "bore" else ("rod.bore", "shaft")
        joint = ehd.LubricatedJoint(*markers, film, journal_shape=oval(3e-6, 0.3))
        system = System(ehd.Mechanism({"rod": rod, "shaft": other}, {"bearing": joint}))
        equations = StepEquations(system)
        norm, patterns = StepNorm(equations), np.zeros(equations.responses.size)
        z, rates = system.rough_pose
        observed = norm.observe(np.concatenate([z, patterns]))
        return system.films[0].gap(z, rates, 0.0), norm.gaps(observed)

    (level, observed), (turned, observed_turned) = gap(0.0), gap(70.0)
    assert np.ptp(level.thickness) > 5e-6
    assert np.abs(turned.thickness - level.thickness).max() < 1e-12 * C
    assert np.abs(observed_turned - observed).max() < 1e-12 * C
    assert observed.min() == pytest.approx(level.thickness.min(), rel=0.05)
    assert np.degrees(turned.turn - level.turn) == pytest.approx(0.0, abs=1e-9)
