"""Periodic solutions of mechanisms: what cycles end in, against an initial value problem."""

import numpy as np
import pytest
from mechanism_cases import REVOLUTION, film, rigid_rod, slider_crank
from scipy.interpolate import CubicSpline

from fenics_ehd.multibody.simulation import simulate, simulate_periodic

CLEARANCE = 17e-6


def orbit(result, times):
    """Eccentricity at given times, over the clearance, shape (times, 2)."""
    joint = result.joints["big_end"]
    return CubicSpline(result.time, joint.eccentricity / CLEARANCE)(times)


@pytest.mark.slow
def test_the_periodic_cycle_is_the_last_of_a_long_run():
    mechanism = slider_crank(rigid_rod(), film(22.5e-3, 2.2e-3, CLEARANCE, 10.0, (24, 4)))
    long = simulate(mechanism, 5 * REVOLUTION, tolerance=1e-5, largest=0.02 / 5)
    times = np.linspace(0.03, 0.97, 200) * REVOLUTION
    first, last = orbit(long, times), orbit(long, times + 4 * REVOLUTION)
    # It is not where the first revolution is, which begins with a centred journal.
    assert np.abs(first - last).max() > 1e-2
    counts = []
    for periodicity in (0.1, 1e-4):
        result = simulate_periodic(mechanism, REVOLUTION, periodicity=periodicity, tolerance=1e-5)
        assert result.periodicity_defect <= periodicity
        counts.append(result.cycles)
    assert 2 <= counts[0] < counts[1] < 5
    assert result.time[0] == 0.0
    assert result.time[-1] == pytest.approx(REVOLUTION, rel=1e-12)
    assert np.abs(orbit(result, times) - last).max() < 3e-4
    # Cycles follow each other without a stop: the films of both ends are one film.
    before, after = (result.joints["big_end"].min_film_thickness[at] for at in (1, -1))
    assert before == pytest.approx(after, rel=0.05)
