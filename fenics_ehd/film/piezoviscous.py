"""Films of oils whose viscosity grows with pressure, from films of constant viscosity.

With ``dq = dp / r(p)``, r the ratio of viscosities, the Reynolds equation for p becomes
that of constant viscosity for q (Kirchhoff's transformation, known in lubrication as
the reduced pressure). As ``q`` stays below ``int_0^inf dp / r(p)``, 1 / alpha for Barus' law, a
film of constant viscosity with a higher pressure has no counterpart: the viscosity
runs away. Transformed, q is a start from which Newton's method takes a few steps. The same
holds of a film that conserves its oil: where it is not full, p and q are both zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from fenics_ehd.base.errors import CavitationError, ViscosityError
from fenics_ehd.film.film import Film, FilmState
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.lubricant import Constant, PressureLaw
from fenics_ehd.film.mass_conserving import MassConservingFilm

#: The integral of ``dp / r`` is taken up to this ratio of viscosities.
LARGEST_RATIO = 1e9

SAMPLES = 20000


class ReducedPressure:
    """``q(p)`` of a viscosity law, tabulated, and its inverse."""

    def __init__(self, law: PressureLaw):
        top = 1e6
        # Of a coefficient out of range the ratio overflows, and its inverse is the zero that it is.
        with np.errstate(over="ignore"):
            while law(np.array([top]))[0][0] < LARGEST_RATIO and top < 1e13:
                top *= 1.2
            self._pressure = np.append(0.0, np.geomspace(1e-6 * top, top, SAMPLES))
            inverse = 1.0 / law(self._pressure)[0]
        self._reduced = cumulative_trapezoid(inverse, self._pressure, initial=0)

    @property
    def limit(self) -> float:
        """Largest reduced pressure there is [Pa]."""
        return float(self._reduced[-1])

    def pressure(self, reduced: np.ndarray) -> np.ndarray:
        """Pressure of a reduced pressure below `limit` [Pa]."""
        return np.interp(reduced, self._reduced, self._pressure)


class PiezoviscousFilm:
    """A film whose viscosity changes with pressure, solved by way of constant viscosity.

    Parameters
    ----------
    film
        The film.
    options_prefix
        PETSc options of the film of constant viscosity.
    conserving
        Whether the steady film of `MassConservingFilm` is wanted.
    """

    def __init__(self, film: Film, options_prefix: str, *, conserving: bool = False):
        p = film.parameters
        self.film = film
        self._reduced = ReducedPressure(p.lubricant.viscosity_law)
        lubricant = replace(p.lubricant, viscosity_law=Constant(), density_law=Constant())
        constant = Film(replace(p, lubricant=lubricant), options_prefix=options_prefix)
        self._solve: Callable[[Gap, FilmState | None], FilmState] = film.solve
        self._start: Callable[[Gap, FilmState | None], FilmState] = constant.solve
        if conserving:
            self._solve = MassConservingFilm(film).steady
            self._start = MassConservingFilm(constant).steady
        self._last: FilmState | None = None

    def solve(self, gap: Gap) -> FilmState:
        """Pressure for a gap.

        Raises
        ------
        ViscosityError
            The viscosity runs away, or grows too much for the solver.
        """
        self._last = state = self._start(gap, self._last)
        highest = float(state.pressure.max())
        if not highest < self._reduced.limit:
            raise ViscosityError(
                f"the viscosity runs away with the pressure: at constant viscosity the film has "
                f"{highest * 1e-6:.4g} MPa, the pressure law allows less than "
                f"{self._reduced.limit * 1e-6:.4g} MPa: lower load, eccentricity or the coefficient"
            )
        scale = self.film.parameters.pressure_scale
        pressure = self._reduced.pressure(state.pressure)
        start = self._reduced.pressure(scale * state.cavitation.pressure) / scale
        cavitation = replace(state.cavitation, pressure=start)
        guess = replace(state, pressure=pressure, cavitation=cavitation)
        try:
            # An iterate may overflow; whatever comes of it is verified.
            with np.errstate(over="ignore", invalid="ignore"):
                return self._solve(gap, guess)
        except CavitationError as error:
            ratio = float(self.film.parameters.lubricant.viscosity_law(pressure)[0].max())
            raise ViscosityError(
                f"no film found of an oil that thickens up to {ratio:.3g} times with the pressure: "
                f"lower load, eccentricity or the coefficient ({error})"
            ) from None
