"""Superelement of the shipped rod, read back by pyNastran.

    python tests/pynastran_case.py --python .venv/pynastran/bin/python [-o OUTPUT]

pyNastran needs other versions of NumPy and SciPy than this package: it runs in a process of its
own with the given Python, from a virtual environment without system packages, and gets the exported
files (`tests/pynastran_read.py`). What it read is stored; `tests/test_superelement.py` compares
with the stored figures.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

from mpi4py import MPI
from scene_cases import structure

import fenics_ehd as ehd
from fenics_ehd.reduction.superelement import export_dmig, export_op4

#: Number of fixed-boundary modes of the rod, and changes of its mesh.
MODES = 10
COARSE = {"bodies.rod.geometry.bore_cells_around": 20, "bodies.rod.geometry.bore_cells_along": 2}


def reduced_rod() -> ehd.ReducedBody:
    """Shipped rod on a coarse mesh, reduced by M1."""
    part = structure("slider-crank-paper", "rod", MPI.COMM_SELF, COARSE)
    return ehd.craig_bampton(part, MODES, estimate_error=False)


def main() -> None:
    """Export the rod, and store what pyNastran reads."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--python", required=True, help="Python that has pyNastran")
    parser.add_argument("-o", "--output", default="tests/golden/pynastran.json")
    options = parser.parse_args()
    body = reduced_rod()
    script = Path(__file__).with_name("pynastran_read.py")
    with tempfile.TemporaryDirectory() as name:
        files = [
            export_op4(body, Path(name) / "rod.op4"),
            export_dmig(body, Path(name) / "rod.dmig"),
        ]
        subprocess.run([options.python, script, *files, options.output], check=True)


if __name__ == "__main__":
    main()
