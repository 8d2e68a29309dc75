"""The oil film of one bore: pressure, its sensitivity and its losses."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import CavitationError, GapClosedError, SettingsError, SolverError
from fenics_ehd.film.balance import OilProperties
from fenics_ehd.film.cavitation import CavitationResult, CavitationSolver, Complementarity
from fenics_ehd.film.kinematics import Gap, GapDerivatives
from fenics_ehd.film.nested import CoarseTransfer
from fenics_ehd.film.parameters import FilmParameters
from fenics_ehd.film.reynolds import DensityRate, ReynoldsEquation
from fenics_ehd.film.rough_surfaces import DEEPEST_ITERATE, RoughSurfaces


@dataclass(frozen=True, eq=False)
class FilmState:
    """Solution of one film problem.

    Attributes
    ----------
    pressure
        Nodal pressure, shape (nodes,) [Pa].
    gap
        The gap it belongs to.
    cavitation
        The dimensionless complementarity solution on the free nodes.
    problem
        The dimensionless problem it solves.
    fluid_fraction
        Share of the gap that holds oil, shape (nodes,); None where the
        cavitation condition does not tell.
    density_rate
        The one it was solved with.
    full
        Gauss points that count as full film for the oil's shear; None: as the pressure says.
    """

    pressure: np.ndarray
    gap: Gap
    cavitation: CavitationResult
    problem: Complementarity
    fluid_fraction: np.ndarray | None = None
    density_rate: DensityRate | None = None
    full: np.ndarray | None = None


class Film:
    """Reynolds equation on one bore, solved again and again.

    Nodal arrays are in the order of `FilmGrid.nodes`, values at Gauss points
    have shape (cells, points).

    Parameters
    ----------
    parameters
        Bearing and oil.
    options_prefix
        Prefix of the PETSc options of SNES-VI, see `CavitationSolver`.
    tolerance
        Of SNES-VI.

    Attributes
    ----------
    equation
        The discrete Reynolds equation.
    points
        Gauss points on the bore.
    free
        Nodes whose pressure is unknown.
    """

    def __init__(
        self,
        parameters: FilmParameters,
        *,
        options_prefix: str = "film_",
        tolerance: float = 1e-10,
    ):
        self.parameters = parameters
        self.equation = ReynoldsEquation(parameters)
        self.assembly = self.equation.assembly
        self.free, self.points = self.equation.free, self.equation.points
        self.cavitation = CavitationSolver(
            self.assembly.pattern,
            weighted=self.equation.weights is not None,
            symmetric=parameters.lubricant.linear,
            options_prefix=options_prefix,
            tolerance=tolerance,
        )
        self._prefix, self._tolerance = options_prefix, tolerance

    def apart(self) -> Film:
        """The same film with a temperature of its own."""
        film = copy(self)
        film.equation = copy(self.equation)
        return film

    def warm(self, temperature: float) -> None:
        """Give the oil the viscosity of another temperature [C], see `ReynoldsEquation.warm`."""
        self.equation.warm(temperature)

    @cached_property
    def _coarse(self) -> tuple[Film, CoarseTransfer] | None:
        grid = self.parameters.grid
        coarse = grid.coarser()
        if coarse is None:
            return None
        try:
            film = Film(
                replace(self.parameters, grid=coarse),
                options_prefix=self._prefix,
                tolerance=self._tolerance,
            )
        except SettingsError:  # a groove too narrow for the coarser mesh
            return None
        return film, CoarseTransfer(grid, coarse, self.assembly.tensors.points)

    def solve(
        self,
        gap: Gap,
        guess: FilmState | None = None,
        *,
        density_rate: DensityRate | None = None,
    ) -> FilmState:
        """Pressure for a given gap.

        Parameters
        ----------
        gap
            At the Gauss points, shape (cells, points).
        guess
            A former state, to start from its pressure and active set; without
            one the start comes from coarser meshes.
        density_rate
            Of a compressible oil in transient motion; None: constant density.

        Raises
        ------
        GapClosedError
            The gap is not positive at a Gauss point.
        SettingsError
            No pressure is given anywhere.
        CavitationError
            From `CavitationSolver.solve`; its `state` holds the gap too.
        """
        check_gap(gap, self.parameters.surfaces)
        closed = len(self.free) == self.assembly.size and not self.parameters.feeds
        if closed and density_rate is None:
            raise SettingsError(
                "no pressure of the film is given, only its slopes follow: open a side or add a "
                "groove"
            )
        problem = self.equation.problem(gap, density_rate)
        if guess is not None:
            start = guess.cavitation.pressure
        else:
            start = self._cold_start(gap)
        try:
            result = self._from_either_end(problem, start)
        except CavitationError as error:
            error.state.update({name: getattr(gap, name) for name in Gap.__dataclass_fields__})
            raise
        pressure = self.parameters.pressure_scale * self.equation.nodal(result.pressure)
        return FilmState(pressure, gap, result, problem, density_rate=density_rate)

    def _from_either_end(self, problem: Complementarity, start: np.ndarray) -> CavitationResult:
        """Solve from a start, or else from a film that is full everywhere.

        The matrix of 8-node cells is no M-matrix: from few full nodes active sets may follow each
        other for ever (at eccentricities of round-off, on some processors).
        """
        try:
            return self.cavitation.solve(problem, start)
        except CavitationError:
            if self.equation.weights is None:
                raise
            return self.cavitation.solve(problem, np.full_like(start, problem.unit))

    def _cold_start(self, gap: Gap) -> np.ndarray:
        if self._coarse is None:
            return np.zeros(len(self.free))
        coarse, transfer = self._coarse
        try:
            state = coarse.solve(transfer.restrict(gap))
        except SolverError:  # only a guess is lost
            return np.zeros(len(self.free))
        return transfer.prolong(state.pressure)[self.free] / self.parameters.pressure_scale

    def sensitivity(self, state: FilmState, derivatives: GapDerivatives) -> np.ndarray:
        """Exact derivative of the pressure along changes of the gap.

        Parameters
        ----------
        state
            A solution of this film.
        derivatives
            Changes of gap, its rate and the mean velocity in n directions, each
            (cells, points, n).

        Returns
        -------
        numpy.ndarray
            shape (nodes, n) [Pa per unit]. On the cavitated nodes it is zero:
            the one-sided derivative from inside the active set.
        """
        scale = self.parameters.pressure_scale
        change = self.equation.change(
            state.gap, state.pressure / scale, derivatives, state.density_rate
        )
        values = np.zeros((self.assembly.size, change.shape[1]))
        values[self.free] = self.cavitation.derivative(state.problem, state.cavitation, change)
        return scale * values

    def density(self, state: FilmState) -> np.ndarray:
        """Density over that of the oil at zero pressure, at the Gauss points."""
        return self.oil(state).density

    def oil(self, state: FilmState) -> OilProperties:
        """Oil of a solved film at the Gauss points, dimensionless."""
        equation = self.equation
        nodal = state.pressure / self.parameters.pressure_scale
        return equation.oil(nodal, equation.thinning(state.gap))

    def powers(self, state: FilmState) -> tuple[float, float]:
        """Power lost to pressure-driven flow and power fed in by the surfaces' drag on the oil [W].

        Their difference is the power that the film takes from the normal motion
        of its surfaces. Between rough ones the mean pressure acts on their whole area, while the
        average gap changes by less than the nominal one: what it does beside is a loss, or a gain.
        So is what compresses the oil, which comes back as it expands.
        """
        p = self.parameters
        thickness, change, velocity = self.equation.dimensionless(state.gap)
        q = self.oil(state)
        area = self.assembly.area
        loss = np.sum(area * q.mobility(thickness) * (q.around**2 + q.along**2))
        drag = np.sum(area * q.density * thickness * velocity * q.around)
        constant = p.lubricant.density_law.constant
        if p.surfaces is not None or not constant:
            pressure = self.assembly.at_points(state.pressure)[0] / p.pressure_scale
            nominal = state.gap.thickness_rate / (p.clearance * p.rate)
            loss += np.sum(area * q.density * pressure * (change - nominal))
            if not constant:
                denser = (q.density - self.equation.factors[1]) * nominal
                loss += np.sum(area * pressure * denser)
        # Integrals in units of p_s c Omega R^2.
        scale = p.pressure_scale * p.clearance * p.rate * p.grid.radius**2
        return float(scale * loss), float(scale * drag)

    def load(self, directions: np.ndarray) -> np.ndarray:
        """Work of unit nodal pressures on normal displacements of the bore.

        Parameters
        ----------
        directions
            Outward displacement at the Gauss points, shape (cells, points, n).

        Returns
        -------
        numpy.ndarray
            shape (n, nodes) [m^2]: integrals of shape function times displacement.
        """
        return (self.pressure_areas.T @ directions.reshape(-1, directions.shape[-1])).T

    @cached_property
    def pressure_areas(self) -> sparse.csr_matrix:
        """Force of unit nodal pressures by Gauss point, shape (c * q, nodes) [m^2]."""
        elements = self.assembly.source_elements(np.ones(self.assembly.area.shape))
        return (self.parameters.grid.radius**2 * self.assembly.gather(elements).T).tocsr()


def check_gap(gap: Gap, surfaces: RoughSurfaces | None = None) -> None:
    """Refuse a gap that is closed or not a number; rough surfaces may overlap, up to a limit.

    Raises
    ------
    GapClosedError
        Naming the smallest thickness.
    """
    thickness = float(gap.thickness.min())
    if surfaces is not None:
        if thickness < DEEPEST_ITERATE * surfaces.roughness:
            raise GapClosedError(
                f"the surfaces overlap by {-thickness * 1e6:.3g} um, "
                f"{-thickness / surfaces.roughness:.3g} times their combined roughness"
            )
    elif not thickness > 0.0:
        raise GapClosedError(
            f"the film thickness is {thickness * 1e6:.3g} um at its thinnest, it must be "
            "positive: shorten the step or raise the clearance"
        )
    for name in ("thickness", "thickness_rate", "mean_velocity"):
        if not np.isfinite(getattr(gap, name).sum()):
            raise SettingsError(f"the {name} of the film is not a finite number everywhere")
