"""Forms of a film: derivatives of every law, other meshes, compilations that are killed."""

import logging
import os
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from differences import slope
from film_cases import ETA, FAMILIES, OMEGA, C, R, make_film
from nested_film import GapChange, residual_change
from rough_cases import surfaces

import fenics_ehd as ehd
from fenics_ehd.base.compile_lock import orphans
from fenics_ehd.base.compiler import quiet_compiler
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.weak_form import compiled


def place(angle, height):
    """Factor of a viscosity that depends on the place."""
    return 1 + 0.3 * np.cos(angle) + 5 * height


HOLE = ehd.HoleSupply(
    name="hole", on="journal", angle=115.0, height=0.1 * R, diameter=0.9 * R, pressure=3e5,
    resistance=2e11,
)  # fmt: skip
GROOVE = ehd.AxialGrooveSupply(name="groove", angle=229.0, extent=52.0, length=R, pressure=2e5)

EVERYTHING = {
    "oil": ehd.Lubricant(
        ETA, ehd.Barus(2e-8), ehd.DowsonHigginson(), shear_law=ehd.Cross(1e5, 0.7)
    ),
    "surfaces": surfaces(share=0.2),
}

CASES = {
    "constant": {},
    "Roelands, at a place": {
        "oil": ehd.Lubricant(ETA, ehd.Roelands(ETA), viscosity_field=place, density_field=place)
    },
    "Cross": {"oil": ehd.Lubricant(ETA, shear_law=ehd.Cross(1e5, 2.3, 0.1))},
    "average gap alone": {"surfaces": surfaces(flow_factors=False)},
    "equal roughness": {"surfaces": surfaces()},
    "hole and groove": {"feeds": (HOLE, GROOVE), "oil": ehd.Lubricant(ETA, ehd.Barus(2e-8))},
    "everything": EVERYTHING,
}


def film_of(family, case):
    """Graded mesh, sides and a groove under pressure."""
    share = np.linspace(0.0, 2 * np.pi, 17)
    heights = R * np.array([-1.0, -0.7, -0.3, 0.1, 0.5, 0.75, 1.0])
    grid = ehd.FilmGrid(R, 0.4 + share - 0.3 * np.sin(share), heights, family)
    groove = ehd.AxialGroove(1.1, 0.6, 4e5, length=0.6 * R)
    return make_film(grid=grid, sides=ehd.Sides(1e5, 3e5), regions=(groove,), **case)


def point_of(film, seed=3):
    """A gap without order, oil that slides both ways, pressures, and directions of all."""
    random, shape = np.random.default_rng(seed), film.points.angle.shape
    rough = film.parameters.surfaces
    # Between rough surfaces where they overlap, touch and are apart; off the ends of branches.
    height = C * random.uniform(0.1, 2.0, shape)
    if rough:
        height = rough.roughness * random.choice([-7.0, -3.5, -1.0, 0.3, 2.0, 7.0], shape)
    speed = OMEGA * R
    sliding = speed * random.uniform(0.2, 2, shape) * random.choice([-1, 1], shape)
    gap = Gap(
        height, OMEGA * C * random.uniform(-1, 1, shape), speed * random.uniform(-1, 1, shape),
        sliding,
    )  # fmt: skip
    unit = 0.01 * (rough.roughness if rough else C)
    directions = GapChange(
        *(s * random.uniform(-1, 1, (*shape, 1)) for s in (unit, C * OMEGA, speed, 0.01 * speed))
    )
    # Pressures that undershoot between nodes, none zero.
    pressure = random.uniform(0.2, 1.0, len(film.free)) * 1e8 / film.parameters.pressure_scale
    return gap, directions, pressure


def changed(gap, directions, amount, name):
    """A gap of which one of the data is changed."""
    change = amount * getattr(directions, name)[..., 0]
    return replace(gap, **{name: getattr(gap, name) + change})


#: Every law on one element, and all laws together on every one.
WHERE = [("lagrange", name) for name in CASES] + [
    (family, name) for family in FAMILIES[:-1] for name in ("constant", "everything")
]


@pytest.mark.parametrize(("family", "name"), WHERE)
def test_derivatives_are_those_of_the_residual(family, name):
    film = film_of(family, CASES[name])
    equation, (gap, directions, pressure) = film.equation, point_of(film)
    nodal = equation.nodal(pressure)

    def residual(gap, p=pressure):
        return equation.problem(gap).residual(p)

    direction = np.random.default_rng(1).uniform(-0.1, 0.1, len(pressure)) * pressure.max()
    matrix = equation.pattern.matrix(equation.problem(gap).entries(pressure))
    expected = slope(lambda t: residual(gap, pressure + t * direction))
    np.testing.assert_allclose(matrix @ direction, expected, atol=1e-8 * np.abs(expected).max())
    none = GapChange(*np.zeros((4, *directions.thickness.shape)))
    for own in ("thickness", "thickness_rate", "mean_velocity", "sliding_velocity"):
        one = none._replace(**{own: getattr(directions, own)})
        found = residual_change(film, gap, nodal, one)[film.free, 0]
        expected = slope(lambda t, own=own: residual(changed(gap, directions, t, own)))
        size = max(np.abs(expected).max(), 1e-3 * np.abs(residual(gap)).max())
        np.testing.assert_allclose(found, expected, atol=1e-8 * size)


def test_a_resting_journal_has_derivatives():
    film = film_of("lagrange", {"oil": ehd.Lubricant(ETA, shear_law=ehd.Cross(1e5, 0.5))})
    gap, _, pressure = point_of(film)
    gap = replace(gap, sliding_velocity=np.zeros_like(gap.sliding_velocity))
    for along in film.equation.gap_derivatives(gap, film.equation.nodal(pressure), 1e4):
        assert np.isfinite(along.data).all()


def test_another_mesh_and_another_oil_compile_nothing():
    known = make_film((12, 3), oil=ehd.Lubricant(ETA, ehd.Barus(2e-8))).equation.forms
    before = compiled.cache_info().misses
    assert (
        make_film((16, 4), oil=ehd.Lubricant(2 * ETA, ehd.Barus(1e-8))).equation.forms is not known
    )
    assert compiled.cache_info().misses == before


def test_what_compiles_leaves_logging_and_warnings_as_they_were(capfd):
    root, shown = logging.getLogger(), warnings.showwarning
    handlers, level, disabled = list(root.handlers), root.level, root.manager.disable
    with quiet_compiler():  # what setuptools does
        root.addHandler(logging.StreamHandler())
        root.setLevel(logging.INFO)
        logging.captureWarnings(True)
        logging.info("x86_64-linux-gnu-gcc")
    assert (list(root.handlers), root.level, warnings.showwarning) == (handlers, level, shown)
    assert root.manager.disable == disabled
    assert "gcc" not in capfd.readouterr().err


FIRST = """
from film_cases import make_film
make_film((12, 3)).equation.forms
"""


@pytest.mark.slow
def test_the_first_film_model_says_nothing_of_its_compiler(tmp_path):
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    command = [sys.executable, "-c", FIRST]
    found = subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=Path(__file__).parent
    )
    assert list(tmp_path.rglob("libffcx_forms_*.so"))
    assert (found.returncode, found.stderr) == (0, "")


COMPILE = """
import sys
from film_cases import ETA, make_film
from fenics_ehd.base import compat, compile_lock
from fenics_ehd.film.lubricant import Barus, Lubricant
if sys.argv[1] == "naive":
    compile_lock.orphans = lambda folder: []
    compat._JIT["timeout"] = 3
make_film((12, 3), oil=Lubricant(ETA, Barus(2e-8))).equation.forms
"""


@pytest.mark.slow
def test_a_compilation_that_was_killed_does_not_stop_later_ones(tmp_path):
    kept = tmp_path / "fenics" / "fenics_ehd"

    def start(way):
        return subprocess.Popen(
            [sys.executable, "-c", COMPILE, way], stderr=subprocess.PIPE, text=True,
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)}, cwd=Path(__file__).parent,
            start_new_session=True,
        )  # fmt: skip

    process, began = start("cured"), time.monotonic()
    while not list(kept.glob("*.c")):
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() - began < 60
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert len(orphans(kept)) == 1
    error = start("naive").communicate()[1]
    assert "Timeout" in error
    process = start("cured")
    assert (process.communicate()[1] is not None, process.returncode) == (True, 0)
