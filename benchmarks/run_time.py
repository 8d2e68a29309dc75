"""Run time of the slider-crank: what a scene pays for, and how time grows.

    python benchmarks/run_time.py [--extent 0.1] [--repetitions 3]

First a table of scenes from the rigid rod to M4 with a film mesh of its own: coordinates,
residual patterns, arrays kept and time a step. Then time against the number of modes, film nodes
and the step tolerance, with the exponents. Processor time of one process, medians, the variants
in turn.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from scene_runs import CELLS, METHOD, REVOLUTIONS, TOLERANCE, Curves, Parts, changed, follow

from fenics_ehd.multibody.run import Run
from fenics_ehd.scenes.build import Built

#: Residual modes of M3 that time is measured against.
MODES = (0, 8, 31, 70, 120)
MESHES = ([10, 3], [20, 5], [30, 8], [40, 10], [60, 15])
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)

REDUCTION, JOINT = "bodies.rod.reduction", "joints.big_end"

#: Values that a scene of the table has beside those of the paper's.
SCENES: dict[str, dict[str, Any]] = {
    "rigid": {METHOD: "rigid"},
    "m1, 37": {METHOD: "m1"},
    "m3, 31": {},
    "m3, film 30 x 7": {CELLS: [30, 7]},
    "m3, the same by mortar": {CELLS: [30, 7], f"{JOINT}.transfer": "mortar"},
    "m3, with friction": {f"{JOINT}.friction": True},
    "m4": {METHOD: "m4"},
}


class Bench:
    """Runs part of a revolution of the paper's scene."""

    def __init__(self, extent: float, repetitions: int):
        self._parts, self._extent, self._repetitions = Parts(), extent, repetitions

    def built(self, values: dict[str, Any]) -> tuple[Built, float]:
        """The scene with other values, and its end [s]."""
        common = {REVOLUTIONS: self._extent, f"{REDUCTION}.estimate_error": False}
        scene = changed("slider-crank-paper", common | values)
        return self._parts.build(scene), scene.span

    def measure(self, variants: dict[str, dict[str, Any]]) -> dict[str, tuple[float, Curves]]:
        """Median time of every variant [s], taken in turn, and its last run."""
        made = {name: self.built(values) for name, values in variants.items()}
        times: dict[str, list[float]] = {name: [] for name in variants}
        curves = {}
        for _ in range(self._repetitions):
            for name, (built, end) in made.items():
                curves[name] = follow(Run(built.mechanism, built.steps, end), end)
                times[name].append(curves[name].seconds)
        return {name: (float(np.median(times[name])), curves[name]) for name in variants}

    def table_of_scenes(self) -> None:
        """What each scene pays for."""
        print("| scene | coordinates | patterns | arrays | steps | iterations | ms a step |")
        print("|---|---|---|---|---|---|---|")
        for name, (seconds, curves) in self.measure(SCENES).items():
            built, end = self.built(SCENES[name])
            equations = Run(built.mechanism, built.steps, end).equations
            film = equations.system.films[0].film
            figures = curves.figures
            print(
                f"| {name} | {film.size} | {equations.responses.size} | "
                f"{kept_bytes(film, film.bore, *equations.responses.flexibilities) / 1e6:.1f} MB "
                f"| {figures['steps']} | {figures['newton_iterations']} | "
                f"{1e3 * seconds / figures['steps']:.2f} |",
                flush=True,
            )

    def growth(
        self,
        label: str,
        values: list[float],
        variant: Callable[[int], dict[str, Any]],
        *,
        per_step: bool,
    ) -> None:
        """Time against one quantity, with the exponent of its larger half."""
        found = self.measure({str(i): variant(i) for i in range(len(values))})
        steps = [curves.figures["steps"] for _, curves in found.values()]
        seconds = [
            time / (count if per_step else 1)
            for (time, _), count in zip(found.values(), steps, strict=True)
        ]
        print(f"\n| {label} | {'ms a step' if per_step else 's'} | steps |\n|---|---|---|")
        for value, time, count in zip(values, seconds, steps, strict=True):
            print(f"| {value:g} | {1e3 * time if per_step else time:.2f} | {count} |")
        half = len(values) // 2
        exponent = np.polyfit(np.log(values[half:]), np.log(seconds[half:]), 1)[0]
        print(f"\nexponent {exponent:.2f}", flush=True)


def kept_bytes(*owners: Any) -> int:
    """Arrays that a joint keeps."""
    arrays = [value for owner in owners if owner is not None for value in vars(owner).values()]
    return sum(value.nbytes for value in arrays if isinstance(value, np.ndarray))


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--extent", type=float, default=0.1, help="of a revolution")
    parser.add_argument("--repetitions", type=int, default=3)
    arguments = parser.parse_args()
    bench = Bench(arguments.extent, arguments.repetitions)
    bench.table_of_scenes()

    def with_modes(i: int) -> dict[str, Any]:
        return {f"{REDUCTION}.pressure_set": "pc1", f"{REDUCTION}.residual_modes": MODES[i]}

    coordinates = [10.0 + n for n in MODES]
    bench.growth("coordinates (m3)", coordinates, with_modes, per_step=True)
    nodes = [2.0 * around * (2 * along + 1) for around, along in MESHES]
    bench.growth("film nodes (m3)", nodes, lambda i: {CELLS: MESHES[i]}, per_step=True)

    def with_tolerance(i: int) -> dict[str, Any]:
        return {METHOD: "m4", TOLERANCE: TOLERANCES[i]}

    bench.growth("tolerance (m4)", list(TOLERANCES), with_tolerance, per_step=False)


if __name__ == "__main__":
    main()
