"""Import of matplotlib without options of the current folder, before any other import of it.

Matplotlib would read ``matplotlibrc`` there before any other file of options. Commands have no such
options (`command_start`); a program that imports the package keeps its own.
"""

from __future__ import annotations

import os

from fenics_ehd.base.command_start import MATPLOTLIB_OPTIONS
from fenics_ehd.base.processes import in_neutral_folder

if os.environ.get(MATPLOTLIB_OPTIONS) == os.devnull:
    with in_neutral_folder():
        import matplotlib
else:
    import matplotlib  # noqa: F401
