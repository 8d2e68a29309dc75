"""M4 on a family of pressures: solves, verified error and time by level and by edges of the film.

    python benchmarks/pressure_family.py [--cells 20x5 40x10]

Prints a table of the slider-crank's rod: pressures of the family of all nodal ones, the verified
error, the error under the four verification pressures of an elastic run, and processor seconds of
the reduction. The static solver and the modes, which all levels share, are made before.
"""

from __future__ import annotations

import argparse
from time import process_time

from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.reduction.family_responses import largest_error
from fenics_ehd.reduction.pressure_family import ORDERS
from fenics_ehd.scenes.part import elastic_part

#: Edges of films by label [m]: grooves of 2.2 mm, pockets of 8.8 mm, rough ends.
EDGES = {
    "": (),
    "groove": (-1.1e-3, 1.1e-3),
    "pocket": (-4.4e-3, 4.4e-3),
    "rough ends": (float("-inf"), float("inf")),
}

#: Number of the verification pressures that are of an elastic run; they are the last ones.
OF_A_RUN = 4


def rod(cells: str) -> ehd.Structure:
    """The rod with cells around and along its bore, ``"20x5"``."""
    around, along = map(int, cells.split("x"))
    geometry = {
        "bodies.rod.geometry.bore_cells_around": around,
        "bodies.rod.geometry.bore_cells_along": along,
    }
    settings = ehd.read_scene("slider-crank-paper", **geometry).bodies["rod"]
    source = elastic_part(settings, "rod", "lagrange", MPI.COMM_SELF).source
    assert isinstance(source, ehd.Structure)
    return source


def row(structure: ehd.Structure, cells: str, label: str, tolerance: float) -> str:
    """Row of the table for one family."""
    reductor = ehd.Reductor(structure, film_edges={"bore": EDGES[label]})
    ehd.load_dependent(reductor, 6, 0, estimate_error=False)  # the factors and modes
    start = process_time()
    body = ehd.residual_flexibility(reductor, 6, tolerance=tolerance)
    seconds = process_time() - start
    verification = reductor.family_responses().verification
    of_a_run = verification.some(slice(-OF_A_RUN, None))
    solved = body.accuracy["flexibility_columns"]
    return (
        f"| {cells} | {label or '-'} | {body.provenance['pressure_level']} | "
        f"{solved:.0f} of {structure.pressures} | {body.flexibility_error:.1e} | "
        f"{largest_error(of_a_run, body):.1e} | {seconds:.2f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", nargs="*", default=["20x5", "40x10"])
    print("| bore | edges | level | solves | verified | of a run | s |")
    print("|---|---|---|---|---|---|---|")
    for cells in parser.parse_args().cells:
        structure = rod(cells)
        for label in EDGES:
            print(row(structure, cells, label, 2e-3), flush=True)
        for level in range(1, len(ORDERS) + 1):
            # No level before reaches it.
            tolerance = 0.0 if level == len(ORDERS) else 1e-4
            print(row(structure, cells, "", tolerance), flush=True)


if __name__ == "__main__":
    main()
