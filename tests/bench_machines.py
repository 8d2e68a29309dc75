"""What tests take of the loop and what goes along a run again below the public names."""

# ruff: noqa: F401

from fenics_ehd.analysis.bearing import minimum_film
from fenics_ehd.analysis.equilibrium import stability
from fenics_ehd.analysis.error_budget import (
    SETTLED,
    ErrorCurves,
    Estimator,
    Extreme,
    lacking_gaps,
    summed,
)
from fenics_ehd.analysis.multiplier import largest_multiplier
from fenics_ehd.analysis.replay import (
    LONGEST,
    Course,
    Replay,
    course_of,
    finer_grid,
    largest_between_nodes,
    recorded,
    taken_over,
    with_finer_films,
)
from fenics_ehd.analysis.sensitivity import (
    derivatives,
    extreme_around,
    figure_of,
    smooth_extreme,
    smooth_mean,
)
from fenics_ehd.multibody import (
    film_models,
    newton,
    periodic,
    quantities,
    simulation,
    step_equations,
    tabulated,
)
from fenics_ehd.multibody.bdf import (
    BOUNDARY_FRACTION,
    NEWTON_FRACTION,
    Attempt,
    ImplicitStep,
    IntegratorOptions,
    IntegratorState,
    Solved,
    advance,
)
from fenics_ehd.multibody.body import (
    FrameInertia,
    in_order_of_coordinates,
    rigid_integrals,
    with_total,
)
from fenics_ehd.multibody.border import BorderedSystem, ChangedSystem
from fenics_ehd.multibody.contact import JointContact
from fenics_ehd.multibody.forces import Table
from fenics_ehd.multibody.history import FIELD_UNITS, JointResult, fixed
from fenics_ehd.multibody.lubricated_joint import (
    JointFilm,
    bore_surface,
    sampling_grid,
)
from fenics_ehd.multibody.mechanism import Instant, Motion, System, assemble
from fenics_ehd.multibody.newton import CoupledSteps, classify_failure
from fenics_ehd.multibody.notices import stepped_shapes, unusual_totals
from fenics_ehd.multibody.periodic import PeriodicSolver, check_period, repeating
from fenics_ehd.multibody.quantities import OUTPUTS, averaged, joint_row, upper_most
from fenics_ehd.multibody.run import Run, touching_film
from fenics_ehd.multibody.shaft import beam_plane
from fenics_ehd.multibody.simulation import EXTREMES, Simulation, columns_of
from fenics_ehd.multibody.static_correction import BoreResponses
from fenics_ehd.multibody.step_equations import FilmFriction, StepEquations, film_friction
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.tabulated import (
    Curve,
    TabulatedLoad,
    blended,
    derivative_weights,
    extrapolation_weights,
)
from fenics_ehd.multibody.trust import (
    COMPONENTS,
    ENERGY_LIMIT,
    NOT_APPLICABLE,
    NOT_ESTIMATED,
    QUANTITIES,
    SIGNS,
    BasisErrorEstimate,
    balance_error,
    bore_loads,
    energy_row,
    estimate_at,
    in_one_step,
    neglected_inertia,
    rings,
    slowest_pattern,
    step_powers,
)
