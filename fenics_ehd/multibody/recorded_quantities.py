"""Recorded quantities of a joint, a body or the run over its steps, by name or as attributes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from fenics_ehd.base.columns import Quantity, with_unit
from fenics_ehd.base.described import Described, names_or_none, unknown_name, value_text
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.printed import near_names


@dataclass(frozen=True, eq=False)
class Quantities(Described, Mapping[str, Quantity]):
    """Quantities over the steps of a run, each of shape (steps,), by name or as attributes.

    Parameters
    ----------
    quantities
        Quantities by name without unit, such as ``max_pressure``.
    """

    quantities: Mapping[str, Quantity]

    def __getitem__(self, name: str) -> Quantity:
        if name not in self.quantities:
            raise unknown_name("quantities", name, self.quantities)
        return self.quantities[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.quantities)

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield the number of quantities, and the range of each with its unit."""
        yield type(self).__name__, f"{len(self)} quantities over the steps: {', '.join(self)}"
        for name, quantity in self.items():
            yield name, value_text(quantity)

    def __len__(self) -> int:
        return len(self.quantities)

    def __getattr__(self, name: str) -> Quantity:
        # A copy under construction has no attribute `quantities` yet.
        quantities = self.__dict__.get("quantities", {})
        if name not in quantities:
            near = " or ".join(near_names(quantities, name))
            hint = f"did you mean {near}? " if near else ""
            raise AttributeError(
                f"no quantity is named {name!r}: {hint}choose one of {names_or_none(quantities)}"
            )
        return quantities[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.quantities]

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Arrays of the quantities by name with unit, such as ``max_pressure_Pa``."""
        return {with_unit(name, v.units): np.asarray(v) for name, v in self.items()}

    def _pair(self, name: str) -> Quantity:
        """Vector of two columns, such as ``force_x`` and ``force_y`` for ``force``, (steps, 2)."""
        x = self[f"{name}_x"]
        y = self[f"{name}_y"]
        return Quantity(np.column_stack([x, y]), x.units)


#: Element family by number of nodes of a cell.
FAMILIES = {4: "bilinear", 8: "serendipity", 9: "lagrange"}


@dataclass(frozen=True, eq=False)
class FilmResult(Described):
    """Pressure and gap of a joint's film at the nodes of the film's mesh.

    Attributes
    ----------
    angle, height
        Positions of the nodes on the bore, in its frame, shape (nodes,) [rad], [m].
    cells
        Numbers of the v nodes of every cell, shape (c, v). First are the two corners at the smaller
        height, then the two at the larger height, each pair with the smaller angle first. Middles
        of edges and the centre follow if `family` has them.
    radius, clearance
        Radius and radial clearance of the bore [m].
    pressure, gap
        Pressure and film thickness at the nodes, shape (steps, nodes) [Pa], [m].
    fluid_fraction
        Share of the gap that is filled with oil, shape (steps, nodes); None without
        mass-conserving cavitation.
    """

    angle: Quantity
    height: Quantity
    cells: np.ndarray
    radius: float
    clearance: float
    pressure: Quantity
    gap: Quantity
    fluid_fraction: Quantity | None = None

    @property
    def family(self) -> str:
        """Element family: ``"bilinear"``, ``"serendipity"`` (8-node) or ``"lagrange"`` (9-node)."""
        return FAMILIES[self.cells.shape[1]]


@dataclass(frozen=True, eq=False)
class JointResult(Quantities):
    """Quantities of a lubricated joint over the steps of a run.

    Names are ``max_pressure``, ``min_film_thickness``, ``max_pressure_angle`` and others, and those
    of the joint's models, such as ``friction_torque``.

    Attributes
    ----------
    nodal
        Nodal fields of the film; None if they were not read.
    """

    nodal: FilmResult | None = None

    @property
    def film(self) -> FilmResult:
        """Pressure and gap at every node of the film.

        Raises
        ------
        InputError
            If the nodal fields were not read.
        """
        if self.nodal is None:
            raise InputError("the films were not read: use load_history(DIR, films=True)")
        return self.nodal

    @property
    def eccentricity(self) -> Quantity:
        """Eccentricity, x and y in the frame of the undeformed bore, shape (steps, 2) [m]."""
        return self._pair("eccentricity")

    @property
    def force(self) -> Quantity:
        """Force of the film on the journal, x and y in the frame at rest, shape (steps, 2) [N]."""
        return self._pair("force")


@dataclass(frozen=True, eq=False)
class BodyResult(Quantities):
    """Quantities of a body over the steps of a run.

    Names are ``x``, ``y``, ``angle`` and ``speed`` for position, angle and angular speed of the
    body's frame, if they can change.

    Attributes
    ----------
    coordinates, rates
        Coordinates of the frame, then of the elastic modes, and their rates, shape (steps, n).
    """

    coordinates: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    rates: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
