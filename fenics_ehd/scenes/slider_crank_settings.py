"""Settings of the slider-crank scene; the defaults are Table 1 of the paper."""

from __future__ import annotations

import attrs

from fenics_ehd import quantities
from fenics_ehd.lengths import metres, radial_clearance
from fenics_ehd.scenes.part_settings import (
    CELLS,
    ELEMENTS,
    Film,
    Reduction,
)
from fenics_ehd.settings import choice, count, flag, number, numbers, section, text

DRIVES = ("speed", "torque")


@attrs.frozen
class Mechanism:
    """Crank at constant speed or under a torque, piston on a line."""

    crank_length: float = metres(0.048, "crank radius [m]")
    crank_speed: float = quantities.speed(
        500.0, "angular speed of the crank, under a torque that at the start [rad/s]", above=0
    )
    drive: str = choice("speed", DRIVES, "whether the crank keeps its speed or is free to change")
    drive_torque: float = number(0.0, "constant part of the torque on a free crank [N m]")
    drive_torque_table: str = text(
        "none", "more torque over the crank angle: CSV file angle_deg,torque_Nm, or none"
    )
    drive_damping: float = number(
        0.0, "torque of a free crank per speed below crank_speed [N m s/rad]", least=0
    )
    crank_inertia: float = number(
        1e-3,
        "of a free crank about its centre of mass [kg m2]",
        above=0,
        usual=(1e-8, 1e3),
        example="1e-3 for 10 kg cm2",
    )
    crank_mass: float = quantities.mass(1.0, "of a free crank [kg]", 1e3)
    crank_centre: float = number(
        0.0, "distance of its centre of mass from its axis, along the crank [m]"
    )
    gas_force: str = text(
        "none", "on the piston, towards the crank's axis: CSV file angle_deg,force_N, or none"
    )
    piston_mass: float = quantities.mass(0.5, "[kg]", 100.0)
    revolutions: float = number(
        1.0, "to simulate, a free crank for as long as they take at crank_speed", above=0
    )


@attrs.frozen
class Bearing:
    """Big-end bearing; radius and width are those of the rod's bore."""

    clearance: float = radial_clearance(17e-6)
    viscosity: float = quantities.viscosity(0.01)
    smallest_film: float = number(
        0.01, "film thickness at which the run ends, share of the clearance", least=0, below=1
    )


@attrs.frozen
class Rod:
    """Connecting rod: Gmsh model and material."""

    model: str = text("conrod", "shipped model, or a .geo file, which is a program, or .msh")
    cells: str = choice("hex", CELLS, "structured hexahedra or unstructured 10-node tetrahedra")
    element: str = choice(
        "serendipity", ELEMENTS, "of hexahedra, 20-node (serendipity) or 27-node (lagrange)"
    )
    youngs_modulus: float = quantities.youngs_modulus(210e9)
    poissons_ratio: float = number(0.3, "[-]; quadratic elements lock above", above=-1, below=0.49)
    density: float = quantities.density(7850.0)
    damping_time: float = quantities.damping_time(1e-3)
    geometry: dict = numbers("parameters of the Gmsh model by name, big_end_wall = 0.0114 say")


@attrs.frozen
class BigEndFilm(Film):
    """The film of the slider-crank."""

    friction: bool = flag(False, "whether the oil's shear acts on rod and crank")


@attrs.frozen
class Start:
    """Shaft in its bore at the start, in the rod's frame; the rod itself is undeformed."""

    eccentricity_x: float = number(0.0, "share of the clearance", above=-1, below=1)
    eccentricity_y: float = number(0.0, "share of the clearance", above=-1, below=1)
    velocity_x: float = number(0.0, "[m/s]")
    velocity_y: float = number(0.0, "[m/s]")


@attrs.frozen
class Time:
    """Integration in time."""

    tolerance: float = number(
        1e-5, "local error of a step, relative change of the gap", above=1e-12, below=1
    )
    order: int = count(
        3,
        "of the backward differentiation formula, 1 to 3; 2 for 3 where modes lack damping",
        least=1,
        most=3,
    )
    first_step: float = number(1e-8, "[s]; the film builds up from zero eccentricity", above=0)
    smallest_step: float = number(1e-13, "[s]", above=0)
    largest_step: float = number(7.2, "[degrees of crank angle]", above=0)


@attrs.frozen
class SliderCrankSettings:
    """The whole scene."""

    scene: str = choice("slider-crank", ("slider-crank",), "kind of scene")
    mechanism: Mechanism = section(Mechanism)
    bearing: Bearing = section(Bearing)
    rod: Rod = section(Rod)
    reduction: Reduction = section(Reduction)
    film: BigEndFilm = section(BigEndFilm)
    start: Start = section(Start)
    time: Time = section(Time)
