"""Oil film of one bore: the Reynolds equation, solved for the pressure, and its power losses.

Imports inside functions: the module of `ReynoldsEquation` imports dolfinx, which plots of films do
not need.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from fenics_ehd.base.arguments import require_class, require_number
from fenics_ehd.base.described import Described, names_or_none, value_text
from fenics_ehd.base.errors import (
    CavitationError,
    GapClosedError,
    SettingsError,
    ViscosityError,
)
from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.film.cavitation import CavitationResult, CavitationSolver, Complementarity
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.parameters import FilmParameters
from fenics_ehd.film.rough_surfaces import DEEPEST_ITERATE, RoughSurfaces
from fenics_ehd.film.supply import in_regions

if TYPE_CHECKING:
    from fenics_ehd.film.weak_form import Flow


@dataclass(frozen=True, eq=False)
class FilmState(Described):
    """Solved pressure of a film in one gap, with its cavitated zone and its oil content.

    Attributes
    ----------
    pressure
        Nodal pressure, shape (nodes,) [Pa].
    gap
        Gap at the Gauss points, for which the pressure was computed.
    cavitation
        Dimensionless solution of the complementarity problem, on the nodes of unknown pressure;
        with mass-conserving cavitation, on the nodes `OilBalance.unknown`.
    fluid_fraction
        Share of the gap that is filled with oil, shape (nodes,); None if the cavitation condition
        does not determine this share.
    content
        Oil content of the nodes as a volume at ambient density, shape (nodes,) [m^3]; the next step
        starts from it. None without mass-conserving cavitation.
    outflow
        Flow out of the film at nodes of given pressure, negative for flow into the film, zero at
        all other nodes, shape (nodes,) [m^3/s]. None without mass-conserving cavitation.
    """

    pressure: np.ndarray
    gap: Gap
    cavitation: CavitationResult
    fluid_fraction: np.ndarray | None = None
    content: np.ndarray | None = None
    outflow: np.ndarray | None = None


@renamed_attributes(apart="with_own_temperature")
class Film(Described):
    """Reynolds equation on one bore, solved for one gap after another.

    Nodal arrays are in the order of `FilmGrid.nodes`, values at Gauss points
    have the shape (cells, points).

    Parameters
    ----------
    parameters
        Bearing and oil.
    options_prefix
        Prefix of the PETSc options of SNES-VI, see `CavitationSolver`.
    tolerance
        Tolerance of SNES-VI, see `CavitationSolver`.

    Attributes
    ----------
    equation
        The discrete Reynolds equation.
    points
        Gauss points on the bore.
    free
        Indices of the nodes whose pressure is unknown.
    """

    def __init__(
        self,
        parameters: FilmParameters,
        *,
        options_prefix: str = "film_",
        tolerance: float = 1e-10,
    ):
        require_class("parameters", parameters, FilmParameters)
        require_number("tolerance", tolerance, above=0)
        self.parameters = parameters
        from fenics_ehd.film.reynolds import ReynoldsEquation

        self.equation = ReynoldsEquation(parameters)
        self.assembly = self.equation.assembly
        self.free = self.equation.free
        self.points = self.equation.points
        self.cavitation = CavitationSolver(
            self.equation.pattern,
            weighted=self.equation.weights is not None,
            symmetric=parameters.lubricant.linear,
            options_prefix=options_prefix,
            tolerance=tolerance,
        )

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield mesh, clearance, oil, and the surfaces and supplies of the film."""
        parameters = self.parameters
        yield "Film", f"on {value_text(parameters.grid)}"
        yield "clearance", f"{1e6 * parameters.clearance:.5g} um"
        yield "viscosity", f"{parameters.lubricant.viscosity:.4g} Pa s"
        yield "surfaces", "smooth" if parameters.surfaces is None else "rough"
        grooves = ("axial groove" for _ in parameters.regions)
        feeds = (feed.name for feed in (*parameters.feeds, *parameters.recesses))
        yield "supplies", names_or_none([*grooves, *feeds])

    def with_own_temperature(self) -> Film:
        """Copy of the film; setting its temperature does not change this film."""
        return copy(self)

    def set_temperature(self, temperature: float) -> None:
        """Set the temperature of the oil [C], see `ReynoldsEquation.at_temperature`."""
        self.equation = self.equation.at_temperature(temperature)

    def solve(self, gap: Gap, guess: FilmState | None = None) -> FilmState:
        """Solve for the pressure in a given gap.

        Parameters
        ----------
        gap
            Gap at the Gauss points, shape (cells, points).
        guess
            Earlier state, from whose pressure and active set the iteration starts. Without one, the
            start is a film without pressure, and SNES-VI moves the edge of the cavitated zone by
            about one row of nodes in each iteration.

        Raises
        ------
        GapClosedError
            If the gap is not positive at a Gauss point.
        SettingsError
            If no node has a given pressure.
        CavitationError
            If `CavitationSolver.solve` raises it; the `state` of the error also holds the gap.
        """
        check_gap(gap, self.parameters.surfaces)
        if len(self.free) == self.assembly.size and not self.parameters.feeds:
            raise SettingsError(
                "the film has no node of given pressure, and its pressure is undetermined up to a "
                "constant: open a side or add a groove"
            )
        problem = self.equation.problem(gap)
        start = problem.zero if guess is None else guess.cavitation.pressure
        try:
            result = self._from_either_end(problem, start)
        except CavitationError as error:
            error.state.update({name: getattr(gap, name) for name in Gap.__dataclass_fields__})
            raise
        pressure = self.parameters.pressure_scale * self.equation.nodal(result.pressure)
        return FilmState(pressure, gap, result)

    def _from_either_end(self, problem: Complementarity, start: np.ndarray) -> CavitationResult:
        """Solve a complementarity problem from `start`; if that fails, from a completely full film.

        The second attempt is made only for 8-node cells, whose matrix is no M-matrix: if few nodes
        of the start are full, the active sets may cycle. This occurred at eccentricities of the
        size of round-off, on some processors.
        """
        try:
            return self.cavitation.solve(problem, start)
        except CavitationError:
            if self.equation.weights is None:
                raise
            return self.cavitation.solve(problem, np.full_like(start, problem.unit))

    def flow(self, state: FilmState) -> Flow:
        """Dimensionless viscosity, density and flow of the oil at the Gauss points of a film."""
        return self.equation.flow(state.gap, state.pressure / self.parameters.pressure_scale)

    def powers(self, state: FilmState) -> tuple[float, float]:
        """Power lost to pressure-driven flow, and power that the surfaces' drag feeds in [W].

        The loss less the drag power is the power that the normal motion of the surfaces does on the
        film. The loss has two more terms. Between rough surfaces the average gap changes by less
        than the nominal gap, and the power of the pressure on this difference is a loss or a gain.
        The work that compresses the oil is a loss; it is a gain when the oil expands.
        """
        p = self.parameters
        q = self.flow(state)
        area = self.assembly.area
        pressure, around, along = self.assembly.at_points(state.pressure / p.pressure_scale)
        loss = np.sum(area * q.conductance * (around**2 + along**2))
        drag = np.sum(area * q.density * q.thickness * q.velocity * around)
        constant = p.lubricant.density_law.constant
        if p.surfaces is not None or not constant:
            nominal = state.gap.thickness_rate / (p.clearance * p.rate)
            loss += np.sum(area * q.density * pressure * (q.slope - 1.0) * nominal)
            if not constant:
                denser = (q.density - self.equation.factors[1]) * nominal
                loss += np.sum(area * pressure * denser)
        # Integrals in units of p_s c Omega R^2.
        scale = p.pressure_scale * p.clearance * p.rate * p.grid.radius**2
        return float(scale * loss), float(scale * drag)

    def load(self, directions: np.ndarray) -> np.ndarray:
        """Work of unit nodal pressures on displacements of the bore.

        Parameters
        ----------
        directions
            Outward normal components of n displacements at the Gauss points, shape (cells, points,
            n).

        Returns
        -------
        numpy.ndarray
            Integrals of shape function times normal component over the bore, shape (n, nodes) [m^2]
            for dimensionless components.
        """
        return (self.pressure_areas.T @ directions.reshape(-1, directions.shape[-1])).T

    @cached_property
    def points_around(self) -> np.ndarray:
        """Indices of the Gauss points of every height, once around, shape (heights, points)."""
        angle = self.points.angle.ravel()
        height = np.round(self.points.height.ravel() / self.parameters.grid.radius, 12)
        return np.lexsort((angle, height)).reshape(len(np.unique(height)), -1)

    @cached_property
    def supplied_points(self) -> np.ndarray:
        """Mask of the Gauss points within regions of given pressure, shape (cells, points)."""
        p = self.parameters
        points = self.points
        return in_regions(p.regions, points.angle, points.height, p.grid.radius)

    @cached_property
    def supplied_nodes(self) -> np.ndarray:
        """Mask of the nodes within regions of given pressure, shape (nodes,)."""
        grid = self.parameters.grid
        angle, height = grid.node_positions.T
        return in_regions(self.parameters.regions, angle, height, grid.radius)

    @cached_property
    def pressure_areas(self) -> sparse.csr_matrix:
        """Matrix from nodal pressures [Pa] to normal forces at the Gauss points [N].

        Its shape is (c * q, nodes), for c cells with q Gauss points each, its unit m^2.
        """
        return (self.parameters.grid.radius**2 * self.assembly.tested.T).tocsr()


def check_gap(gap: Gap, surfaces: RoughSurfaces | None = None) -> None:
    """Refuse a gap that is closed or not a number; rough surfaces may overlap down to a limit.

    Raises
    ------
    GapClosedError
        If the gap is too small at a Gauss point; the message contains the smallest thickness.
    SettingsError
        If a thickness, its rate or a velocity is not a finite number.
    """
    thickness = float(gap.thickness.min())
    if surfaces is not None:
        if thickness < DEEPEST_ITERATE * surfaces.roughness:
            raise GapClosedError(
                f"the surfaces overlap by {-thickness * 1e6:.3g} um, "
                f"{-thickness / surfaces.roughness:.3g} times their combined roughness, above the "
                f"limit of {-DEEPEST_ITERATE:g} times"
            )
    elif not thickness > 0.0:
        raise GapClosedError(
            f"the smallest film thickness is {thickness * 1e6:.3g} um, but must be above 0: raise "
            "the clearance or lower the load"
        )
    for name in ("thickness", "thickness_rate", "mean_velocity"):
        if not np.isfinite(getattr(gap, name).sum()):
            raise SettingsError(f"{name} of the film has values that are not finite numbers")


#: Weight gamma of the defect in the complementarity condition of the pressures, see
#: `fenics_ehd.film.oil_balance`. It is small because the defect has the wrong sign next to nodes
#: that were just emptied, and large enough for the defect to exceed round-off of void fractions.
DEFECT_WEIGHT = 1e-6


#: Largest factor by which the viscosity may vary within a cell, so that the mesh resolves it.
#: Measured with Barus' law: below this limit, peak pressures on 24 x 4 cells and more differ from
#: those on 64 x 12 cells by at most 2 %, on 16 x 3 cells by 12 %. At factors of 17 to 220 they
#: depend on the mesh: 105 to 144 MPa instead of 196 and 1670 MPa on finer meshes. Compared with the
#: solution for the reduced pressure, the error of the peak pressure of one bearing is 0.5 % at a
#: factor of 8, and 5 % at 28; at 45 the peak pressure is 215 instead of 500 MPa.
MOST_WITHIN_A_CELL = 10.0


def steepest_thickening(film: Film, pressure: np.ndarray) -> float:
    """Largest ratio of the viscosities at two nodes of one cell, for nodal pressures [Pa]."""
    law = film.equation.lubricant.viscosity_law  # at the film's own temperature
    if law.constant:
        return 1.0
    try:
        ratio = law(np.maximum(pressure, 0.0))[film.parameters.grid.cell_nodes]
    except ViscosityError:
        return np.inf
    return float((ratio.max(axis=1) / ratio.min(axis=1)).max())
