"""Values of a film in the state of the time integration: none, or its oil content.

The state x of the integration consists of the coordinates z, the amplitudes y of the residual
patterns, and the values that every film stores (`FilmContent`). The integrator differentiates them
like coordinates: a film returns values and rates at the end of a step, and receives the past values
at the start of the next one.

**Oil content.** With mass-conserving cavitation (JFO) the stored values follow from the oil
contents ``M = int rho h N (1 - s)`` of all nodes, with the void fraction s. The gap has a part that
is affine in z and y. The stored value of a node is the oil content of this part if it is full, less
M. The stored value is the sum of

- the void volume ``int rho h N s``;
- the volume by which a turning surface reduces the gap;
- between rough surfaces, minus the volume ``int rho (h_T - h) N`` that the average gap ``h_T`` has
  in addition.

A round film that is full everywhere therefore stores zeros, and its step agrees with that of the
Reynolds condition up to the last Newton iteration. Rates are differences of contents, so that the
oil of a closed film is constant to round-off with every formula of the integrator. Oil that is
compressed by pressure fills less than the volume of the gap at ambient density: its stored void
volumes are negative.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.film.oil_balance import OilBalance
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.film_point import FilmPoint, OilPoint

#: Largest relative increase of density by pressure in a stored state: the limit of Dowson and
#: Higginson's law for infinite pressure.
LARGEST_COMPRESSION = 0.6 / 1.7


class FilmContent:
    """Values of one film in the state of the time integration; in this base class there are none.

    A film with a memory from step to step, of a temperature for instance, needs a derived class.

    Parameters
    ----------
    first
        Index of the film's first value in the state.
    size
        Number of values.

    Attributes
    ----------
    size
        Number of values.
    indices
        Slice of the values in the state.
    """

    def __init__(self, first: int, size: int = 0):
        self.size = size
        self.indices = slice(first, first + size)

    def initial(self, z: np.ndarray) -> np.ndarray:
        """Values at the start of a run, for coordinates z, shape (size,)."""
        return np.zeros(self.size)

    def begin(self, step: ImplicitStep) -> None:
        """Start a time step: take the past values of this film from the formula `step`."""

    def at_end(self, point: FilmPoint, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values that the film stores in the state at the end of a step, and their rates.

        Both have the shape (size,). `point` has the equations of the film evaluated at the
        solution, z are the coordinates of the mechanism there.
        """
        return np.zeros(0), np.zeros(0)

    def keep_within(self, states: np.ndarray, observed: np.ndarray) -> None:
        """Bring the film's values in the first of several states into their physical range.

        Parameters
        ----------
        states
            States after an extrapolation or a perturbation, shape (k, n); the same correction is
            added to all of them, in place.
        observed
            Gap of the first state at the w points where gaps are observed, shape (w,) [m].
        """

    def void_fractions(self, state: np.ndarray, observed: np.ndarray) -> np.ndarray | None:
        """Void fractions of all nodes in a state, shape (nodes,); None if not stored.

        `observed` is the gap in this state at the points where gaps are observed [m].
        """
        return None

    def of_void_fractions(
        self, fractions: np.ndarray | None, z: np.ndarray, observed: np.ndarray
    ) -> np.ndarray:
        """Values that the film stores in the state for void fractions of all nodes, (size,).

        `fractions` is None for a full film; `observed` is the gap at the points where gaps are
        observed [m].
        """
        return np.zeros(self.size)

    def oil(self, state: np.ndarray, observed: np.ndarray) -> float:
        """Volume of oil in the film [m^3], for a state with the gap `observed`; 0 if not stored."""
        return 0.0


class OilContent(FilmContent):
    """Oil content of a film with mass-conserving cavitation, stored as volumes of all nodes.

    Parameters
    ----------
    binding
        Binding of the film to the mechanism.
    balance
        Oil balance of its film.
    first
        Index of the first value in the state.
    """

    def __init__(self, binding: FilmBinding, balance: OilBalance, first: int):
        super().__init__(first, balance.assembly.size)
        self._binding = binding
        self._balance = balance
        self._film = balance.film
        self._nodes = balance.unknown

    def full(self, thickness: np.ndarray) -> np.ndarray:
        """Oil content of the nodes if the gap is full, ``int rho h N`` over ``c R^2``, (nodes,).

        `thickness` is the gap h at the Gauss points [m]; ``c R^2`` is the unit of oil contents.
        """
        shape = self._film.assembly.area.shape
        thickness = thickness.reshape(shape) / self._film.parameters.clearance
        return self._film.assembly.source(self._film.equation.factors[1] * thickness)

    def _beyond_affine(self, z: np.ndarray, nominal: np.ndarray) -> np.ndarray:
        """Oil content of the affine part of the gap less that of all the gap, if both are full.

        The affine part is affine in the coordinates z. The gap differs from it by the shape of a
        turning surface, and between rough surfaces by the excess of the average gap over the
        `nominal` gap at the Gauss points [m]. The result has the shape (nodes,), in ``c R^2``.
        """
        surface = self._binding.film.turning
        surfaces = self._film.parameters.surfaces
        reduction = np.zeros(nominal.size)
        if surface is not None:
            coordinates = self._binding.turning_coordinates(z)
            reduction -= surface.gap_change(coordinates)[: nominal.size]
        if surfaces is not None:
            reduction -= surfaces.excess(nominal).ravel()
        return self.full(reduction)

    def initial(self, z: np.ndarray) -> np.ndarray:
        """Stored volumes for the initial filling of the joint, shape (nodes,) [m^3]."""
        gap = self._binding.gap(z, np.zeros_like(z), 0.0)
        void = np.full(self.size, 1.0 - self._binding.joint.initial_filling)
        return self.of_void_fractions(void, z, gap.thickness.ravel())

    def begin(self, step: ImplicitStep) -> None:
        """Start a time step: store the formula's shift, and its constant for the stored volumes."""
        self._shift = step.shift
        #: Constant of the stored volumes in the formula ``x' = shift x + past`` [m^3/s].
        self.past = step.past_x[self.indices]

    def at_end(self, point: FilmPoint, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stored volumes [m^3] and their rates [m^3/s] at the end of a step, (nodes,) each.

        They are computed from the flows, so that no oil is lost: the residual of the oil balance
        after the last Newton iteration is added to the volumes.
        """
        volumes = self.void_volumes(point)  # type: ignore[arg-type]
        beyond = self._beyond_affine(z, point.gap.thickness)
        volumes += self._balance.volume_scale * beyond
        return volumes, self._shift * volumes + self.past

    def void_volumes(self, point: OilPoint) -> np.ndarray:
        """Void volumes of all nodes, less the volume gained by compression, (nodes,) [m^3]."""
        volumes = point.step.full * point.transport.void
        volumes[self._nodes] += point.balance
        if not self._film.parameters.lubricant.density_law.constant:
            equation = self._film.equation
            density = equation.flow(point.gap, point.nodal).density - equation.factors[1]
            compressed = density * point.step.flow.thickness / point.step.length
            volumes -= self._film.assembly.source(compressed)
        return self._balance.volume_scale * point.step.length * volumes

    def _gap_and_full(self, observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gap at the Gauss points [m], and oil content of all nodes if this gap is full.

        `observed` is the gap at the points where gaps are observed, of which the Gauss points are
        the first [m]. The unit of the content is ``c R^2``.
        """
        surfaces = self._film.parameters.surfaces
        gap = observed[: self._film.assembly.area.size]
        return gap, self.full(gap if surfaces is None else gap + surfaces.excess(gap))

    def _full_and_void(
        self, state: np.ndarray, observed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Oil content of all nodes if the gap is full, in ``c R^2``, and void volumes [m^3].

        The gap in this state is `observed`. Void volumes are those of the nodes with unknowns.
        """
        gap, full = self._gap_and_full(observed)
        beyond = self._beyond_affine(state, gap)
        void = state[self.indices] - self._balance.volume_scale * beyond
        return full, void[self._nodes]

    def keep_within(self, states: np.ndarray, observed: np.ndarray) -> None:
        """Clip the void volumes of the first state to the range from zero to the gap's volume.

        Compressed oil may exceed the volume of the gap by `LARGEST_COMPRESSION`.
        """
        full, void = self._full_and_void(states[0], observed)
        full = self._balance.volume_scale * full[self._nodes]
        constant = self._film.parameters.lubricant.density_law.constant
        least = 0.0 if constant else -LARGEST_COMPRESSION
        change = np.zeros(self.size)
        change[self._nodes] = np.clip(void, least * full, full) - void
        states[:, self.indices] += change

    def oil(self, state: np.ndarray, observed: np.ndarray) -> float:
        """Volume of oil in the film [m^3], for a state with the gap `observed` [m]."""
        full, void = self._full_and_void(state, observed)
        return float(self._balance.volume_scale * full.sum() - void.sum())

    def void_fractions(self, state: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """Void fractions of all nodes, shape (nodes,), for a state with the gap `observed` [m]."""
        full, void = self._full_and_void(state, observed)
        fractions = np.zeros(self.size)
        full = self._balance.volume_scale * full[self._nodes]
        fractions[self._nodes] = np.clip(void / full, 0.0, 1.0)
        return fractions

    def of_void_fractions(
        self, fractions: np.ndarray | None, z: np.ndarray, observed: np.ndarray
    ) -> np.ndarray:
        """Volumes to store in the state for void fractions of all nodes, shape (nodes,) [m^3].

        `observed` is the gap at the points where gaps are observed [m].
        """
        gap, full = self._gap_and_full(observed)
        void = np.zeros(self.size)
        if fractions is not None:
            void[self._nodes] = (full * fractions)[self._nodes]
        return self._balance.volume_scale * (void + self._beyond_affine(z, gap))
