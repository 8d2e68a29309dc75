"""Time and memory of the reductions: against SciPy, on one and two ranks, and against size.

    python benchmarks/reduction.py compare [SIZE ...]     default 9000 20000 60000
    python benchmarks/reduction.py scale [SIZE ...]       M3 (Pc2) on two ranks, default to 500000

Every figure comes from a process of its own (`reduction_case.py`), the repetitions of all
programs in turn; medians. Seconds are those of the reduction alone, mesh and assembly left
out. Memory is the peak of a rank beyond what the assembled part took. One BLAS thread a rank.
`compare` also prints how far the results are from SciPy's; `scale` draws
`reduction_scaling.png`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fenics_ehd.base.processes import for_mpirun, mpirun

HERE = Path(__file__).parent
METHODS = ("m1-37", "m1-127", "m2-37", "m3-pc2", "m3-pc1", "m4")

#: SciPy has no two-step reduction, and its factors of larger parts take minutes a method.
SCIPY_METHODS = ("m1-37", "m1-127", "m3-pc2", "m3-pc1", "m4")


def run_case(
    program: str, method: str, size: int, ranks: int, options: list[str]
) -> dict[str, object]:
    """Run one reduction in processes of its own."""
    command = [sys.executable, str(HERE / "reduction_case.py"), program, method, str(size)]
    environment = for_mpirun() | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    if ranks > 1:
        command = [str(mpirun()), "-n", str(ranks), *command]
    done = subprocess.run(
        [*command, *options], env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no message"]
        tqdm.write(f"{program} {method} {size} on {ranks}: failed: {lines[-1]}")
        return {}
    return json.loads(done.stdout.strip().splitlines()[-1])


def median(results: list[dict], key: str) -> float:
    """Median of a figure over the repetitions that succeeded."""
    values = [np.max(r[key]) for r in results if r]
    return float(np.median(values)) if values else float("nan")


def memory(results: list[dict]) -> float:
    """Median of the largest growth of a rank [bytes]."""
    growth = [np.max(np.subtract(r["memory"], r["memory_before"])) for r in results if r]
    return float(np.median(growth)) if growth else float("nan")


def compare(sizes: list[int], repetitions: int) -> None:
    """Table of all methods against SciPy, on one and two ranks."""
    variants = [("scipy", 1), ("fenics_ehd", 1), ("fenics_ehd", 2)]
    print("      N  method   SciPy [s]  1 rank [s]  2 ranks [s]  SciPy/1  1/2  memory [MB]  defect")
    for size in sizes:
        for method in METHODS:
            found: dict[tuple[str, int], list[dict]] = {v: [] for v in variants}
            for _ in range(repetitions):
                for program, ranks in variants:
                    if program == "scipy" and method not in SCIPY_METHODS:
                        continue
                    found[program, ranks].append(run_case(program, method, size, ranks, []))
            reference, serial, parallel = (found[v] for v in variants)
            seconds = [median(r, "seconds") for r in (reference, serial, parallel)]
            value, expected = (median(r, "flexibility") for r in (serial, reference))
            print(
                f"{int(median(serial, 'size')):7d}  {method:7s}  {seconds[0]:9.2f}  "
                f"{seconds[1]:10.2f}  {seconds[2]:11.2f}  {seconds[0] / seconds[1]:7.1f}  "
                f"{seconds[1] / seconds[2]:3.1f}  {memory(serial) / 1e6:11.0f}  "
                f"{abs(value / expected - 1):6.0e}",
                flush=True,
            )


def scale(sizes: list[int], method: str, ranks: int, options: list[str]) -> None:
    """Table and plot of one method against the size of the part."""
    rows = []
    print("      N  seconds  memory a rank [MB]")
    for size in sizes:
        result = run_case("fenics_ehd", method, size, ranks, options)
        if not result:
            continue
        row = (result["size"], result["seconds"], memory([result]), max(result["memory"]))
        rows.append(row)
        print(f"{row[0]:7d}  {row[1]:7.1f}  {row[2] / 1e6:18.0f}  (whole: {row[3] / 1e6:.0f})")
    if len(rows) > 1:
        draw(np.array(rows), f"{method}, {ranks} ranks")


def draw(rows: np.ndarray, title: str) -> None:
    """Time and memory against size, both logarithmic, with the exponents of the larger half."""
    import matplotlib.pyplot as plt

    from fenics_ehd.plotting.picture import save

    size, seconds, grown = rows[:, 0], rows[:, 1], rows[:, 2]
    half = len(rows) // 2
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for axis, values, label in (
        (axes[0], seconds, "time [s]"),
        (axes[1], grown / 1e9, "GB a rank"),
    ):
        exponent = np.polyfit(np.log(size[half:]), np.log(values[half:]), 1)[0]
        axis.loglog(size, values, "o-", label=f"exponent {exponent:.2f}")
        axis.set_xlabel("degrees of freedom")
        axis.set_ylabel(label)
        axis.grid(True, which="both", alpha=0.3)
        axis.legend()
        print(f"{label}: exponent {exponent:.2f}")
    figure.suptitle(title)
    save(figure, ["reduction_scaling.png"])


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["compare", "scale"])
    parser.add_argument("sizes", nargs="*", type=int)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--method", choices=METHODS, default="m3-pc2")
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--solver", choices=["auto", "direct", "iterative"], default="auto")
    arguments = parser.parse_args()
    if arguments.what == "compare":
        compare(arguments.sizes or [9000, 20000, 60000], arguments.repetitions)
        return
    sizes = arguments.sizes or [9000, 20000, 40000, 80000, 160000, 320000, 500000]
    options = ["--solver", arguments.solver]
    scale(sizes, arguments.method, arguments.ranks, options)


if __name__ == "__main__":
    main()
