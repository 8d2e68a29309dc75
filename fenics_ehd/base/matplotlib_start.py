"""Import of matplotlib without options from the current folder, before any other import of it.

Matplotlib would prefer a file ``matplotlibrc`` in the current folder. Commands use no such file
(`command_start`); a program that imports the package keeps its own options.
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
