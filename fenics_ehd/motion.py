"""What the folder of a run says of its machine's motion, at any instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fenics_ehd.output import read_fields, read_history


@dataclass(frozen=True, eq=False)
class Motion:
    """Recorded steps, or instants between them.

    Attributes
    ----------
    time
        Ascending, shape (t,) [s].
    columns
        Those of ``history.csv`` by name, shape (t,) each.
    coordinates
        Of the machine, the order as in its scene, shape (t, n).
    quasi_static
        Amplitudes of the residual patterns of M4, shape (t, r) [Pa]; r = 0 for other methods.
    pressure
        At the body's pressure nodes, shape (t, k) [Pa].
    """

    time: np.ndarray
    columns: Mapping[str, np.ndarray]
    coordinates: np.ndarray
    quasi_static: np.ndarray
    pressure: np.ndarray

    def steps(self, chosen: np.ndarray) -> Motion:
        """Some of the steps."""
        return Motion(
            self.time[chosen],
            {name: values[chosen] for name, values in self.columns.items()},
            self.coordinates[chosen],
            self.quasi_static[chosen],
            self.pressure[chosen],
        )

    def nearest(self, count: int) -> Motion:
        """At most `count` recorded steps, spread as evenly as they lie."""
        wanted = np.linspace(self.time[0], self.time[-1], count)
        return self.steps(np.unique(np.abs(self.time[:, None] - wanted).argmin(axis=0)))

    def at(self, time: np.ndarray) -> Motion:
        """Instants [s] within the recorded ones, by straight lines between the steps."""
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        before = after - 1
        share = (time - self.time[before]) / (self.time[after] - self.time[before])

        def between(values: np.ndarray) -> np.ndarray:
            weight = share.reshape(-1, *np.ones(values.ndim - 1, dtype=int))
            return (1 - weight) * values[before] + weight * values[after]

        return Motion(
            time,
            {name: between(values) for name, values in self.columns.items()},
            between(self.coordinates),
            between(self.quasi_static),
            between(self.pressure),
        )


def read_motion(directory: str | Path) -> Motion:
    """Steps of a run, also of one that goes on or was killed.

    Raises
    ------
    InputError
        The folder holds no history of at least one step with its fields.
    """
    columns = read_history(directory)
    fields = read_fields(directory, ("coordinates", "pressure_Pa"))
    fields |= read_fields(directory, ("quasi_static",), optional=True)
    # Rows of the CSV reach the disk one by one, those of the fields in blocks.
    steps = min(len(columns["time_s"]), *(len(values) for values in fields.values()))
    fields = {name: values[:steps] for name, values in fields.items()}
    return Motion(
        columns["time_s"][:steps],
        {name: values[:steps] for name, values in columns.items()},
        fields["coordinates"],
        fields.get("quasi_static", np.zeros((steps, 0))),
        fields["pressure_Pa"],
    )


def crank_angles(motion: Motion, speed: float) -> np.ndarray:
    """Angle of a crank that keeps its speed [rad/s], or that of a free one, shape (t,) [rad]."""
    return motion.columns.get("crank_angle_rad", speed * motion.time)
