"""Settings of the rotor scene; the defaults are Table 2 of the paper, read as in docs/rotor.md."""

from __future__ import annotations

import attrs

from fenics_ehd import quantities
from fenics_ehd.lengths import LARGEST_LENGTH, metres, radial_clearance
from fenics_ehd.scenes import part_settings
from fenics_ehd.scenes import slider_crank_settings as rod
from fenics_ehd.settings import choice, count, number, numbers, section, text


@attrs.frozen
class Shaft:
    """Round shaft of Bernoulli beam elements on two end springs, turning at constant speed."""

    length: float = metres(1.0, "[m]", below=100)
    diameter: float = metres(
        0.045, "that of the housing's bore, within 1 % [m]", below=2 * LARGEST_LENGTH
    )
    speed: float = quantities.speed(600.0, "angular speed [rad/s]", above=0)
    youngs_modulus: float = quantities.youngs_modulus(210e9)
    density: float = quantities.density(7446.0)
    support_stiffness: float = number(
        1.58e8,
        "of the spring at either end [N/m]",
        above=0,
        usual=(1e4, 1e13),
        example="1e8 for 100 N/um",
    )
    elements: int = count(20, "beam elements, of equal length", least=1)
    modes: int = count(20, "modes kept, half of them in either plane: an even number", least=2)
    damping_ratio: float = number(1e-3, "zeta of every mode [-]", least=0, below=1)
    revolutions: float = number(1.0, "to simulate", above=0)


@attrs.frozen
class Disk:
    """Rigid disk on the shaft."""

    position: float = number(0.5, "share of the shaft's length", least=0, below=1)
    mass: float = quantities.mass(0.8, "[kg]", 1e4)
    polar_inertia: float = number(1e-3, "about the shaft's axis [kg m2]", least=0)
    diametral_inertia: float = number(5e-4, "about a diameter [kg m2]", least=0)


@attrs.frozen
class Force:
    """Force that turns with the rotor, along x at the start."""

    amplitude: float = number(3600.0, "[N]", above=0, usual=(1e-3, 1e8), example="3600 for 3.6 kN")
    position: float = number(0.75, "share of the shaft's length", least=0, below=1)
    ramp: float = number(0.0, "revolutions over which it grows, 0: there from the start", least=0)


@attrs.frozen
class Bearing:
    """Bearing around the shaft; radius and width are those of the housing's bore."""

    position: float = number(0.5, "of its mid-width, share of the shaft's length", above=0, below=1)
    clearance: float = radial_clearance(17e-6)
    viscosity: float = quantities.viscosity(0.01)
    smallest_film: float = number(
        0.01, "film thickness at which the run ends, share of the clearance", least=0, below=1
    )


@attrs.frozen
class Housing:
    """Housing, held at its foot: Gmsh model and material."""

    model: str = text("housing", "shipped model, or a .geo file, which is a program, or .msh")
    element: str = choice(
        "serendipity",
        part_settings.ELEMENTS,
        "of hexahedra, 20-node (serendipity) or 27-node (lagrange)",
    )
    youngs_modulus: float = quantities.youngs_modulus(210e9)
    poissons_ratio: float = number(0.3, "[-]; quadratic elements lock above", above=-1, below=0.49)
    density: float = quantities.density(7850.0)
    damping_time: float = quantities.damping_time(0.0)
    geometry: dict = numbers("parameters of the Gmsh model by name, wall = 0.01 say")


@attrs.frozen
class Reduction(part_settings.Reduction):
    """Reduction of the housing."""

    modes: int = count(30, "fixed-interface modes (m1, m2)", least=1)
    vibration_modes: int = count(10, "vibration modes n_v of the held housing (m3, m4, full)")
    residual_modes: int = count(20, "residual modes n_r (m3)")
    pressure_set: str = choice(
        "pc1", part_settings.PRESSURE_SETS, "unit pressures (34), shapes (35) without tilt (m3)"
    )
    selection: str = choice(
        "largest-eigenvalue", part_settings.SELECTIONS, "which residual modes are kept (m3)"
    )


@attrs.frozen
class Time(rod.Time):
    """Integration in time."""

    order: int = count(
        2,
        "of the backward differentiation formula, 1 to 3; 3 feeds modes without damping",
        least=1,
        most=3,
    )
    first_step: float = number(1e-6, "[s]; the film builds up from zero eccentricity", above=0)
    largest_step: float = number(7.2, "[degrees of shaft rotation]", above=0)


@attrs.frozen
class RotorSettings:
    """The whole scene."""

    scene: str = choice("rotor", ("rotor",), "kind of scene")
    shaft: Shaft = section(Shaft)
    disk: Disk = section(Disk)
    force: Force = section(Force)
    bearing: Bearing = section(Bearing)
    housing: Housing = section(Housing)
    reduction: Reduction = section(Reduction)
    film: part_settings.Film = section(part_settings.Film)
    time: Time = section(Time)
