"""What the folder of a run says of its mechanism's motion, at any instants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline, interp1d

from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.results.history_file import read_fields, read_history

#: What the columns and fields of a lubricated joint end with.
PEAK, PRESSURE = "max_pressure_Pa", "pressure_Pa"


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """Recorded steps, or instants between them.

    Attributes
    ----------
    time
        Ascending, shape (t,) [s].
    coordinates, rates
        Of the mechanism, shape (t, n).
    quasi_static
        Amplitudes of the residual patterns of M4, shape (t, r) [Pa]; r = 0 for other methods.
    pressures
        At the film nodes of every lubricated joint by name, shape (t, k) [Pa].
    """

    time: np.ndarray
    coordinates: np.ndarray
    rates: np.ndarray
    quasi_static: np.ndarray
    pressures: Mapping[str, np.ndarray]

    def each(self, change: Callable[[np.ndarray], np.ndarray]) -> RecordedMotion:
        """Its values with their first axis changed."""
        return RecordedMotion(
            change(self.time),
            change(self.coordinates),
            change(self.rates),
            change(self.quasi_static),
            {name: change(values) for name, values in self.pressures.items()},
        )

    def nearest(self, count: int) -> RecordedMotion:
        """At most `count` recorded steps, spread as evenly as they lie."""
        wanted = np.linspace(self.time[0], self.time[-1], count)
        chosen = np.unique(np.abs(self.time[:, None] - wanted).argmin(axis=0))
        return self.each(lambda values: values[chosen])

    def at(self, time: np.ndarray) -> RecordedMotion:
        """Instants [s] within the recorded ones.

        Coordinates follow the cubics of values and rates, or joints would come apart between
        two steps; all else follows straight lines.
        """
        cubics = CubicHermiteSpline(self.time, self.coordinates, self.rates)
        straight = self.each(lambda values: interp1d(self.time, values, axis=0)(time))
        return replace(straight, coordinates=cubics(time))


def read_motion(directory: str | Path, mechanism: Mechanism) -> RecordedMotion:
    """Steps of a run, also of one that goes on or was killed.

    Parameters
    ----------
    directory
        Of the run.
    mechanism
        That it was of.

    Raises
    ------
    InputError
        The folder holds no history of at least one step with its fields.
    """
    joints = [n for n, joint in mechanism.joints.items() if isinstance(joint, LubricatedJoint)]
    named = {f"{name}.{PRESSURE}" if len(joints) > 1 else PRESSURE: name for name in joints}
    fields = read_fields(directory, ("coordinates", "rates", *named))
    fields |= read_fields(directory, ("quasi_static",), optional=True)
    time = read_history(directory)["time_s"]
    # Rows of the CSV reach the disk one by one, those of the fields in blocks.
    steps = min(len(time), *(len(values) for values in fields.values()))
    patterns = fields.get("quasi_static", np.zeros((steps, 0)))
    pressures = {name: fields[field] for field, name in named.items()}
    motion = RecordedMotion(time, fields["coordinates"], fields["rates"], patterns, pressures)
    return motion.each(lambda values: values[:steps])


def joint_histories(directory: str | Path) -> dict[str, dict[str, np.ndarray]]:
    """Columns of every lubricated joint by its name, that of a run's only one empty.

    Their ``time_s`` is that of the cycle where the run is periodic.

    Raises
    ------
    InputError
        See `read_history`.
    """
    history = read_history(directory)
    time = history.get("cycle_time_s", history["time_s"])
    found = {}
    for prefix in (name.removesuffix(PEAK) for name in history if name.endswith(PEAK)):
        own = {n.removeprefix(prefix): v for n, v in history.items() if n.startswith(prefix)}
        found[prefix.removesuffix(".")] = own | {"time_s": time}
    return found
