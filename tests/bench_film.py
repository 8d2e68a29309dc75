"""What tests take of films below the public names."""

# ruff: noqa: F401

from fenics_ehd.base.fields import FILM_ELEMENTS
from fenics_ehd.film import cavitation, rough_surfaces
from fenics_ehd.film.assembly import GAUSS_POINTS, Assembly
from fenics_ehd.film.cavitation import CavitationResult, verify_complementarity
from fenics_ehd.film.film import FilmState
from fenics_ehd.film.forces import FilmFlows, film_fields
from fenics_ehd.film.grid import aligned_grid, film_layout, match
from fenics_ehd.film.heat import TemperatureSearch
from fenics_ehd.film.kinematics import Gap, SurfacePoints
from fenics_ehd.film.lubricant import (
    GRADES,
    LARGEST,
    SMALLEST,
    Constant,
    WaltherLine,
    grade_name,
    make_lubricant,
    oil_of_grade,
)
from fenics_ehd.film.oil_balance import OilBalance, Strips, Transport
from fenics_ehd.film.parameters import EDGES, Feeds
from fenics_ehd.film.rough_surfaces import APART, seven_halves
from fenics_ehd.film.transfer import (
    Mortar,
    Surface,
    interpolation_matrix,
    mean_value,
    outward_displacement,
    overlay,
    solid_share,
    triangle_rule,
    unwrap,
)
from fenics_ehd.film.weak_form import compiled

#: From the lowest order to the highest.
FAMILIES = FILM_ELEMENTS[::-1]
