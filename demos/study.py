# # The error of each method against its time
#
# Which reduction method is best, and with how many modes? A study runs one machine with each of
# them. It compares run times, and errors of peak pressure and thinnest film relative to the full
# interface. `fenics-ehd study slider-crank-paper` is the large study. This is the smallest one that
# still shows a difference: four methods over the first degrees of a revolution. Run it with
#
#     python demos/study.py [FOLDER]
#
# A second call with the same folder runs only what is missing.

# +
import sys
from pathlib import Path
from typing import Any

from fenics_ehd.study.compare import StudyFolder, run_study
from fenics_ehd.study.plan import Scope, Study, film, full, m1, m2, m3, m4, make_study, steps
from fenics_ehd.study.pool import open_pool

# -

# ## What to run
#
# A variant is a name and settings: M1 and M2 get as many modes as M3 has vibration and residual
# modes together. The reference keeps the response to every nodal pressure, which is none of the
# compared methods, and takes finer steps. Its own errors are measured too: with other steps,
# another film mesh, and fewer vibration modes. Errors below them have no meaning.
#
# The rod is coarse, with 10 x 3 cells around the bore. Its film mesh has errors of some percent in
# pressure, but these are common to all methods, which are compared only with one another.

SCOPE = Scope(
    settings={
        "bodies.rod.geometry.bore_cells_around": 10,
        "bodies.rod.geometry.bore_cells_along": 3,
        "time.revolutions": 0.06,
        "reduction.estimate_error": False,
        **steps(1e-4),
    },
    methods=(m1(22), m2(22), m3("pc2", "lowest-frequency", 16), m4(6)),
    tolerances=(),
    stepped=(),
    films=(),
    meshed=(),
    finest_steps=steps(1e-5),
    reference=full(6),
    reference_steps=steps(1e-5),
    step_check=steps(1e-4),
    film_check=film(2),
    basis_check=(full(2), steps(1e-4)),
)


def plan() -> Study:
    """Study of the paper's slider-crank with this scope."""
    return make_study("slider-crank-paper", scope=SCOPE, start=2e-4)


# ## Run it
#
# First the bodies of the part are reduced, with one factorisation. Then the cases run, in any
# number of processes. Every case has its folder in `FOLDER/runs`, and `FOLDER/table.csv` is
# rewritten once a second.


def run(folder: Path, workers: int = 1) -> list[dict[str, Any]]:
    """Run the study; rows of its table."""
    study = plan()
    with open_pool(workers) as pool, StudyFolder(folder, study) as place:
        return run_study(place, pool)


# ## Read it
#
# With the same number of modes, M3 is several times closer to the full interface than M1 and M2. M4
# needs nine modes for the accuracy that the steps allow.


def main(folder: str | Path = "results/demo-study") -> dict[str, dict[str, Any]]:
    """Run the study, and print errors and times."""
    rows = {row["run"]: row for row in run(Path(folder)) if row["group"] == "methods"}
    print(f"{'':28}{'modes':>6}{'pressure':>10}{'film':>9}{'run':>8}")
    for name, row in rows.items():
        errors = f"{row['pressure_error_max']:10.2%}{row['film_error_max']:9.2%}"
        print(f"{name:28}{row['coordinates']:6}{errors}{row['online_s']:6.1f} s")
    return rows


if __name__ == "__main__":
    main(*sys.argv[1:])
