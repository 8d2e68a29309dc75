"""The integrators that are compared, each as a function of a case, a window and a tolerance."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import integrators_alpha
import integrators_dirk
import integrators_petsc
import integrators_scipy
from integrators_case import FIRST_STEP, SMALLEST_STEP, Case, Integrator, Trajectory, Window
from nested_film import NestedFilm

from fenics_ehd.multibody import bdf
from fenics_ehd.multibody.bdf import Step, StepControl
from fenics_ehd.multibody.coupled import CoupledSteps

#: Share of the next order in the package's formula.
BLEND = StepControl.blend

#: Tolerances that bracket errors of 1 % and 0.1 %.
TOLERANCES = (1e-3, 1e-4, 1e-5)

#: Of formulas whose error is far below what they estimate.
WIDE = (1e-2, 1e-3, 1e-4)


def control(case: Case, tolerance: float, order: int, blend: float = BLEND) -> StepControl:
    """That of the scene."""
    return StepControl(tolerance, FIRST_STEP, SMALLEST_STEP, case.largest_step, order, blend)


def steps(
    case: Case, window: Window, tolerance: float, order: int, blend: float = BLEND
) -> Iterator[Step]:
    """Those of the package."""
    return bdf.integrate(
        case.machine,
        (window.start, window.end),
        window.x,
        window.rate,
        control(case, tolerance, order, blend),
        CoupledSteps(case.machine),
    )


def coupled(order: int, blend: float, case: Case, window: Window, tolerance: float) -> Trajectory:
    """The package's formula and solver; without `blend`, plain backward differentiation."""
    return Trajectory().add_all(steps(case, window, tolerance, order, blend))


def nested(order: int, case: Case, window: Window, tolerance: float) -> Trajectory:
    """Plain backward differentiation, a film solved in every evaluation."""
    span, settings = (window.start, window.end), control(case, tolerance, order, 0.0)
    problem = NestedFilm(case.machine)
    return Trajectory().add_all(bdf.integrate(problem, span, window.x, window.rate, settings))


def runge_kutta(name: str, case: Case, window: Window, tolerance: float) -> Trajectory:
    """See `integrators_dirk`."""
    found = integrators_dirk.integrate(
        case.machine,
        (window.start, window.end),
        window.x,
        window.rate,
        control(case, tolerance, 2),
        integrators_dirk.TABLEAUS[name],
        CoupledSteps(case.machine),
    )
    return Trajectory().add_all(found)


def alpha(radius: float, case: Case, window: Window, tolerance: float) -> Trajectory:
    """See `integrators_alpha`."""
    found = integrators_alpha.integrate(
        case.machine,
        (window.start, window.end),
        window.x,
        window.rate,
        control(case, tolerance, 2),
        radius,
        CoupledSteps(case.machine),
    )
    return Trajectory().add_all(found)


#: With the coupled step solver: any body.
COUPLED: dict[str, tuple[Integrator, tuple[float, ...]]] = {
    "bdf 1": (partial(coupled, 1, 0.0), (1e-2, 1e-3, 1e-4)),
    "bdf 2": (partial(coupled, 2, 0.0), TOLERANCES),
    "bdf 3": (partial(coupled, 3, 0.0), TOLERANCES),
    "blend 2+3": (partial(coupled, 2, BLEND), TOLERANCES),
    "blend 3+4": (partial(coupled, 3, BLEND), TOLERANCES),
    "alpha 0.5": (partial(alpha, 0.5), TOLERANCES),
    "sdirk2": (partial(runge_kutta, "sdirk2"), (1e-1, 1e-2, 1e-3)),
    "tr-bdf2": (partial(runge_kutta, "tr-bdf2"), WIDE),
    "esdirk3": (partial(runge_kutta, "esdirk3"), WIDE),
    "esdirk4": (partial(runge_kutta, "esdirk4"), WIDE),
}

#: With a nested film: bodies without residual patterns.
NESTED: dict[str, tuple[Integrator, tuple[float, ...]]] = {
    "nested bdf 2": (partial(nested, 2), TOLERANCES),
    "nested bdf 3": (partial(nested, 3), TOLERANCES),
} | {
    name: (
        partial(integrators_petsc.integrate, method),
        WIDE if method.type == "arkimex" else TOLERANCES,
    )
    for name, method in integrators_petsc.METHODS.items()
}

#: The obvious way, with differences chosen with care and SciPy's own.
OBVIOUS: dict[str, tuple[Integrator, tuple[float, ...]]] = {
    f"SciPy {method}{' own' if own else ''}": (
        partial(integrators_scipy.integrate, method, own),
        TOLERANCES[1:2] if own else TOLERANCES,
    )
    for own in (False, True)
    for method in ("BDF", "Radau")
}
