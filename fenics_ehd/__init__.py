"""Mechanisms with elastohydrodynamically lubricated revolute joints.

Importing the package imports nothing heavy: `fenics_ehd.reduction` works
without dolfinx, and ``fenics-ehd --help`` answers without either.
"""

__version__ = "0.2.0"
