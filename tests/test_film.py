"""Reynolds equation and cavitation against tables, other solvers and exact solutions."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from petsc4py import PETSc
from scipy import sparse

from fenics_ehd import compat
from fenics_ehd.errors import CavitationError, GapClosedError, InterfaceMismatchError
from fenics_ehd.film import Film, FilmParameters
from fenics_ehd.film.cavitation import CavitationSolver, verify_complementarity
from fenics_ehd.film.forms import reynolds_forms
from fenics_ehd.film.layout import film_layout
from fenics_ehd.film.mesh import cylinder_mesh

R, C, OMEGA, ETA = 0.0225, 17e-6, 500.0, 0.01

# Plain 360-degree bearing, L/D = 1, Reynolds complementarity, finite volumes on 960 x 96 cells with
# Richardson extrapolation: eccentricity ratio, load W / (6 eta omega (R/c)^2 R L), attitude [deg].
RIGID_BEARING = [(0.2, 0.0849692, 77.66), (0.6, 0.436957, 51.9785), (0.9, 2.81281, 26.7017)]

FAMILIES = ("lagrange", "serendipity")


def film(width=2 * R, cells=(20, 5), pressure="lagrange", displacement="serendipity", **options):
    return Film(FilmParameters(R, width, C, ETA, OMEGA, cells, pressure, displacement), **options)


def eccentric(nodes, x, y=0.0):
    """Bore displacement relative to a shaft whose centre lies at (x, y) clearances."""
    displacement = np.zeros_like(nodes)
    displacement[:, :2] = -C * np.array([x, y])
    return displacement


def resultant(film, state):
    """Pressure force on the bore by the squeeze-flow matrix: the load conjugate to the gap."""
    load = []
    for direction in np.eye(3)[:2]:
        forms = film._forms
        forms.displacement_rate.x.array[:] = np.tile(direction, len(film.bore_nodes))
        forms.shaft_speed.value = 0.0
        squeeze = film._assemble(forms.couette) - film._assemble(forms.source)
        load.append(squeeze @ state.cavitation.pressure)
    p = film.parameters
    return np.array(load) * p.radius**2 * p.pressure_scale


@pytest.mark.parametrize(("eccentricity", "load", "attitude"), RIGID_BEARING)
def test_rigid_bearing_matches_finite_volume_table(eccentricity, load, attitude):
    bearing = film(cells=(80, 20))
    w = eccentric(bearing.bore_nodes, eccentricity)
    state = bearing.solve(w, 0 * w, OMEGA)
    force = resultant(bearing, state)
    scale = 6 * ETA * OMEGA * (R / C) ** 2 * R * 2 * R
    assert np.hypot(*force) / scale == pytest.approx(load, rel=2e-3)
    # Load line to line of centres, in the direction of rotation.
    assert np.degrees(np.arctan2(-force[1], force[0])) == pytest.approx(attitude, abs=0.1)


@pytest.mark.parametrize("pressure", FAMILIES)
def test_centred_squeeze_of_full_film_converges(pressure):
    """Reynolds equation without cavitation against a manufactured solution."""
    errors, width = [], R
    for cells in ((10, 2), (20, 4), (40, 8)):
        mesh = cylinder_mesh(R, width, *cells)
        forms = reynolds_forms(mesh, R, C, pressure, "lagrange")
        forms.displacement.x.array.reshape(-1, 3)[:, 0] = -0.5
        x = ufl.SpatialCoordinate(mesh)
        radius = ufl.sqrt(x[0] ** 2 + x[1] ** 2)
        gap = 1 - 0.5 * x[0] / radius
        bump = 1 - (2 * x[2] / width) ** 2
        exact = bump * x[1] / radius
        # R^2 div(H^3 grad P) on the cylinder: derivatives along the arc and along z.
        sine, cosine = x[1] / radius, x[0] / radius
        slope_gap = 0.5 * sine
        around = 3 * gap**2 * slope_gap * cosine - gap**3 * sine
        source = -(bump * around + R**2 * gap**3 * sine * (-8 / width**2))
        space = forms.pressure.function_space
        test = ufl.TestFunction(space)
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 8})
        petsc = compat.fem_petsc()
        matrix = petsc.assemble_matrix(forms.stiffness)
        matrix.assemble()
        rhs = petsc.assemble_vector(fem.form(source / R**2 * test * dx)).array
        z = space.tabulate_dof_coordinates()[:, 2]
        free = np.flatnonzero(np.abs(z) < width / 2 * (1 - 1e-9))
        dense = sparse.csr_matrix(matrix.getValuesCSR()[::-1]).tocsc()[free][:, free]
        forms.pressure.x.array[:] = 0.0
        forms.pressure.x.array[free] = sparse.linalg.spsolve(dense, rhs[free])
        square = fem.form((forms.pressure - exact) ** 2 * dx)
        errors.append(np.sqrt(fem.assemble_scalar(square)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates.min() > 2.8


def projected_gauss_seidel(matrix, rhs, sweeps=20000):
    """Independent solver of the complementarity problem on a small mesh."""
    p = np.zeros(len(rhs))
    diagonal = matrix.diagonal()
    rows = [(matrix.indices[a:b], matrix.data[a:b]) for a, b in
            zip(matrix.indptr[:-1], matrix.indptr[1:], strict=True)]  # fmt: skip
    for _ in range(sweeps):
        largest = 0.0
        for i, (columns, values) in enumerate(rows):
            new = max(0.0, p[i] + 1.5 * (rhs[i] - values @ p[columns]) / diagonal[i])
            largest, p[i] = max(largest, abs(new - p[i])), new
        if largest < 1e-13 * p.max():
            return p
    raise AssertionError("projected Gauss-Seidel did not converge")


def test_snes_vi_agrees_with_projected_relaxation():
    bearing = film(cells=(10, 2))
    w = eccentric(bearing.bore_nodes, 0.6, 0.2)
    rate = eccentric(bearing.bore_nodes, 20.0, -40.0)
    state = bearing.solve(w, rate, OMEGA)
    matrix = bearing._scipy(bearing._block)
    rhs = bearing._assemble(bearing._forms.source)
    expected = projected_gauss_seidel(matrix, rhs)
    assert np.abs(state.cavitation.pressure - expected).max() < 1e-9 * expected.max()
    assert 0 < len(state.cavitation.full_film) < len(expected)


def test_consistent_mass_complementarity_holds_in_its_own_sense():
    bearing = film(pressure="serendipity")
    assert len(bearing.pressure_nodes) == 340
    w = eccentric(bearing.bore_nodes, 0.7)
    state = bearing.solve(w, 0 * w, OMEGA)
    result = state.cavitation
    mass = compat.fem_petsc().assemble_matrix(bearing._forms.mass)
    mass.assemble()
    mass = bearing._scipy(bearing._free_block(mass)).toarray()
    defect = bearing._scipy(bearing._block) @ result.pressure
    flux = np.linalg.solve(mass, defect - bearing._assemble(bearing._forms.source))
    assert flux.min() > -1e-8 * np.abs(flux).max()
    assert np.abs(flux * result.pressure).max() < 1e-8 * np.abs(flux).max() * result.pressure.max()
    # The weak form would not do: its sign at corner nodes is not that of the flux.
    weak = defect - bearing._assemble(bearing._forms.source)
    assert weak.min() < -1e-3 * np.abs(weak).max()


@pytest.mark.parametrize("pressure", FAMILIES)
@pytest.mark.parametrize("displacement", FAMILIES)
def test_sensitivity_is_the_exact_derivative(pressure, displacement):
    bearing = film(width=0.022, cells=(12, 3), pressure=pressure, displacement=displacement)
    random = np.random.default_rng(3)
    nodes = bearing.bore_nodes
    w = eccentric(nodes, 0.7) + 0.02 * C * random.standard_normal(nodes.shape)
    rate = eccentric(nodes, 0.0, 30.0)
    direction = C * random.standard_normal(nodes.shape)
    shift, speed_slope, step = 1e4, 3.0, 1e-6
    state = bearing.solve(w, rate, OMEGA)
    exact = bearing.sensitivity(state, direction[:, :, None], shift, np.array([speed_slope]))[:, 0]
    sides = [
        bearing.solve(w + h * direction, rate + h * shift * direction,
                      OMEGA + h * speed_slope, state).pressure
        for h in (step, -step)
    ]  # fmt: skip
    difference = (sides[0] - sides[1]) / (2 * step)
    assert np.abs(exact - difference).max() < 1e-7 * np.abs(difference).max()


def test_pressure_work_equals_drag_less_dissipation():
    bearing = film(width=0.022)
    nodes = bearing.bore_nodes
    w, rate = eccentric(nodes, 0.6), eccentric(nodes, 50.0, 100.0)
    state = bearing.solve(w, rate, OMEGA)
    loss, drag = bearing.powers(state)
    velocity = C * np.array([-50.0, -100.0])
    work = resultant(bearing, state) @ velocity
    assert work == pytest.approx(drag - loss, rel=1e-9)
    assert loss > 0


def test_film_does_not_depend_on_the_order_of_the_nodes_given():
    bearing = film(width=0.022, cells=(12, 3))
    order = np.random.default_rng(0).permutation(len(bearing.pressure_nodes))
    other = film(width=0.022, cells=(12, 3), pressure_nodes=bearing.pressure_nodes[order])
    w = eccentric(bearing.bore_nodes, 0.5)
    expected = bearing.solve(w, 0 * w, OMEGA).pressure
    np.testing.assert_allclose(other.solve(w, 0 * w, OMEGA).pressure, expected[order], rtol=1e-12)


def test_centred_shaft_at_rest_gives_no_pressure():
    bearing = film(cells=(12, 3))
    w = np.zeros_like(bearing.bore_nodes)
    assert bearing.solve(w, w, OMEGA).pressure.max() < 1e-3


def test_receding_shaft_cavitates_everywhere():
    bearing = film(cells=(12, 3))
    nodes = bearing.bore_nodes
    growing = np.zeros_like(nodes)
    growing[:, :2] = 100 * C * nodes[:, :2] / R
    state = bearing.solve(0 * nodes, growing, 0.0)
    assert state.pressure.max() == 0.0
    assert len(state.cavitation.full_film) == 0
    slope = bearing.sensitivity(state, growing[:, :, None], 1e4, np.zeros(1))
    assert np.all(slope == 0.0)


def test_closed_gap_is_refused_with_its_value():
    bearing = film(cells=(12, 3))
    w = eccentric(bearing.bore_nodes, 1.01)
    with pytest.raises(GapClosedError, match=r"-0\.17 um"):
        bearing.solve(w, 0 * w, OMEGA)


def test_foreign_nodes_are_refused():
    with pytest.raises(InterfaceMismatchError, match=r"100 bore nodes .* 12 x 3"):
        film(cells=(12, 3), bore_nodes=np.ones((100, 3)))


@pytest.mark.parametrize("family", FAMILIES)
def test_layout_recognises_cells_and_element(family):
    bearing = film(width=0.022, cells=(20, 5), pressure=family)
    assert film_layout(bearing.pressure_nodes) == ((20, 5), family)
    with pytest.raises(InterfaceMismatchError, match="structured"):
        film_layout(bearing.pressure_nodes[1:])


def test_unsolvable_iteration_is_a_named_error():
    matrix = PETSc.Mat().createDense((2, 2), array=np.eye(2), comm=PETSc.COMM_SELF)
    matrix.assemble()
    solver = CavitationSolver(2, options_prefix="stubborn_")
    options = PETSc.Options("stubborn_")
    options["snes_max_it"] = 0
    try:
        with pytest.raises(CavitationError, match="-stubborn_snes_monitor"):
            solver.solve(matrix, np.array([1.0, -1.0]), np.zeros(2))
    finally:
        options.delValue("snes_max_it")


@pytest.mark.parametrize(
    ("pressure", "flux", "named"),
    [
        ([-1e-3, 1.0], [0.0, 0.0], "negative pressure"),
        ([0.0, 1.0], [-1e-3, 0.0], "negative flux"),
        ([1.0, 0.5], [0.0, 1e-3], "pressure times flux"),
        ([np.nan, 1.0], [0.0, 0.0], "negative pressure"),
    ],
)
def test_verification_catches_each_violation(pressure, flux, named):
    with pytest.raises(CavitationError, match=named):
        verify_complementarity(np.array(pressure), np.array(flux), 1.0)
