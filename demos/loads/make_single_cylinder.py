"""Write single_cylinder.csv: the built-in main-bearing load at 300 rad/s, as a file.

The formula and its figures are in `fenics_ehd.scenes.engine_load`; nothing of it is
measured. Run it with

    python demos/loads/make_single_cylinder.py
"""

from pathlib import Path

import numpy as np
from fenics_ehd.scenes.engine_load import engine_load

SPEED = 300.0  # rad/s
FILE = Path(__file__).with_name("single_cylinder.csv")

HEADER = f"""\
# Load on one of two main bearings of a single-cylinder four-stroke engine at {SPEED:g} rad/s.
# Computed by demos/loads/make_single_cylinder.py from a formula, not measured.
# x from the crankshaft to the cylinder, y 90 degrees on in the direction of rotation.
time_s,Fx_N,Fy_N"""


def main(path: Path = FILE) -> Path:
    """Write the file."""
    load = engine_load(SPEED)
    rows = np.column_stack([load.times, load.forces])
    lines = [f"{time:.7e},{x:.3f},{y:.3f}" for time, x, y in rows]
    path.write_text("\n".join([HEADER, *lines]) + "\n")
    return path


if __name__ == "__main__":
    print(main())
