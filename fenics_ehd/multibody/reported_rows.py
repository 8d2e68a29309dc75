"""Quantities that are computed from recorded rows after the steps of a run.

Friction and side flow of a joint are reported for every run. If the joint needs them at its steps,
because shear acts on its bodies for instance, they are columns of every row. Otherwise they do not
slow the steps down: when the run has ended, `with_reported` computes them from coordinates, rates,
pressures and amplitudes of residual patterns in the recorded rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fenics_ehd.film.cavitation import CavitationResult
from fenics_ehd.film.film import FilmState
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.quantities import OUTPUTS, JointStep, joint_steps
from fenics_ehd.multibody.run import Run

#: Row of a step: numbers by path with unit, such as ``joints/big_end/force_x_N``, and arrays by
#: path.
Row = Mapping[str, Any]

#: Paths in a row of the amplitudes of residual patterns, and of their rates.
AMPLITUDES = "state/quasi_static"
AMPLITUDE_RATES = "state/quasi_static_rates"


def with_reported(run: Run, row: Row) -> dict[str, Any]:
    """Row of a step with all quantities that its joints report, in the order of the columns.

    Quantities that the row has already do not change.
    """
    complete = dict(row)
    for joint in recorded_joints(run, row):
        path = f"joints/{joint.binding.name}/"
        columns = {
            output.column: float(output.value(joint))
            for output in OUTPUTS
            if f"{path}{output.column}" not in row and output.reported(joint)
        }
        if columns:
            complete = _with_columns(complete, path, columns)
    return complete


def _with_columns(row: Row, path: str, columns: Mapping[str, float]) -> dict[str, Any]:
    """Row with further columns of the joint at a path, all in the order of their registration."""
    order = {output.column: number for number, output in enumerate(OUTPUTS)}
    joint = {name: v for name, v in row.items() if _is_quantity(name, path)}
    joint |= {f"{path}{column}": value for column, value in columns.items()}
    # Columns that are not registered, such as the flow of a supply, keep their position.
    position = -1
    positions = {}
    for name in joint:
        position = order.get(name.removeprefix(path), position)
        positions[name] = position
    ordered = {name: joint[name] for name in sorted(joint, key=positions.__getitem__)}
    complete: dict[str, Any] = {}
    for name, value in row.items():
        complete |= ordered if _is_quantity(name, path) else {name: value}
    return complete


def _is_quantity(name: str, path: str) -> bool:
    """Whether a name in a row is a column of the joint at a path, not a field of its film."""
    return name.startswith(path) and not name.startswith(f"{path}film/")


def recorded_joints(run: Run, row: Row) -> list[JointStep]:
    """All lubricated joints at the end of a recorded step.

    The states of their films have no oil contents and no flow at nodes of given pressure: these
    are not recorded.

    Parameters
    ----------
    run
        Run that took the step.
    row
        Row of the step.
    """
    equations = run.equations
    system = equations.system
    none = np.zeros(0)
    z = np.asarray(row["state/coordinates"])
    rates = np.asarray(row["state/rates"])
    amplitudes = np.asarray(row.get(AMPLITUDES, none))
    amplitude_rates = np.asarray(row.get(AMPLITUDE_RATES, none))
    gaps = [binding.gap(z, rates, float(row["time_s"])) for binding in system.films]
    equations.responses.add_amplitudes(amplitudes, amplitude_rates, gaps)
    x = np.concatenate([z, amplitudes])
    observed = run.norm.film_gaps(run.norm.observe(x))
    films = [
        _film_state(binding, gap, row) for binding, gap in zip(system.films, gaps, strict=True)
    ]
    multipliers = np.asarray(row["state/multipliers"])
    rate = np.concatenate([rates, amplitude_rates])
    return joint_steps(equations, films, multipliers, x, rate, observed)


def _film_state(binding: FilmBinding, gap: Gap, row: Row) -> FilmState:
    """State of a film from its gap and from the nodal fields in a row."""
    path = f"joints/{binding.name}/film"
    film = binding.film.film
    pressure = np.asarray(row[f"{path}/pressure"])
    nodal = pressure[film.free] / film.parameters.pressure_scale
    full = np.flatnonzero(nodal > 0.0)
    solution = CavitationResult(nodal, np.zeros_like(nodal), full, 0)
    return FilmState(pressure, gap, solution, row.get(f"{path}/fluid_fraction"))
