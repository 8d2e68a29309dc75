"""Settings of the loaded-journal scene; the defaults are a main bearing of a small engine."""

from __future__ import annotations

import attrs

from fenics_ehd import quantities
from fenics_ehd.lengths import metres, radial_clearance
from fenics_ehd.scenes.sizes import film_cells
from fenics_ehd.settings import choice, count, number, rows, section, text

ELEMENTS = ("lagrange", "serendipity", "bilinear")
CAVITATION = ("reynolds", "mass-conserving")
INTERPOLATIONS = ("cubic", "linear")


@attrs.frozen
class Bearing:
    """Round shaft in a round bore, both rigid and parallel."""

    radius: float = metres(0.025, "of the bore [m]")
    width: float = metres(0.02, "[m]")
    clearance: float = radial_clearance(25e-6)
    viscosity: float = quantities.viscosity(0.01)
    shaft_speed: float = quantities.speed(300.0, "in the frame of the load, + from x to y [rad/s]")
    bore_speed: float = quantities.speed(0.0, "of the bearing in the frame of the load [rad/s]")
    ambient_pressure: float = number(
        0.0,
        "at both sides, above that at which the film cavitates [Pa]",
        least=0,
        usual=(1e3, 1e9),
        example="1e5 for 1 bar",
    )
    grooves: tuple[tuple[float, ...], ...] = rows(
        ("angle", "width", "pressure"),
        "axial grooves [angle from x in degrees, width in degrees, pressure in Pa]",
    )


@attrs.frozen
class Film:
    """Film mesh and cavitation condition."""

    cells: tuple[int, ...] = film_cells((40, 8), "cells around and along")
    element: str = choice(
        "lagrange", ELEMENTS, "9-node (lagrange), 8-node (serendipity) or bilinear"
    )
    cavitation: str = choice(
        "reynolds",
        CAVITATION,
        "p >= 0 with free boundaries, or oil kept account of (bilinear cells, oil under pressure)",
    )


@attrs.frozen
class Load:
    """Force on the shaft, over and over."""

    file: str = text(
        "single-cylinder", "CSV file (time_s,Fx_N,Fy_N); or the built-in main-bearing load"
    )
    scale: float = number(1.0, "factor on the forces", above=0, below=1e9)
    interpolation: str = choice("cubic", INTERPOLATIONS, "periodic spline between the rows")
    period: float = number(
        0.0, "[s]; 0: the last time of the file, whose load is the first", least=0
    )


@attrs.frozen
class Time:
    """Integration in time, cycle after cycle until the orbit repeats."""

    tolerance: float = number(
        5e-5, "local error of a step, relative change of the gap", above=1e-12, below=1
    )
    order: int = count(
        2,
        "of the backward differentiation formula, 1 to 3; mass-conserving: 1 always, as its oil",
        least=1,
        most=3,
    )
    first_step: float = number(1e-6, "of every cycle [s]", above=0)
    smallest_step: float = number(1e-13, "[s]", above=0)
    largest_step: float = number(0.02, "share of the period", above=0, below=1)
    periodicity: float = number(
        1e-4,
        "largest change of the gap, and of the oil, from cycle to cycle, relative",
        above=0,
        below=1,
    )
    cycles: int = count(20, "give up after so many", least=1)


@attrs.frozen
class Start:
    """Where the shaft's centre starts, as a share of the clearance."""

    eccentricity_x: float = number(0.0, "[-]", above=-1, below=1)
    eccentricity_y: float = number(0.0, "[-]", above=-1, below=1)


@attrs.frozen
class LoadedJournalSettings:
    """The whole scene."""

    scene: str = choice("loaded-journal", ("loaded-journal",), "kind of scene")
    bearing: Bearing = section(Bearing)
    film: Film = section(Film)
    load: Load = section(Load)
    time: Time = section(Time)
    start: Start = section(Start)
