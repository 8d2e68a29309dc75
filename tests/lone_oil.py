"""Mass-conserving film (JFO), alone and without PETSc: implicit Euler by active sets."""

import numpy as np
from scipy.sparse import diags
from scipy.sparse.linalg import spsolve

from fenics_ehd.film.cavitation import CavitationResult
from fenics_ehd.film.film import FilmState
from fenics_ehd.film.oil_balance import OilBalance

#: Of the reference speed: a step without end, in which storage is 1e-10 of transport.
STEADY_STEP = 1e10


#: Of pressures and void fractions, dimensionless.
ROUND_OFF = 1e-14


class LoneOil:
    """Steps of one film through given gaps: full nodes have a pressure, the others a void."""

    def __init__(self, film):
        self.film, self.balance = film, OilBalance(film)

    def filled(self, gap, fluid_fraction=1.0):
        """Oil content of a gap without pressure [m^3]."""
        flow = self.film.equation.flow(gap)
        stored = self.film.assembly.source(flow.density * flow.thickness)
        return self.balance.volume_scale * fluid_fraction * stored

    def solve(self, gap, content, time_step, former=None):
        """State at the end of a step [s] from a content [m^3], begun at a former one."""
        balance, rate = self.balance, self.film.parameters.rate
        length = time_step * rate
        step = balance.ending(gap, length, content / (balance.volume_scale * length))
        problem, n = balance.problem(step), len(balance.unknown)
        void = np.maximum(1.0 - step.former / step.full, 0.0)[balance.unknown]
        pressure, full = np.zeros(n), void < 1e-12
        if former is not None:
            nodes, scale = balance.unknown, self.film.parameters.pressure_scale
            pressure = np.where(balance.dry, 0.0, former.pressure[nodes] / scale)
            void = 1.0 - former.fluid_fraction[nodes]
            full = pressure > void
        settled, limit = False, 1e-14 * balance.rows(step, problem).max()
        for count in range(100):
            carried = balance.transport(step, void)
            defect = problem.residual(pressure) - carried.values
            if settled and np.abs(defect).max() < limit:
                return self._state(gap, step, pressure, void, count)
            entries = problem.entries(pressure), carried.entries
            along_p, along_s = (balance.pattern.matrix(own) for own in entries)
            matrix = along_p @ diags(full * 1.0) - along_s @ diags(~full * 1.0)
            both = pressure + void - spsolve(matrix.tocsc(), defect)
            wrong = both < -ROUND_OFF
            pressure = np.where(full & ~wrong, both, 0.0)
            void = np.where(full | wrong, 0.0, both)
            settled, full = not wrong.any(), full ^ wrong
        raise AssertionError("the active set does not settle")

    def steady(self, gap):
        """State after two steps without end."""
        time_step = STEADY_STEP / self.film.parameters.rate
        first = self.solve(gap, self.filled(gap), time_step)
        return self.solve(gap, first.content, time_step, first)

    def _state(self, gap, step, values, void, count):
        balance, scale = self.balance, self.balance.volume_scale
        nodal, carried = balance.nodal(values), balance.transport(step, void)
        outflow = balance.outflow(step, nodal, values, carried)
        density = self.film.equation.flow(gap, nodal).density
        stored = self.film.assembly.source(density * step.flow.thickness)
        rate = self.film.parameters.rate
        return FilmState(
            pressure=self.film.parameters.pressure_scale * nodal,
            gap=gap,
            cavitation=CavitationResult(values, void, np.flatnonzero(values > 0), count),
            fluid_fraction=1.0 - carried.void,
            content=scale * (stored - step.length * step.full * carried.void),
            outflow=scale * rate * outflow,
        )
