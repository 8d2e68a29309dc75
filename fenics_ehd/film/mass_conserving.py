"""Mass-conserving cavitation (Jakobsson and Floberg 1957, Olsson 1965).

The gap holds oil to the fraction ``theta = 1 - s``; where the film is full, s = 0,
and where it is not, the pressure is the cavitation pressure, p = 0. Per node i,
dimensionless as in `forms`, the oil is conserved,

    int k grad p . grad N_i - rho H V dN_i/dphi + (M_i - M_i^old) / dt - t(s)_i = 0,

``M_i = int rho H N_i`` the oil of a full gap, ``M_i^old`` what there was, t the limited
transport of the void fraction (`fenics_ehd.film.strips`), time by implicit Euler. That
is ``r(p) = t(s)`` with ``0 <= p`` complementary to ``s >= 0``, solved by SNES-VI
(`fenics_ehd.film.mass_conserving_solver`). The rate of the gap is the difference of two
contents, never `Gap.thickness_rate`: only so is no oil lost from step to step.

What a flow carries lies between two nodes, a share g >= 0 of that of the node it comes from.
With these shares as they are t is linear, no entry off the diagonals of A and t is positive and no
column sum negative; so it is for every matrix that takes the columns of full nodes from A and the
others from t, and all these are M-matrices: theta is not below 0. For A that wants bilinear cells,
strictly no longer than 1.4 times their width, in practice any we tried (theta > 0 at 9);
9-node cells are out, and it shows: theta = -0.1 beside the ends of a short groove.

Where the pressure is given above cavitation, and in grooves and holes at any
pressure, there is a reservoir: theta = 1 and oil flows in or out. A side at
cavitation pressure has none: there the unknown is the outflow, positive only
where the film is full, and zero where it is not. What `FilmParameters.feeds` conduct
into the film, ``w kappa (p_s - p)``, fills empty nodes with ``w kappa p_s``; it is lumped
at the nodes, and all matrices stay M-matrices.

What there is of oil in an empty place, and where it ends, is of second order in the mesh and of
first: a front lies between two nodes, of which one has no void.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.base.errors import CavitationError, SettingsError
from fenics_ehd.film.cavitation import CavitationResult
from fenics_ehd.film.film import Film, FilmState, check_gap
from fenics_ehd.film.kinematics import Gap, GapDerivatives
from fenics_ehd.film.mass_conserving_solver import MassConservingSolver
from fenics_ehd.film.oil_balance import OilBalance, OilProblem, OilStep, require_monotone
from fenics_ehd.film.oil_state import VOID_TOLERANCE, OilState, verify_oil

#: Time step of a steady film, times the reference speed: storage is 1e-10 of transport. It stays,
#: because round a bearing without groove nothing else says how much an empty strip holds.
STEADY_STEP = 1e10

#: Largest change of the content over one more such step: its sum without sign, over the content.
STEADY_TOLERANCE = 1e-6


class MassConservingFilm:
    """Transient film that keeps account of its oil.

    Parameters
    ----------
    film
        Bearing and oil, on a bilinear mesh.
    options_prefix, tolerance
        As for `MassConservingSolver`.

    Attributes
    ----------
    balance
        What it solves.
    cavitation
        What solves it.

    Raises
    ------
    SettingsError
        The mesh is not bilinear.
    """

    def __init__(
        self,
        film: Film,
        *,
        options_prefix: str = "oil_",
        tolerance: float = 1e-10,
    ):
        require_monotone(film.parameters.grid.family)
        self.film = film
        self.balance = OilBalance(film)
        self.cavitation = MassConservingSolver(
            self.balance.pattern,
            options_prefix=options_prefix,
            tolerance=tolerance,
        )

    def filled(self, gap: Gap, fluid_fraction: np.ndarray | float = 1.0) -> np.ndarray:
        """Oil content of a gap without pressure, to start from, shape (nodes,) [m^3]."""
        check_gap(gap, self.film.parameters.surfaces)
        filling = self.film.equation.factors[1] * self.film.equation.dimensionless(gap)[0]
        return self.balance.volume_scale * fluid_fraction * self.balance.stored(filling)

    def solve(
        self, gap: Gap, content: np.ndarray, time_step: float, guess: FilmState | None = None
    ) -> OilState:
        """One step of implicit Euler.

        Parameters
        ----------
        gap
            At the end of the step; its `thickness_rate` is not used.
        content
            Oil at the start, shape (nodes,) [m^3], `OilState.content` or `filled`.
        time_step
            [s].
        guess
            State to start the iteration from; it has no influence on the result.

        Raises
        ------
        GapClosedError
            The gap is not positive at a Gauss point.
        CavitationError
            SNES-VI failed, or the result is not what it should be: pressure or void
            fraction below 0, both above 0, a void fraction above 1, oil lost. Its `state`
            holds the arrays.
        SettingsError
            The time step or the content is not above zero.
        """
        check_gap(gap, self.film.parameters.surfaces)
        if not (np.isfinite(time_step) and time_step > 0):
            raise SettingsError(f"time_step = {time_step:g} s must be above 0")
        step = self.balance.step(gap, content, time_step)
        if not np.all(step.former >= -VOID_TOLERANCE * step.full):
            raise SettingsError(
                f"the oil content of the film is {np.min(content):g} m^3 at a node, it must be "
                "at least 0"
            )
        try:
            self._check_room(step)
            problem = self.balance.problem(step)
            result = self.cavitation.solve(problem, *self._start(guess))
            return self._state(gap, step, problem, result)
        except CavitationError as error:
            error.state.update({n: getattr(gap, n) for n in Gap.__dataclass_fields__})
            error.state["content"] = content
            raise

    def steady(self, gap: Gap, guess: FilmState | None = None) -> OilState:
        """Steady film: what remains after a time step without end.

        Parameters
        ----------
        gap
            At rest.
        guess
            As for `solve`; None: the film under Reynolds' condition.

        Raises
        ------
        SettingsError
            The gap changes, or no reservoir supplies oil.
        CavitationError
            From `solve`, or the state is not steady.
        """
        if not (self.balance.reservoir.any() or self.film.parameters.feeds):
            raise SettingsError(
                "a steady film that conserves mass needs a supply: a groove, a hole or an ambient "
                "pressure above 0"
            )
        if np.any(gap.thickness_rate):
            raise SettingsError(
                f"the gap changes by up to {np.abs(gap.thickness_rate).max():.3g} m/s: a steady "
                "film needs a gap at rest"
            )
        time_step = STEADY_STEP / self.film.parameters.rate
        start = self.solve(gap, self.filled(gap), time_step, guess or self.film.solve(gap))
        state = self.solve(gap, start.content, time_step, start)
        change = float(np.abs(state.content - start.content).sum() / start.content.sum())
        if not change <= STEADY_TOLERANCE:
            raise CavitationError(
                f"the film is not steady: its content still changes by {change:.2e}, the limit is "
                f"{STEADY_TOLERANCE:.0e}",
                state={"pressure": state.pressure, "void_fraction": 1 - state.fluid_fraction},
            )
        return state

    def _check_room(self, step: OilStep) -> None:
        """Refuse more incompressible oil than a closed film can hold."""
        oil, room = step.former.sum(), step.full.sum()
        closed = len(self.film.free) == len(step.full) and step.feed is None
        if closed and self.film.parameters.lubricant.density_law.constant and oil >= room:
            raise CavitationError(
                f"a film with no way out holds {oil / room:.6g} times the oil that it has room "
                "for: open a side"
            )

    def _start(self, guess: FilmState | None) -> tuple[np.ndarray, np.ndarray]:
        """Dimensionless pressures and void fractions of the unknown nodes to start from."""
        unknown = self.balance.unknown
        if guess is None:
            return np.zeros(len(unknown)), np.zeros(len(unknown))
        pressure = guess.pressure[unknown] / self.film.parameters.pressure_scale
        if guess.fluid_fraction is not None:
            return pressure, 1 - guess.fluid_fraction[unknown]
        # Reynolds' condition: where it cavitates the gap will not stay full.
        return pressure, np.where(pressure > 0, 0.0, 0.5)

    def _state(
        self, gap: Gap, step: OilStep, problem: OilProblem, result: CavitationResult
    ) -> OilState:
        """Check void fractions and balance, and give everything its unit."""
        p, b = self.film.parameters, self.balance
        nodal, void = b.nodal(result.pressure), np.zeros_like(step.full)
        void[b.unknown] = result.flux
        # What the balance lacks at the ends of the film flows through them.
        lost, outflow = b.ends(step, nodal, result.pressure, void)
        reference = np.sum(np.abs(step.flows) + step.full + step.former)
        if step.feed is not None:
            reference += np.sum(np.abs(step.feed.lumped(b.assembly, nodal)))
        stored = b.stored(b.oil(step, nodal).density * step.thickness)
        state = OilState(
            pressure=p.pressure_scale * nodal,
            gap=gap,
            cavitation=result,
            problem=problem,
            fluid_fraction=1 - void,
            content=b.volume_scale * (stored - step.length * step.full * void),
            outflow=b.volume_scale * p.rate * outflow,
            time_step=step.length / p.rate,
            imbalance=float(np.abs(lost + outflow).sum() / reference),
        )
        verify_oil(state)
        return state

    def sensitivity(
        self, state: OilState, derivatives: GapDerivatives
    ) -> tuple[np.ndarray, np.ndarray]:
        """Exact derivatives along changes of the gap at the end of a step.

        The active set, where flows come from, and the content at the start are held.

        Parameters
        ----------
        state
            A solution of this film.
        derivatives
            Changes of gap and mean velocity in n directions, each (cells, points, n);
            that of the gap's rate is not used.

        Returns
        -------
        pressure, fluid_fraction : numpy.ndarray
            shape (nodes, n) [Pa per unit], [1 per unit].
        """
        scale, balance = self.film.parameters.pressure_scale, self.balance
        step = balance.step(state.gap, state.content, state.time_step)
        change = balance.change(step, state.pressure / scale, 1 - state.fluid_fraction, derivatives)
        reduced = self.cavitation.derivative(
            balance.problem(step), state.cavitation, change[balance.unknown]
        )
        pressure, fraction = np.zeros((2, *change.shape))
        pressure[balance.unknown] = np.where(balance.dry[:, None], 0.0, reduced[0])
        fraction[balance.unknown] = -reduced[1]
        return scale * pressure, fraction
