"""What a run answers: one object, whether the run was in memory or is read from its folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_ehd.base.columns import DIMENSIONLESS, Quantity, joint_prefix, with_unit
from fenics_ehd.base.errors import InputError

if TYPE_CHECKING:  # not there for everyone
    from pandas import DataFrame

#: Change of an array over the steps.
Change = Callable[[np.ndarray], np.ndarray]

NAN = float("nan")

#: Share of a period that a whole cycle may lack: rounding.
WHOLE = 1e-6


def last_whole_cycle(numbers: np.ndarray, time: np.ndarray) -> slice:
    """Steps of the last whole cycle of a search, of one that has none all of them.

    Parameters
    ----------
    numbers, time
        Of the cycle at every step, and the time since its start, shape (steps,).
    """
    first = int(np.searchsorted(numbers, numbers[-1]))
    if not first or time[-1] >= (1.0 - WHOLE) * time[first - 1]:
        return slice(first, None)
    return slice(int(np.searchsorted(numbers, numbers[-1] - 1)), first)


@dataclass(frozen=True, eq=False)
class Quantities(Mapping[str, Quantity]):
    """Quantities over the steps of a run, each of shape (steps,), by name or as attributes.

    Parameters
    ----------
    quantities
        By name, ``max_pressure``.
    """

    quantities: Mapping[str, Quantity]

    def __getitem__(self, name: str) -> Quantity:
        return self.quantities[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.quantities)

    def __len__(self) -> int:
        return len(self.quantities)

    def __getattr__(self, name: str) -> Quantity:
        found = self.__dict__.get("quantities", {})
        if name not in found:
            raise AttributeError(f"no {name!r} here, only {', '.join(found) or 'nothing'}")
        return found[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.quantities]

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Plain arrays by names with units, ``max_pressure_Pa``."""
        return {with_unit(name, v.units): np.asarray(v) for name, v in self.items()}

    def each(self, change: Change) -> Any:
        """Its values with their first axis changed."""
        found = {name: Quantity(change(v), v.units) for name, v in self.quantities.items()}
        return replace(self, quantities=found)

    def _pair(self, name: str) -> Quantity:
        """Components along x and y, shape (steps, 2)."""
        x, y = self[f"{name}_x"], self[f"{name}_y"]
        return Quantity(np.column_stack([x, y]), x.units)


@dataclass(frozen=True, eq=False)
class FilmResult:
    """The film of a joint at its own nodes.

    Attributes
    ----------
    angle, height
        Of the nodes on the bore, in its frame, shape (nodes,) [rad], [m].
    cells
        Nodes of every cell: its corners (at the first angle and height, at the second angle, at
        the second height, at both), then edges and centre where `family` has them, shape (c, v).
    family
        ``"bilinear"``, ``"serendipity"`` (8-node) or ``"lagrange"`` (9-node).
    radius, clearance
        Of the bore [m].
    pressure, gap
        shape (steps, nodes) [Pa], [m].
    fluid_fraction
        Likewise where oil is conserved, else None.
    """

    angle: Quantity
    height: Quantity
    cells: np.ndarray
    family: str
    radius: float
    clearance: float
    pressure: Quantity
    gap: Quantity
    fluid_fraction: Quantity | None = None

    def each(self, change: Change) -> FilmResult:
        """What it has of every step with the first axis changed."""
        fraction = self.fluid_fraction
        return replace(
            self,
            pressure=Quantity(change(self.pressure), "Pa"),
            gap=Quantity(change(self.gap), "m"),
            fluid_fraction=fraction
            if fraction is None
            else Quantity(change(fraction), DIMENSIONLESS),
        )


@dataclass(frozen=True, eq=False)
class JointResult(Quantities):
    """A lubricated joint over the steps of a run.

    It has ``max_pressure``, ``min_film_thickness``, ``max_pressure_angle``, and what its models
    add: ``friction_torque``.

    Attributes
    ----------
    nodal
        Its film, None where it was not read.
    """

    nodal: FilmResult | None = None

    @property
    def film(self) -> FilmResult:
        """Pressure and gap at every node of the film.

        Raises
        ------
        InputError
            They were not read.
        """
        if self.nodal is None:
            raise InputError("the films were not read: load_results(DIR, films=True)")
        return self.nodal

    @property
    def eccentricity(self) -> Quantity:
        """Of the journal in the undeformed bore's frame, shape (steps, 2) [m]."""
        return self._pair("eccentricity")

    @property
    def force(self) -> Quantity:
        """Of the film on the journal in the frame at rest, shape (steps, 2) [N]."""
        return self._pair("force")

    def each(self, change: Change) -> JointResult:
        """See `Quantities`."""
        nodal = None if self.nodal is None else self.nodal.each(change)
        return replace(super().each(change), nodal=nodal)


@dataclass(frozen=True, eq=False)
class BodyResult(Quantities):
    """A body over the steps of a run.

    It has ``x``, ``y`` and ``angle`` of its frame and ``speed``, its angular one, as far as it can
    move that way.

    Attributes
    ----------
    coordinates, rates
        Of the frame, then of the elastic modes, shape (steps, n).
    """

    coordinates: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    rates: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def each(self, change: Change) -> BodyResult:
        """See `Quantities`."""
        changed = {name: change(getattr(self, name)) for name in ("coordinates", "rates")}
        return replace(super().each(change), **changed)


@dataclass(frozen=True, eq=False)
class Result:
    """A run.

    Attributes
    ----------
    time
        Of the accepted steps, shape (steps,) [s]; of one cycle of a periodic run, since its start.
    joints
        Lubricated joints by name.
    bodies
        By name, those that can move.
    run
        Of all: energies, works, steps.
    coordinates, rates
        Of the mechanism, shape (steps, n).
    quasi_static
        Amplitudes of the residual patterns of M4, shape (steps, r) [Pa]; r = 0 for other methods.
    summary
        As in ``summary.json``; nothing of a run that goes on or was killed.
    scene
        Tables of the scene file as the run read it; nothing of a mechanism made in Python.
    """

    time: Quantity
    joints: Mapping[str, JointResult]
    bodies: Mapping[str, BodyResult]
    run: Quantities
    coordinates: np.ndarray
    rates: np.ndarray
    quasi_static: np.ndarray
    summary: Mapping[str, Any]
    scene: Mapping[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.time)

    @property
    def status(self) -> str:
        """``"complete"``, or why the figures cannot be trusted, or that there are none."""
        return str(self.summary.get("status", "no summary: the run goes on or was killed"))

    @property
    def figures(self) -> Mapping[str, Mapping[str, Any]]:
        """What the summary has of every lubricated joint, by its name: extremes, and means."""
        if "joint" in self.summary:
            return {self.summary["joint"]: self.summary}
        return self.summary.get("joints", {})

    @property
    def newton_iterations(self) -> int:
        """In all, of a periodic run over all cycles."""
        return int(self.summary["newton_iterations"])

    @property
    def rejected_steps(self) -> int:
        """Likewise."""
        return int(self.summary["rejected_steps"])

    @property
    def energy_balance_error(self) -> float:
        """See `EnergyBalance`; nan without a summary."""
        return self._figure("energy_balance_error")

    @property
    def net_energy_balance_error(self) -> float:
        """Likewise."""
        return self._figure("net_energy_balance_error")

    @property
    def cycles(self) -> int:
        """Of a periodic run in all, else 0."""
        return int(self.summary.get("cycles", 0))

    @property
    def cycle_used(self) -> str:
        """Which part of the run `figures` whose names begin with ``cycle_`` are of."""
        return str(self.summary.get("cycle_used", ""))

    @property
    def cycle_start(self) -> float:
        """Where that part begins, since the run's start [s]."""
        return float(self.summary.get("cycle_start_s", 0.0))

    @property
    def periodicity_defect(self) -> float:
        """Largest change of a film from the cycle's start to its end, over the film; or nan."""
        return self._figure("periodicity_defect")

    def _figure(self, name: str) -> float:
        value = self.summary.get(name)
        return NAN if value is None else float(value)

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """All but films and modes by the names that ``history.csv`` has, units at their end."""
        groups: list[tuple[str, Quantities]] = [("", self.run)]
        groups += [(joint_prefix(name, self.joints), own) for name, own in self.joints.items()]
        groups += [(f"{name}.", body) for name, body in self.bodies.items()]
        return {f"{own}{name}": v for own, group in groups for name, v in group.columns.items()}

    def to_dataframe(self) -> DataFrame:
        """`columns` as a table of pandas over the time, its index ``time_s``.

        Raises
        ------
        InputError
            Pandas is not installed.
        """
        try:
            from pandas import DataFrame, Index
        except ImportError:
            raise InputError(
                "to_dataframe needs pandas, which is not installed (python3-pandas on Debian): "
                "install it, or take columns, a dictionary of arrays"
            ) from None
        columns = {name: v for name, v in self.columns.items() if name != "time_s"}
        return DataFrame(columns, index=Index(np.asarray(self.time), name="time_s"))

    def each(self, change: Change) -> Result:
        """The same with the first axis of all that it has of steps changed: some of them, say."""
        return replace(
            self,
            time=Quantity(change(self.time), "s"),
            joints={name: joint.each(change) for name, joint in self.joints.items()},
            bodies={name: body.each(change) for name, body in self.bodies.items()},
            run=self.run.each(change),
            coordinates=change(self.coordinates),
            rates=change(self.rates),
            quasi_static=change(self.quasi_static),
        )

    def last_cycle(self) -> Result:
        """Of a periodic run that was stopped its last whole cycle, from its start on.

        All of any other run, and of one that was stopped in its first cycle.
        """
        if not (len(self) and "cycle" in self.run):
            return self
        rows = last_whole_cycle(*(np.asarray(self.run[key]) for key in ("cycle", "cycle_time")))
        part = self.each(lambda values: values[rows])
        return replace(part, time=part.run["cycle_time"])
