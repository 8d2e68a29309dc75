"""A periodic orbit that was found, for a run on other films or in other steps to begin on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import process_time

from fenics_ehd.base.errors import SolverError
from fenics_ehd.base.interrupt import interrupt_between_steps
from fenics_ehd.multibody.other_films import on_finer_films
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.reduction import ReducedBody


@dataclass(frozen=True, eq=False)
class Orbit:
    """Of a run that has come to its end.

    Attributes
    ----------
    run, cycles
        The run, and its search for the periodic solution.
    parts
        Flexible bodies by name.
    """

    run: Run
    cycles: Cycles
    parts: Mapping[str, ReducedBody]

    def entered(
        self, run: Run, parts: Mapping[str, ReducedBody]
    ) -> tuple[MechanismStep, float] | None:
        """Lead a run at its start, of the same bodies, from the middle of the cycle to its end.

        What is different on its films, or in its steps, has half a cycle to fade before the first
        one that counts: most have forgotten it then, and need no second one.

        Returns
        -------
        step, seconds
            The last one, and processor time that it took [s]; None: the run stays at its start, as
            its state means something else, temperatures of films belong to it, or no step leads on.
        """
        own, other = self.run.solve, run.solve
        same = all(parts[name] is part for name, part in self.parts.items())
        if (
            own.system.heated
            or not same
            or own.equations.responses.size != other.equations.responses.size
        ):
            return None
        began, start = process_time(), run.state
        run.state = on_finer_films(self.cycles.halfway, own, other)
        try:
            with interrupt_between_steps() as check:
                steps, last = run.until(self.cycles.number * self.cycles.period), None
                while step := next(steps, None):
                    check()
                    last = step
        except SolverError:
            run.state = start
            return None
        return None if last is None else (last, process_time() - began)
