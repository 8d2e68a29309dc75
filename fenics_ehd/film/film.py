"""The oil film of one bore: pressure, its sensitivity, gap and losses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse
from scipy.spatial import cKDTree

from fenics_ehd import compat
from fenics_ehd.errors import GapClosedError, InterfaceMismatchError
from fenics_ehd.film.cavitation import CavitationResult, CavitationSolver
from fenics_ehd.film.forms import reynolds_forms
from fenics_ehd.film.gap import gap_rows
from fenics_ehd.film.mesh import cylinder_mesh
from fenics_ehd.petsc_options import configure, solve_columns

#: Largest distance between a film node and the bore node it belongs to, relative to the radius.
MATCH_TOLERANCE = 1e-6

#: Below this dimensionless rate of gap change the source of (11) counts as zero.
SMALLEST_SOURCE = 1e-6

SENSITIVITY_OPTIONS = {"ksp_type": "preonly", "pc_type": "lu"}


@dataclass(frozen=True)
class FilmParameters:
    """One bearing and its oil.

    Attributes
    ----------
    radius, width, clearance
        Bore radius R2, bearing width B and radial clearance c [m].
    viscosity
        Dynamic viscosity [Pa s].
    rate
        Reference angular speed Omega > 0 [rad/s] that makes the equation dimensionless.
    cells
        Cells along the circumference and along the axis.
    pressure_family, displacement_family
        ``"serendipity"`` (8-node) or ``"lagrange"`` (9-node).
    """

    radius: float
    width: float
    clearance: float
    viscosity: float
    rate: float
    cells: tuple[int, int] = (20, 5)
    pressure_family: str = "lagrange"
    displacement_family: str = "serendipity"

    @property
    def pressure_scale(self) -> float:
        """``p_s = 12 eta Omega (R / c)^2`` [Pa]."""
        return 12 * self.viscosity * self.rate * (self.radius / self.clearance) ** 2


@dataclass(frozen=True, eq=False)
class FilmState:
    """Solution of one film problem.

    Attributes
    ----------
    pressure
        Nodal pressure in the caller's order, shape (k,) [Pa].
    cavitation
        The dimensionless complementarity solution on the free nodes.
    """

    pressure: np.ndarray
    cavitation: CavitationResult


class Film:
    """Reynolds equation on one bore, solved again and again.

    Nodal arrays come and go in the order of the nodes given here, so that bore
    and film never have to know each other's numbering.

    Parameters
    ----------
    parameters
        Bearing and oil.
    bore_nodes, pressure_nodes
        Positions of the displacement and pressure nodes, shape (m, 3) and (k, 3)
        [m]; those of a `ReducedBody`. None: the film's own nodes.
    options_prefix
        Prefix of the PETSc options of SNES-VI and of the sensitivity solves.
    tolerance
        Of SNES-VI, see `CavitationSolver`.

    Raises
    ------
    InterfaceMismatchError
        The nodes given are not those of the film mesh.
    """

    def __init__(
        self,
        parameters: FilmParameters,
        bore_nodes: np.ndarray | None = None,
        pressure_nodes: np.ndarray | None = None,
        *,
        comm: MPI.Comm = MPI.COMM_SELF,
        options_prefix: str = "film_",
        tolerance: float = 1e-10,
    ):
        self.parameters = parameters
        mesh = cylinder_mesh(parameters.radius, parameters.width, *parameters.cells, comm)
        self._forms = reynolds_forms(
            mesh,
            parameters.radius,
            parameters.clearance,
            parameters.pressure_family,
            parameters.displacement_family,
        )
        forms = self._forms
        own_pressure = forms.pressure.function_space.tabulate_dof_coordinates()
        own_bore = forms.displacement.function_space.tabulate_dof_coordinates()
        self.pressure_nodes = own_pressure if pressure_nodes is None else pressure_nodes
        self.bore_nodes = own_bore if bore_nodes is None else bore_nodes
        self._to_pressure = self._match("pressure", self.pressure_nodes, own_pressure)
        self._to_bore = self._match("bore", self.bore_nodes, own_bore)
        inside = np.abs(own_pressure[:, 2]) < (0.5 - MATCH_TOLERANCE) * parameters.width
        self._free = np.flatnonzero(inside).astype(np.int32)
        self._gap_rows = gap_rows(forms.displacement.function_space, parameters.displacement_family)
        self._allocate(options_prefix, tolerance, comm)

    def _match(self, name: str, given: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Position in the caller's array of each of the film's own nodes."""
        distance, index = cKDTree(given).query(own)
        radius = self.parameters.radius
        if len(given) != len(own) or not distance.max() <= MATCH_TOLERANCE * radius:
            raise InterfaceMismatchError(
                f"{len(given)} {name} nodes of the body do not match the {len(own)} nodes of the "
                f"{self.parameters.cells[0]} x {self.parameters.cells[1]} film "
                f"(largest distance {distance.max():.2e} m): reduce the part with the "
                "film element of the scene"
            )
        return index

    def _allocate(self, prefix: str, tolerance: float, comm: MPI.Comm) -> None:
        petsc, forms = compat.fem_petsc(), self._forms
        self._stiffness = petsc.create_matrix(forms.stiffness)
        self._derivative = petsc.create_matrix(forms.gap_derivative)
        self._vector = compat.petsc_vector(forms.pressure).duplicate()
        self._rows = PETSc.IS().createGeneral(self._free, comm=comm)
        self._block: PETSc.Mat | None = None
        self._prefix = prefix
        self._last: FilmState | None = None
        whole = petsc.assemble_matrix(forms.mass)
        whole.assemble()
        mass = self._scipy(self._free_block(whole))
        consistent = self.parameters.pressure_family == "serendipity"
        # The source of a film at unit speed: nodal areas, or ones when divided by the mass matrix.
        unit_source = np.ones(len(self._free)) if consistent else mass.sum(axis=1)
        self.cavitation = CavitationSolver(
            len(self._free),
            mass.toarray() if consistent else None,
            comm=comm,
            options_prefix=prefix,
            tolerance=tolerance,
            smallest_source=SMALLEST_SOURCE * float(np.linalg.norm(unit_source)),
        )

    def _free_block(self, matrix: PETSc.Mat, reuse: PETSc.Mat | None = None) -> PETSc.Mat:
        return matrix.createSubMatrix(self._rows, self._rows, submat=reuse)

    def load(self, direction: np.ndarray) -> np.ndarray:
        """Work of unit nodal pressures on a bore displacement (m, 3), shape (k,) [m^3]."""
        p, forms = self.parameters, self._forms
        self._set(np.zeros_like(direction), direction, 0.0)
        squeeze = self._assemble_all(forms.couette) - self._assemble_all(forms.source)
        work = np.empty(len(self._to_pressure))
        work[self._to_pressure] = squeeze * p.radius**2 * p.clearance * p.rate
        return work

    def gap(self, displacement: np.ndarray) -> np.ndarray:
        """Gap at the nodes and Gauss points [m], from the bore displacement (m, 3) [m]."""
        own = displacement[self._to_bore].ravel()
        return self.parameters.clearance + self._gap_rows @ own

    def gap_map(self, directions: np.ndarray) -> np.ndarray:
        """Gap change at the points of `gap` per unit direction, (m, 3, n) to (points, n)."""
        return self._gap_rows @ directions[self._to_bore].reshape(-1, directions.shape[2])

    def _set(
        self, displacement: np.ndarray, displacement_rate: np.ndarray, shaft_rate: float
    ) -> None:
        """Put a state, made dimensionless, into the coefficients of the forms."""
        p, forms = self.parameters, self._forms
        forms.displacement.x.array[:] = displacement[self._to_bore].ravel() / p.clearance
        rate = displacement_rate[self._to_bore].ravel() / (p.clearance * p.rate)
        forms.displacement_rate.x.array[:] = rate
        forms.shaft_speed.value = shaft_rate / p.rate

    def _assemble_all(self, form: compat.CompiledForm) -> np.ndarray:
        self._vector.set(0.0)
        compat.fem_petsc().assemble_vector(self._vector, form)
        return self._vector.array.copy()

    def _assemble(self, form: compat.CompiledForm) -> np.ndarray:
        return self._assemble_all(form)[self._free]

    def solve(
        self,
        displacement: np.ndarray,
        displacement_rate: np.ndarray,
        shaft_rate: float,
        guess: FilmState | None = None,
    ) -> FilmState:
        """Pressure for a given gap and its rate.

        Parameters
        ----------
        displacement, displacement_rate
            Displacement of the bore relative to the shaft and its rate in the
            bore's frame, shape (m, 3) [m], [m/s].
        shaft_rate
            Angular speed of the shaft relative to the bore [rad/s].
        guess
            A former state, to start from its pressure and active set.

        Raises
        ------
        GapClosedError
            The gap is not positive at a node or Gauss point.
        CavitationError
            From `CavitationSolver.solve`.
        """
        thickness = float(self.gap(displacement).min())
        if not thickness > 0.0:
            raise GapClosedError(
                f"the film thickness is {thickness * 1e6:.3g} um at its thinnest, it must be "
                "positive: shorten the step or raise the clearance"
            )
        self._set(displacement, displacement_rate, shaft_rate)
        self._stiffness.zeroEntries()
        compat.fem_petsc().assemble_matrix(self._stiffness, self._forms.stiffness)
        self._stiffness.assemble()
        self._block = self._free_block(self._stiffness, self._block)
        self._reduced = self.cavitation.reduced_matrix(self._block)
        rhs = self.cavitation.reduced_rhs(self._assemble(self._forms.source))
        start = np.zeros(len(self._free)) if guess is None else guess.cavitation.pressure
        result = self.cavitation.solve(self._reduced, rhs, start)
        pressure = self._to_caller(result.pressure[:, None])[:, 0]
        self._last = FilmState(pressure, result)
        return self._last

    def _require_last(self, state: FilmState) -> None:
        """The matrices of the film are those of its last solve."""
        if state is not self._last:
            raise ValueError("only the state of the last solve can be asked for this")

    def _to_caller(self, values: np.ndarray) -> np.ndarray:
        """Dimensionless values on the free nodes to pressures in the caller's order [Pa]."""
        pressures = np.zeros((len(self._to_pressure), values.shape[1]))
        pressures[self._to_pressure[self._free]] = self.parameters.pressure_scale * values
        return pressures

    def sensitivity(
        self, state: FilmState, directions: np.ndarray, rate_shift: float, shaft_rates: np.ndarray
    ) -> np.ndarray:
        """Exact derivative of the pressure of the last `solve` in given directions.

        Parameters
        ----------
        state
            The state that `solve` returned last.
        directions
            Directions of the bore displacement, shape (m, 3, n).
        rate_shift
            Derivative of the displacement rate with respect to the
            displacement [1/s], that of the time integration formula.
        shaft_rates
            Derivative of the shaft rate along each direction, shape (n,).

        Returns
        -------
        numpy.ndarray
            shape (k, n), pressure nodes in the caller's order. On the active
            set (zero pressure) it is zero: the one-sided derivative from inside
            the partition.
        """
        self._require_last(state)
        p, forms = self.parameters, self._forms
        forms.pressure.x.array[:] = 0.0
        forms.pressure.x.array[self._free] = state.cavitation.pressure
        forms.rate_shift.value = rate_shift / p.rate
        self._derivative.zeroEntries()
        compat.fem_petsc().assemble_matrix(self._derivative, forms.gap_derivative)
        self._derivative.assemble()
        own = directions[self._to_bore].reshape(-1, directions.shape[2]) / p.clearance
        slope = self._scipy(self._derivative) @ own
        slope += np.outer(self._assemble_all(forms.speed_derivative), shaft_rates / p.rate)
        change = -self.cavitation.reduced_rhs(slope[self._free])
        full_film = state.cavitation.full_film
        values = np.zeros_like(change)
        values[full_film] = self._solve_full_film(full_film, change[full_film])
        return self._to_caller(values)

    @staticmethod
    def _scipy(matrix: PETSc.Mat) -> sparse.csr_matrix:
        return sparse.csr_matrix(matrix.getValuesCSR()[::-1], shape=matrix.size)

    def _solve_full_film(self, full_film: np.ndarray, rhs: np.ndarray) -> np.ndarray:
        """Solve with the block of the film matrix on the nodes where the equation holds."""
        if not len(full_film) or not rhs.shape[1]:
            return np.zeros_like(rhs)
        rows = PETSc.IS().createGeneral(full_film, comm=self._reduced.comm)
        block = self._reduced.createSubMatrix(rows, rows)
        ksp = PETSc.KSP().create(block.comm)
        ksp.setOperators(block)
        configure(ksp, f"{self._prefix}sensitivity_", SENSITIVITY_OPTIONS)
        ksp.setUp()
        right = PETSc.Mat().createDense(rhs.shape, array=np.asfortranarray(rhs), comm=block.comm)
        solution = right.duplicate()
        solve_columns(ksp, right, solution)
        values = np.array(solution.getDenseArray())
        for item in (ksp, block, right, solution, rows):
            item.destroy()
        return values

    def powers(self, state: FilmState) -> tuple[float, float]:
        """Power lost to pressure-driven flow and power fed in by the shaft's drag on the oil [W].

        Their difference is the power that the film takes from the normal motion
        of the bore; both come from the Reynolds matrices of the last `solve`.
        """
        self._require_last(state)
        p = self.parameters
        pressure = np.zeros(len(self._to_pressure))
        pressure[self._free] = state.cavitation.pressure
        # Integrals in units of p_s c Omega R^2: the forms divide areas by R^2.
        scale = p.pressure_scale * p.clearance * p.rate * p.radius**2
        free = pressure[self._free]
        reduced = self._scipy(self._stiffness)
        dissipation = pressure @ (reduced @ pressure)
        drag = free @ self._assemble(self._forms.couette)
        return scale * dissipation, scale * drag
