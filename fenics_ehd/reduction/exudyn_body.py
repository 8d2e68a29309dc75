"""A reduced part in Exudyn, from the file that fenics_ehd wrote beside this script.

Needs NumPy and Exudyn (tried with 1.13.6), and fenics_ehd no longer::

    python exudyn_body.py conrod.npz            prints the frequencies of the free part

    import exudyn, exudyn_body
    system = exudyn.SystemContainer()
    mbs = system.AddSystem()
    rod = exudyn_body.add_body(mbs, "conrod.npz", angular_velocity=(0, 0, 500))
    mbs.Assemble()

The file is also what Exudyn's own ``ObjectFFRFreducedOrderInterface.LoadFromFile`` reads. Nodes
of the mesh that markers may take: those of the bore, then one for every boundary point, which is
the mean of its surface.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

FORMAT = "fenics_ehd body for Exudyn"


class ExudynMissingError(ImportError):
    """Exudyn is not installed here."""


def _exudyn(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        raise ExudynMissingError(
            f"Exudyn cannot be imported ({error}): pip install exudyn, in an environment of its own"
        ) from None


def read(path: str | Path) -> dict[str, np.ndarray]:
    """All arrays of a file made by `export_exudyn`, which lists them.

    Raises
    ------
    ValueError
        It is not such a file.
    """
    with np.load(path, allow_pickle=False) as file:
        if "format" not in file or str(file["format"]) != FORMAT:
            raise ValueError(f"{path} is not a {FORMAT}")
        return {name: file[name] for name in file}


def add_body(
    mbs: Any,
    path: str | Path,
    *,
    position: tuple = (0.0, 0.0, 0.0),
    rotation: np.ndarray | None = None,
    velocity: tuple = (0.0, 0.0, 0.0),
    angular_velocity: tuple = (0.0, 0.0, 0.0),
    gravity: tuple = (0.0, 0.0, 0.0),
    damping_time: float = 0.0,
    name: str = "",
) -> dict[str, Any]:
    """Add the body, an ObjectFFRFreducedOrder with its two nodes, to an Exudyn system.

    Parameters
    ----------
    mbs
        Exudyn's MainSystem, not yet assembled.
    path
        File made by `export_exudyn`.
    position, rotation
        Where the bore's centre lies [m], and the rotation matrix (3, 3) of the part's axes;
        None: the unit matrix.
    velocity, angular_velocity
        Of the bore's centre [m/s] and of the part [rad/s], along the fixed axes, at the start.
    gravity
        [m/s^2].
    damping_time
        Structural damping is this times the stiffness: zeta of a fenics_ehd scene [s].
    name
        Of the object; that of its nodes begins with ``NodeRigidBody:`` and ``NodeGeneric:``.

    Returns
    -------
    dict
        Numbers in `mbs`: ``nRigidBody`` and ``nGenericODE2`` (nodes), ``oFFRFreducedOrder``
        (object), ``loadGravity`` (None without); ``points``: mesh node of each boundary
        point, ``bore``: mesh nodes of the bore, for ``meshNodeNumbers`` of a marker.

    Raises
    ------
    ExudynMissingError
        There is no Exudyn.
    ValueError
        `path` is no file of `export_exudyn`.
    """
    interface = _exudyn("exudyn.FEM").ObjectFFRFreducedOrderInterface()
    data = read(path)
    interface.LoadFromFile(str(path), mode="NPZ")
    added = interface.AddObjectFFRFreducedOrder(
        mbs,
        positionRef=list(position),
        initialVelocity=list(velocity),
        rotationMatrixRef=np.eye(3) if rotation is None else np.asarray(rotation),
        initialAngularVelocity=list(angular_velocity),
        stiffnessProportionalDamping=damping_time,
        gravity=list(gravity),
        name=name,
    )
    bore = int(data["bore_node_count"])
    points = {str(point): bore + i for i, point in enumerate(data["point_names"])}
    return {**added, "bore": list(range(bore)), "points": points}


def frequencies(path: str | Path) -> np.ndarray:
    """Frequencies that Exudyn finds for the free part, six of them zero but for round-off [Hz]."""
    system = _exudyn("exudyn").SystemContainer()
    mbs = system.AddSystem()
    add_body(mbs, path)
    mbs.Assemble()
    solve = _exudyn("exudyn.solver").ComputeODE2Eigenvalues
    return np.asarray(solve(mbs, convert2Frequencies=True)[0])


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python exudyn_body.py FILE.npz")
    try:
        for number, frequency in enumerate(frequencies(sys.argv[1]), 1):
            print(f"{number:4d}  {frequency:14.3f} Hz")
    except (ExudynMissingError, OSError, ValueError) as failure:
        sys.exit(str(failure))
