"""Contact in the coupled step: derivatives, agreement of methods, energy, convergence."""

from dataclasses import replace

import numpy as np
import pytest
from differences import slope
from hand_made_rod import CLEARANCE
from rough_cases import surfaces
from test_coupled_steps import LIMITS, mechanism_with, some_step, split, whole_matrix

from fenics_ehd.film import Film
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.system import System


def with_surfaces(mechanism, rough, **changes):
    """The same with rough surfaces in its lubricated joint, and other changes of that."""
    ((name, joint),) = ((n, j) for n, j in mechanism.joints.items() if hasattr(j, "film"))
    film = Film(replace(joint.film.parameters, surfaces=rough))
    joint = replace(joint, film=film, **changes)
    return replace(mechanism, joints={**mechanism.joints, name: joint})


@pytest.mark.kernels
@pytest.mark.parametrize("limit", LIMITS)
@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_derivatives_equal_central_differences(residual, limit, share):
    # So rough and stiff that contact is everywhere, and as strong as the film.
    rough = surfaces(CLEARANCE / 3, share, modulus=1e13)
    mechanism = with_surfaces(mechanism_with("lagrange", residual), rough)
    equations = StepEquations(System(mechanism), dense_limit=limit)
    equations.lead(100)
    start, sizes, rng = some_step(equations)
    point = equations.evaluate(*split(equations, start))
    assert point.films[0].touch.pressure.max() > 1e6
    matrix = whole_matrix(equations, equations.linearise(point))

    def function(h):
        point = equations.evaluate(*split(equations, start + h * direction))
        return np.concatenate([point.films[0].defect, point.rest])

    m, n = equations.sizes[0], equations.system.n
    for part in (slice(0, m), slice(m, m + n), slice(m + n, None)):
        direction = np.zeros(len(start))
        direction[part] = (sizes * rng.uniform(-1, 1, len(start)))[part]
        found, expected = matrix @ direction, slope(function, step=1e-3)
        size = np.abs(matrix) @ sizes
        size[:m] = size[:m].max()
        assert np.abs(found - expected).max() > 0
        assert np.all(np.abs(found - expected) <= 1e-6 * size)
