"""Error of the slider-crank's curves against step tolerance and run time.

    python benchmarks/step_tolerance.py [revolutions]

Runs the paper's scene with M4 at falling tolerances and compares the curves of peak pressure and
minimum film, at the steps of each, with the tightest of them: pressure relative to its peak, film
thickness pointwise, both as maxima over the revolution.
"""

from __future__ import annotations

import sys

from scene_runs import METHOD, REVOLUTIONS, TOLERANCE, Curves, Parts, changed, difference, follow
from tqdm import tqdm

from fenics_ehd.multibody.run import Run

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)
REFERENCE = 1e-7

#: The first film build-up, from no pressure at all, is left out of the comparison [s].
START = 2e-4


def main(revolutions: float = 1.0) -> None:
    """Print the table."""
    scene = changed("slider-crank-paper", {METHOD: "m4", REVOLUTIONS: revolutions})
    parts = Parts()

    def run(tolerance: float) -> Curves:
        built = parts.build(changed(scene, {TOLERANCE: tolerance}))
        return follow(
            Run(built.mechanism, built.steps, scene.span),
            scene.span,
            fields=tolerance == REFERENCE,
            start=0.5 * START,
        )

    runs = {tolerance: run(tolerance) for tolerance in tqdm((*TOLERANCES, REFERENCE))}
    print("tolerance   steps  Newton  time [s]  p_max [MPa]  h_min [um]  "
          "pressure [%]  film [%]  energy")  # fmt: skip
    for tolerance in TOLERANCES:
        found = runs[tolerance]
        figures = found.figures
        pressure, film = difference(found, runs[REFERENCE], START)
        print(
            f"{tolerance:9.0e} {figures['steps']:7d} {figures['newton_iterations']:7d} "
            f"{found.seconds:9.2f} {figures['max_pressure_Pa'] / 1e6:12.3f} "
            f"{figures['min_film_thickness_m'] * 1e6:11.4f} "
            f"{100 * pressure:13.3f} {100 * film:9.3f} {figures['energy_balance_error']:9.1e}"
        )


if __name__ == "__main__":
    main(*(float(argument) for argument in sys.argv[1:]))
