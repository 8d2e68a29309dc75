"""Derivatives of one converged step along numbers of its mechanism.

With unknowns U, past w and a number p the step's equations R(U, w, p) = 0 give

    J dU/dp = -(dR/dp + dR/dw dw/dp),

J the step's own matrix, factorised once for all numbers on the active sets as they are. The right
side is one evaluation: the equations of a mechanism with p + eps, along the direction that
is known so far, less those of the mechanism itself, over eps. What J leaves out (shear of the oil,
residual patterns) remains in it: a direction is corrected until corrections are small.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.base.errors import SolverError
from fenics_ehd.multibody.cycle_record import RecordedStep, Unknowns
from fenics_ehd.multibody.perturbed import Columns, Perturbed, StepView
from fenics_ehd.multibody.step_equations import Point
from fenics_ehd.multibody.step_factors import StepFactors
from fenics_ehd.multibody.step_solver import DENSE_LIMIT, ZERO_PRESSURE

#: Largest correction of a direction that is left, as a relative change of a gap or a coordinate in
#: the norm of the steps per relative change of the number; and corrections at most. The squeeze
#: velocity has it over the step: in steps of a degree 1e-4 put a peak pressure's derivative 0.9 %
#: off, 1e-5 less than 0.01 %, at the same cost as corrections shrink a thousandfold.
TOLERANCE, MAX_CORRECTIONS = 1e-6, 12

#: Share of a number's scale, to either side, by which it is changed to see which points fill and
#: empty: a mean friction's derivative is 0.4 % off differences of that size, of a rigid rod and of
#: an elastic one on 40 x 5 cells (`docs/sensitivity.md`).
JUMPS = 0.01

#: Steps after which it is looked at again what a correction leaves.
LOOK_AGAIN = 8


@dataclass(frozen=True, eq=False)
class Direction:
    """Derivative of one step along one number, over the number's scale.

    Attributes
    ----------
    unknowns
        Of the step's unknowns.
    x, rate
        Of the state at its end, and of its rate.
    columns
        Of the history's columns, by joint and name; empty if they are not asked for.
    """

    unknowns: Unknowns
    x: np.ndarray
    rate: np.ndarray
    columns: Columns


class StepDerivatives:
    """Derivatives of the steps of one mechanism, one step after another.

    Parameters
    ----------
    view
        The mechanism.
    """

    def __init__(self, view: StepView):
        self.view = view
        self._factors = StepFactors(
            view.equations, dense_limit=DENSE_LIMIT, options_prefix="sensitivity_"
        )
        self._left: dict[int, tuple[float, int]] = {}

    def begin(self, step: RecordedStep, *, columns: bool) -> None:
        """Take another step: evaluate and factorise its equations where they were solved.

        `columns`: whether derivatives of the history's are wanted, too.
        """
        equations = self.view.equations
        self._step, self._asked = step, step.equations_of(equations)
        equations.begin(self._asked)
        equations.hold_filled()
        self._unknowns = step.unknowns(equations)
        self._point = self._evaluate()
        self._full = [np.flatnonzero(own > ZERO_PRESSURE) for own in self._unknowns.films]
        self._factors.begin(self.view.norm, step.patterns)
        self._factors.factorise(self._point, self._full)
        self.columns: Columns = {}
        if columns:
            self._held = self.view.held(self._point)
            self.columns = self.view.columns(self._asked, self._point, self._held)

    def _evaluate(self) -> Point:
        own = self._unknowns
        return self.view.equations.evaluate(own.films, own.rest, own.voids)

    def along(
        self,
        number: int,
        perturbed: Perturbed,
        past: tuple[np.ndarray, np.ndarray],
        guess: Unknowns | None,
    ) -> Direction:
        """Derivative along a number.

        Parameters
        ----------
        number
            Which of them: what a correction leaves is remembered.
        perturbed
            The mechanism with it changed.
        past
            Derivatives of ``past_x`` and ``past_rate``.
        guess
            Of the direction; None: 0.

        Raises
        ------
        SolverError
            Corrections do not become small.
        """
        perturbed.begin(self._asked, past, self.view.equations.filled)
        found = self._kept(guess)
        left, age = self._left.get(number, (1.0, LOOK_AGAIN))
        point, former = perturbed.evaluate(self._unknowns, found), 0.0
        for _ in range(MAX_CORRECTIONS):
            change, size = self._correction(point, perturbed.amount)
            found = found.moved(change, -1.0)
            point = perturbed.evaluate(self._unknowns, found)
            if former:
                left, age = size / former, 0
            if left * size <= TOLERANCE and (former or age < LOOK_AGAIN):
                break
            if size <= TOLERANCE:
                age = 0
                break
            former = size
        else:
            raise SolverError(
                f"the derivative of the step to t = {self._step.time:.6g} s does not settle: its "
                f"last correction is {size:.2g}, above {TOLERANCE:g}"
            )
        self._left[number] = left, age + 1
        x, rate = perturbed.equations.state(point)
        moved = (x - self._step.x) / perturbed.amount, (rate - self._step.rate) / perturbed.amount
        return Direction(found, *moved, self._along_columns(perturbed, point, found))

    def _along_columns(self, perturbed: Perturbed, point: Point, along: Unknowns) -> Columns:
        """Derivatives of the history's columns, if they are wanted."""
        if not self.columns:
            return {}
        found = _slope(perturbed.columns_at(point, self._held), self.columns, perturbed.amount)
        if not self.view.sheared:
            return found
        # Where a point fills or empties, the sheared share jumps: what jumps make on average.
        here = self._point
        forth, back = (
            self.view.columns(
                self._asked, here, replace(self._held, full=self.view.full(pressures))
            )
            for pressures in (self._moved(point, perturbed, along, s) for s in (JUMPS, -JUMPS))
        )
        jumps = _slope(forth, back, 2.0 * JUMPS)
        return {
            joint: {name: value + jumps[joint][name] for name, value in columns.items()}
            for joint, columns in found.items()
        }

    def _moved(
        self, point: Point, perturbed: Perturbed, along: Unknowns, share: float
    ) -> dict[int, np.ndarray]:
        """Pressures of all nodes after a change of the number by a share of its scale.

        On a changed active set they go on along another line, but the first nodes that fill and
        empty are right.
        """
        equations, found = self.view.equations, {}
        for i in self.view.sheared:
            own, other = self._point.films[i], point.films[i]
            film = equations.system.films[i].film.film
            if own.oil is not None:
                found[i] = own.nodal
                continue
            pressures = self._unknowns.films[i] + share * along.films[i]
            flux = own.defect + share / perturbed.amount * (other.defect - own.defect)
            diagonal = own.problem.entries(own.nodal[film.free])[film.assembly.pattern.diagonal]
            filling = -equations.scales[i] * flux / diagonal
            empty = np.setdiff1d(np.arange(len(flux)), self._full[i])
            pressures[empty] = filling[empty]
            found[i] = film.equation.nodal(np.maximum(pressures, 0.0))
        return found

    def _kept(self, guess: Unknowns | None) -> Unknowns:
        """A guess with no pressure where the film cavitates now."""
        own = self._unknowns
        if guess is None:
            return own.moved(own, -1.0)
        films, voids = [], dict(guess.voids)
        for i, (direction, full) in enumerate(zip(guess.films, self._full, strict=True)):
            film = np.zeros_like(direction)
            film[full] = direction[full]
            films.append(film)
            if i in voids:
                voids[i] = np.where(np.isin(np.arange(len(film)), full), 0.0, voids[i])
        return Unknowns(films, guess.rest, voids)

    def _correction(self, point: Point, amount: float) -> tuple[Unknowns, float]:
        """What is to be taken from a direction, for equations along it, and its size."""
        equations, here = self.view.equations, self._point
        films: list[np.ndarray] = []
        for own, other, full in zip(here.films, point.films, self._full, strict=True):
            film = np.zeros_like(own.defect)
            film[full] = (other.defect[full] - own.defect[full]) / amount
            films.append(film)
        taken: dict[int, np.ndarray] = {}
        for i in equations.voids:
            own, other = here.films[i], point.films[i]
            assert own.oil is not None
            assert other.oil is not None
            defect = (other.oil.defect - own.oil.defect) / amount
            full = self._full[i]
            films[i], taken[i] = equations.oil(i).given(own.oil, full, films[i], defect)
        rest = (point.rest - here.rest) / amount
        found = self._factors.update(here, self._full, films, rest)
        pressures, voids = [], {}
        for i, (film, full) in enumerate(zip(found.pressures, self._full, strict=True)):
            pressures.append(np.zeros_like(film))
            pressures[i][full] = film[full]
            if i in taken:
                voids[i] = film.copy()
                voids[i][full] = taken[i][full]
        return Unknowns(pressures, found.rest, voids), found.size


def _slope(there: Columns, here: Columns, amount: float) -> Columns:
    return {
        joint: {name: (there[joint][name] - value) / amount for name, value in columns.items()}
        for joint, columns in here.items()
    }
