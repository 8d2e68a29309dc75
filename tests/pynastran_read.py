"""Matrices of a superelement by pyNastran, in a Python that has pyNastran alone.

    python tests/pynastran_read.py OP4 DMIG OUTPUT

OUTPUT gets, as JSON, the version of pyNastran, and what it reads from the two files: shape, sum of
absolute values and frequencies of K and M, names of the rows, and the positions of the grid points.
The script does not import this package, whose NumPy may be another one.
"""

import json
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
from pyNastran.bdf.bdf import BDF
from pyNastran.op4.op4 import read_op4
from scipy.linalg import eigh


def described(stiffness: np.ndarray, mass: np.ndarray) -> dict:
    """Figures of a pair of matrices."""
    squares = eigh(stiffness, mass, eigvals_only=True)
    return {
        "shape": list(stiffness.shape),
        "sums": [float(np.abs(stiffness).sum()), float(np.abs(mass).sum())],
        "frequencies": (np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi)).tolist(),
    }


def main() -> None:
    """Read the two files, and write what they have."""
    op4, dmig, output = sys.argv[1:]
    matrices = read_op4(op4)
    dense = {name: matrix.data for name, matrix in matrices.items()}
    deck = BDF(debug=False)
    deck.read_bdf(dmig, punch=True, xref=False)
    stiffness, rows, _ = deck.dmig["KAAX"].get_matrix(is_sparse=False, apply_symmetry=True)
    mass, _, _ = deck.dmig["MAAX"].get_matrix(is_sparse=False, apply_symmetry=True)
    found = {
        "version": version("pyNastran"),
        "op4": described(dense["KAA"], dense["MAA"]),
        "bores": [*dense["UBORE"].shape, float(np.abs(dense["UBORE"]).sum())],
        "dmig": described(stiffness, mass),
        "rows": [[int(number) for number in rows[index]] for index in sorted(rows)],
        "positions": {str(n): node.xyz.tolist() for n, node in deck.nodes.items()},
    }
    Path(output).write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
