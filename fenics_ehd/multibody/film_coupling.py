"""Coupling of one film's equations with all other unknowns of a step.

The *inputs* of a film are its coordinates xi, their rates, the relative speed of the journal, and
the amplitudes of the retained residual patterns of its surfaces. Its gap and the velocities of both
surfaces are linear in them. The *outputs* are the forces of the film's pressures on coordinates and
patterns. `FilmCoupling` converts the derivatives of any `FilmModel` with respect to its gap to
derivatives with respect to the unknowns of the step (`FilmBlock`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy import sparse

from fenics_ehd.multibody.border import FilmBlock
from fenics_ehd.multibody.film_models import FilmModel
from fenics_ehd.multibody.film_point import FilmPoint
from fenics_ehd.multibody.surface import TurningRows

#: Drift is the derivative of the rates of a joint's coordinates without that of ``xi' = shift xi``.
#: Derivatives contain drift only if it is above this share of the shift. It is 1e-8 in motion; in
#: mechanisms at rest whose bore turns, the rates consist of drift alone.
LEAST_DRIFT = 1e-4


class FilmCoupling:
    """Coupling of one film's equations with the other unknowns x of a step.

    Parameters
    ----------
    model
        Equations of the film.

    Attributes
    ----------
    model
        Equations of the film.
    retained_patterns
        Columns of the retained residual patterns among the inputs.
    """

    def __init__(self, model: FilmModel[Any]):
        self.model = model
        joint = model.binding.film
        turning = np.full((len(joint.thickness), 1), 0.5 * joint.shaft_radius)
        self._velocity = np.hstack([joint.mean_velocity, turning])
        self._sliding = np.hstack([joint.sliding_velocity, 2.0 * turning])
        self._coordinates = np.hstack([joint.thickness, np.zeros_like(turning)])
        self._forces = -model.columns(joint.load)

    def retain_patterns(self, gap: np.ndarray, patterns: np.ndarray) -> None:
        """Set the residual patterns that the derivatives retain.

        Parameters
        ----------
        gap
            Gap change at the Gauss points for unit amplitudes of k patterns, shape (g, k).
        patterns
            Static amplitudes of these patterns for unit nodal pressures, shape (k, nodes).
        """
        first = self._coordinates.shape[1]
        self._gap = np.hstack([self._coordinates, gap])
        self._patterns = -self.model.columns(patterns)
        self.retained_patterns = slice(first, first + len(patterns))

    def linearise(
        self,
        point: FilmPoint,
        shift: float,
        speed: np.ndarray,
        patterns: np.ndarray,
        share: float,
        size: int,
    ) -> FilmBlock:
        """Derivatives of the film's equations with respect to all unknowns of a step.

        Parameters
        ----------
        point
            Film evaluated at the current iterate.
        shift
            Shift of the step's formula ``x' = shift x + ...`` [1/s].
        speed
            Derivatives of the rates of all coordinates with respect to coordinates and multipliers,
            shape (coordinates, coordinates and multipliers).
        patterns, share
            Indices of the retained patterns among the unknowns, and their response within the step
            over the static response.
        size
            Number of unknowns other than pressures.
        """
        model = self.model
        binding = model.binding
        n = binding.film.size
        along_h, along_v, along_u = model.along_gap(point, shift)
        inputs = along_h @ self._gap
        velocity = along_v @ self._velocity
        if along_u is not None:
            velocity += along_u @ self._sliding
        inputs[:, :n] += shift * velocity[:, :n]
        inputs[:, n] += velocity[:, n]
        # Derivatives of the journal's relative angle and speed with respect to x.
        rotation = np.zeros((2, size))
        rotation[0, binding.turning] = binding.signs
        rotation[1, : speed.shape[1]] = binding.signs @ speed[binding.turning]
        spread = np.zeros((inputs.shape[1], size))
        spread[np.arange(n), binding.xi] = 1.0
        spread[n] = rotation[1]
        spread[np.arange(self.retained_patterns.start, len(spread)), patterns] = 1.0
        block = FilmBlock(
            model.pattern,
            model.along_unknowns(point),
            point.weights,
            inputs=model.rows(inputs),
            spread=spread,
            outputs=np.vstack([self._forces, share * self._patterns]),
            rows=np.concatenate([binding.xi, patterns]),
            gap=self._gap,
            along_gap=along_h,
        )
        drift = np.zeros((n, size))
        drift[:, : speed.shape[1]] = speed[binding.xi]
        drift[np.arange(n), binding.xi] -= shift
        if np.abs(drift).max() > LEAST_DRIFT:
            along = self._along_rate(point, shift, along_h) @ self._gap[:, :n] + velocity[:, :n]
            block = block.extended(model.rows(along), drift, np.zeros((len(self._gap), n)))
        feeds = model.film.equation.feeds
        if feeds is not None and feeds.turning:
            along = model.rows(model.along_turn(point))[:, None]
            block = block.extended(along, rotation[:1], np.zeros((len(self._gap), 1)))
        if point.turning is None:
            return block
        return self._with_turning_surface(block, point, point.turning, shift, speed)

    def _with_turning_surface(
        self,
        block: FilmBlock,
        point: FilmPoint,
        rows: TurningRows,
        shift: float,
        speed: np.ndarray,
    ) -> FilmBlock:
        """Return derivatives with inputs for the coordinates of a turning surface and their rates.

        `block` has the derivatives without these inputs.
        """
        binding = self.model.binding
        dofs = binding.turning_dofs
        selection = binding.turning_map
        # The derivative of the gap's rate by the coordinates is not the shift times that of the
        # gap.
        along_rate = self._along_rate(point, shift, block.along_gap)
        along = block.along_gap @ rows.gap + along_rate @ (rows.gap_rate - shift * rows.gap)
        inputs = self.model.rows(np.hstack([along, along_rate @ rows.gap]))
        k = len(selection)
        spread = np.zeros((2 * k, block.spread.shape[1]))
        spread[:k, dofs] = selection
        spread[k:, : speed.shape[1]] = selection @ speed[dofs]
        gap = np.hstack([rows.gap, np.zeros_like(rows.gap)])
        outputs = -selection.T @ self.model.columns(rows.load)
        return block.extended(inputs, spread, gap, (outputs, dofs))

    def _along_rate(
        self, point: FilmPoint, shift: float, along_gap: sparse.csc_matrix
    ) -> sparse.csc_matrix:
        """Derivative of the film's equations with respect to the rate of the gap, (nodes, g).

        `along_gap` is the derivative with respect to the gap h if its rate changes by ``shift dh``.
        It is linear in `shift`, and its slope is the result.
        """
        rate = self.model.film.parameters.rate
        return (self.model.along_gap(point, shift + rate)[0] - along_gap) / rate

    def with_matrix(self, former: FilmBlock, point: FilmPoint) -> FilmBlock:
        """Return earlier derivatives, with the film's matrices A and W computed anew at `point`."""
        return replace(former, entries=self.model.along_unknowns(point), weights=point.weights)

    def add_turning_stiffness(self, point: FilmPoint, core: np.ndarray) -> None:
        """Add the stiffness of pressure forces on a turning surface to the matrix `core`.

        The stiffness is the derivative of these forces with respect to the coordinates of the
        surface, at constant pressure.
        """
        if point.turning is None:
            return
        binding = self.model.binding
        pressure = self.model.film.parameters.pressure_scale * point.nodal
        stiffness = point.turning.stiffness(point.turning.load_derivative @ pressure)
        dofs = binding.turning_dofs
        core[np.ix_(dofs, dofs)] -= binding.turning_map.T @ stiffness @ binding.turning_map
