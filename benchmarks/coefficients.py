"""Coefficients and stability limits on one film mesh and as means over four, against fine meshes.

    python benchmarks/coefficients.py [--bearings] [--rotor]

The bearing is narrow: radius 15 mm, width 10 mm, clearance 30 um, isoviscous. Errors of stiffness
and damping are over the largest entry of their matrix. The error of one mesh is the largest of the
meshes with 0, 2, 4 and 6 cells more around. References have 240 x 32 cells, and are means
over six meshes with 0 to 10 cells more; their own scatter is printed, too.

The stability limit is the speed at which the shipped rotor on two bearings begins to whirl. Its
reference is a mean over 186, 192 and 198 cells around, with 16 along.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial

import attrs
import numpy as np
from scipy.optimize import brentq

import fenics_ehd as ehd
from fenics_ehd.analysis.dynamic_coefficients import stability
from fenics_ehd.analysis.rotor_map import MapSolver
from fenics_ehd.scenes.film_meshes import scenes_on_meshes

NARROW = ehd.BearingSettings(
    radius=0.015, width=0.010, clearance=30e-6, viscosity=0.02, speed=500.0, meshes=1
)
RATIOS = (0.1, 0.3, 0.6, 0.8)
CELLS = ((24, 6), (48, 8), (64, 12), (96, 16))
FINE = (240, 32)

#: Speeds between which the rotor begins to whirl [rad/s].
BRACKET = (700.0, 1200.0)


@cache
def on_meshes(ratio: float, cells: tuple[int, int], meshes: int) -> np.ndarray:
    """Stiffness and damping on meshes with 0, 2, ... cells more, shape (meshes, 2, 2, 2)."""
    parts = []
    for extra in range(0, 2 * meshes, 2):
        settings = attrs.evolve(NARROW, cells_around=cells[0] + extra, cells_along=cells[1])
        linear = ehd.solve_bearing(
            settings, eccentricity=ratio, with_coefficients=True
        ).coefficients
        assert linear is not None
        parts.append([linear.stiffness, linear.damping])
    return np.array(parts)


def whirl_mass(matrices: np.ndarray) -> float:
    """Critical mass of a rigid rotor from stiffness and damping; NaN if every mass is stable."""
    mass = stability(*matrices)[0]
    return np.nan if mass is None else mass


def print_bearings() -> None:
    """Errors of the narrow bearing's coefficients, and of its threshold speed at one load."""
    print("errors [%]: eccentricity, cells | stiffness: one mesh, mean, scatter | damping | limit")
    for ratio in RATIOS:
        fine = on_meshes(ratio, FINE, 6)
        reference = fine.mean(0)
        largest = np.abs(reference).max(axis=(1, 2))
        own = 0.5 * np.ptp(fine, axis=0).max(axis=(1, 2)) / largest
        print(f"{ratio}: scatter of the reference {np.round(100 * own, 2)}")
        for cells in CELLS:
            parts = on_meshes(ratio, cells, 4)
            single = (np.abs(parts - reference).max(axis=(2, 3)) / largest).max(axis=0)
            mean = np.abs(parts.mean(0) - reference).max(axis=(1, 2)) / largest
            scatter = 0.5 * np.ptp(parts, axis=0).max(axis=(1, 2)) / largest
            # The threshold speed is proportional to the root of the critical mass.
            expected = whirl_mass(reference)
            limits = [np.sqrt(whirl_mass(part) / expected) - 1 for part in parts]
            limit = np.sqrt(whirl_mass(parts.mean(0)) / expected) - 1
            columns = [
                " ".join(f"{100 * value[k]:5.2f}" for value in (single, mean, scatter))
                for k in (0, 1)
            ]
            print(
                f"  {cells[0]:3d} x {cells[1]:2d} | {columns[0]} | {columns[1]} | "
                f"{100 * np.abs(limits).max():5.2f} {100 * limit:5.2f}",
                flush=True,
            )


def rotor_on(cells: tuple[int, int]) -> ehd.Scene:
    """The shipped rotor on two bearings with numbers of film cells around and along."""
    films = {f"joints.{name}.cells": list(cells) for name in ("left", "right")}
    return ehd.read_scene("rotor-two-bearings", **films)


def limit_of(scenes: Sequence[ehd.Scene]) -> float:
    """Speed at which a rotor with the mean matrices of some scenes begins to whirl [rad/s]."""
    makers = [partial(turning, ehd.build(scene).mechanism) for scene in scenes]
    solver = MapSolver(makers, {})
    growth = brentq(lambda speed: solver.at(speed).largest_real_part, *BRACKET, xtol=0.05)
    return float(growth)


def turning(mechanism: ehd.Mechanism, speed: float) -> ehd.Mechanism:
    """The rotor at a speed [rad/s], under its weight alone."""
    return replace(mechanism, drives={"shaft": ehd.Speed(speed)}, forces={})


def print_rotor() -> None:
    """Stability limit of the shipped rotor on single meshes and on their means."""
    fine = [rotor_on((around, 16)) for around in (186, 192, 198)]
    reference = limit_of(fine)
    print(f"stability limit of rotor-two-bearings [rad/s]: {reference:.1f} on 186, 192, 198 x 16")
    for cells in ((24, 6), (32, 6), (48, 8), (64, 8)):
        scenes = scenes_on_meshes(rotor_on(cells), 4)
        single = [limit_of([scene]) for scene in scenes]
        mean = limit_of(scenes)
        print(
            f"  {cells[0]:3d} x {cells[1]:2d}: meshes {np.round(single, 1)}, mean {mean:.1f}, "
            f"errors {100 * np.abs(np.array(single) / reference - 1).max():.2f} and "
            f"{100 * (mean / reference - 1):.2f} %",
            flush=True,
        )


def main() -> None:
    """Print the tables that the arguments ask for, all of them without arguments."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bearings", action="store_true")
    parser.add_argument("--rotor", action="store_true")
    chosen = parser.parse_args()
    if chosen.bearings or not chosen.rotor:
        print_bearings()
    if chosen.rotor or not chosen.bearings:
        print_rotor()


if __name__ == "__main__":
    main()
