"""``fenics-ehd info`` and ``check``: versions of the libraries, and a test of the installation.

Imports inside functions: the libraries are imported by the checks that test them, so that a failed
import is reported as a failed check.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import click

from fenics_ehd.base.errors import VerificationError
from fenics_ehd.base.files import versions
from fenics_ehd.base.libraries import library_fault, origin
from fenics_ehd.base.needs import Needs
from fenics_ehd.base.processes import for_mpirun, mpirun
from fenics_ehd.cli.options import aligned, answer, echo, json_option, option, question


@question("Which versions of PETSc and FEniCSx (dolfinx) are installed?")
@click.command()
@click.option("--cache", is_flag=True, help="List the reduced bodies in the cache instead.")
@option(
    "--clear",
    is_flag=True,
    help="Remove all reduced bodies from the cache.",
    needs=(Needs(("cache",)),),
)
@json_option
def info(cache: bool, clear: bool, as_json: bool) -> None:
    """Show versions of libraries and the paths of the Gmsh models."""
    if cache:
        _cache(clear, as_json)
        return
    from importlib import resources

    facts = {**versions(installed=True), "package": str(resources.files("fenics_ehd"))}
    fault = library_fault()
    if fault:
        facts |= {"numpy_file": origin("numpy"), "fault": fault}
    else:
        from fenics_ehd.fem.models import model_path

        facts |= {f"{part}_model": str(model_path(part)) for part in ("conrod", "housing")}
    lines = "\n".join(f"{name:14s} {value}" for name, value in facts.items() if name != "fault")
    answer(facts, lines, as_json)
    if fault:
        raise VerificationError(fault)


def _cache(clear: bool, as_json: bool) -> None:
    """Print a list of the reduced bodies in the cache; with `clear`, remove all of them."""
    from fenics_ehd.scenes import kept_bodies

    path = kept_bodies.folder()
    entries = [] if path is None else kept_bodies.stored(path)
    size = sum(entry.size for entry in entries)
    facts: dict[str, object] = {"folder": path and str(path), "size_bytes": size}
    facts |= {"largest_size_bytes": kept_bodies.LARGEST_SIZE, "removed": len(entries) * clear}
    if path is None:
        answer(facts | {"bodies": []}, "no folder of reduced bodies is used", as_json)
        return
    if clear:
        for entry in entries:
            entry.remove()
        text = f"reduced bodies removed from {path}: {len(entries)}, with {_megabytes(size)}"
        answer(facts | {"bodies": []}, text, as_json)
        return
    bodies = [kept_bodies.described(entry) for entry in entries]
    most = _megabytes(kept_bodies.LARGEST_SIZE)
    head = f"reduced bodies in {path}: {len(bodies)}, with {_megabytes(size)} of at most {most}"
    rows = [
        [
            str(body["used"]),
            _megabytes(entry.size),
            f"{body['method']}, {body['modes']} modes",
            str(body["model"]),
            f"reduced in {body['reduction_time_s']:.1f} s",
        ]
        for entry, body in zip(entries, bodies, strict=True)
    ]
    lines = aligned(rows, words=(0, 2, 3, 4), indent="  ") if rows else []
    answer(facts | {"bodies": bodies}, "\n".join([head, *lines]), as_json)


def _megabytes(size: int) -> str:
    return f"{size / (1 << 20):.1f} MB"


#: Arguments of the test reduction: it takes a second and gives the same on any number of ranks.
REDUCE = (
    "reduce", "conrod", "--method", "m1", "--modes", "4", "--no-estimate-error", "--no-cache",
    "--json",
)  # fmt: skip

#: Timeout of the reduction in child processes [s], in case the ranks wait for each other.
PATIENCE = 300

#: Attitude angle of a bearing as wide as its diameter at eccentricity 0.6 [degrees], by the
#: method of Raimondi and Boyd's tables with Reynolds' condition, see `docs/validation.md`.
ATTITUDE = 51.98


@question("Does this installation work?")
@click.command()
def check() -> None:
    """Test this installation in about a minute: libraries, a reduction, a film, steps, ranks."""
    for name, version in versions(installed=True).items():
        echo(f"  {name:14s} {version}")
        if version == "missing":
            import_module(name)  # its error names the packages to install
    if fault := library_fault():
        raise VerificationError(fault)
    failures = []
    with TemporaryDirectory() as folder:
        for name, run in CHECKS.items():
            began = perf_counter()
            try:
                outcome = run(Path(folder))
            except Exception as error:  # any error is reported, and the other checks are run
                outcome = f"FAILED: {type(error).__name__}: {str(error).strip()}"
                failures.append(name)
            echo(f"  {name:14s} {outcome} ({perf_counter() - began:.1f} s)")
    if failures:
        raise VerificationError(f"this installation does not work: {', '.join(failures)}")
    echo("all checks passed")


def _film(_: Path) -> str:
    import numpy as np

    from fenics_ehd.analysis.bearing_settings import BearingSettings
    from fenics_ehd.scenes.bearing import solve_bearing

    settings = BearingSettings(radius=0.02, width=0.04, clearance=2e-5)
    attitude = np.degrees(solve_bearing(settings, eccentricity=0.6).attitude or 0.0)
    return _within(attitude, ATTITUDE, 0.1, "attitude angle {:.2f} degrees")


def _reduction(folder: Path) -> str:
    return f"lowest frequency {_lowest(folder, []):.1f} Hz"


def _lowest(folder: Path, launcher: list[str]) -> float:
    """Lowest natural frequency [Hz] of the test part after a reduction in a child process.

    `launcher` is the start of the command line of that process, for instance that of ``mpirun``.
    """
    command = [*launcher, sys.executable, "-m", "fenics_ehd.cli", *REDUCE, "-o"]
    done = subprocess.run(
        [*command, str(folder / "part.h5")],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        env=for_mpirun(),
    )
    if done.returncode:
        raise VerificationError(done.stderr.strip().rpartition("\n")[2])
    return float(json.loads(done.stdout)["frequencies_Hz"][0])


def _steps(folder: Path) -> str:
    from fenics_ehd.multibody.simulation import simulate
    from fenics_ehd.reduction.body import load_body
    from fenics_ehd.scenes.build import build
    from fenics_ehd.scenes.scene import read_scene

    body = load_body(folder / "part.h5")
    built = build(read_scene("slider-crank-paper"), bodies={"rod": body})
    steps = vars(built.steps) | {"tolerance": 1e-3}
    result = simulate(built.mechanism, 1e-4, **steps)
    error = result.summary()["energy_balance_error"]
    return _within(error, 0.0, 0.05, "energy balance error {:.1e}")


def _ranks(folder: Path) -> str:
    from fenics_ehd.reduction.body import load_body

    launcher = mpirun()
    if launcher is None:
        return "not tested: there is no mpirun"
    alone = load_body(folder / "part.h5").frequencies[0]
    on_two = _lowest(folder, [launcher, "-n", "2"])
    return _within(on_two / alone, 1.0, 1e-6, "on two ranks over one: {:.9f}")


def _within(value: float, expected: float, most: float, text: str) -> str:
    """Text of a measured value; the value is refused if it is not as expected.

    Raises
    ------
    VerificationError
        The value differs from the expected one by more than `most`.
    """
    if not abs(value - expected) <= most:
        raise VerificationError(f"{text.format(value)}, expected {expected:g} within {most:g}")
    return text.format(value)


#: Functions of the checks by name, in the order in which they are run.
CHECKS: dict[str, Callable[[Path], str]] = {
    "film": _film,
    "reduction": _reduction,
    "steps": _steps,
    "two ranks": _ranks,
}
