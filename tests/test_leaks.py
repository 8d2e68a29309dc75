"""Many runs in one process: nothing of a run stays behind."""

import gc
import resource
from dataclasses import replace
from pathlib import Path

import pytest
from hand_made_rod import Joint, flexible, make_body, with_residual
from mechanism_cases import (
    REVOLUTION,
    SPEED,
    film,
    flexible_slider_crank,
    rigid_rod,
    short_films,
    slider_crank,
)
from petsc4py import PETSc
from scene_cases import LOADED_JOURNAL, write_scene

import fenics_ehd as ehd

RADIUS, WIDTH, CLEARANCE, VISCOSITY = 0.0225, 0.022, 17e-6, 0.01


def run(mechanism, revolutions=0.0003):
    ehd.simulate(mechanism, revolutions * REVOLUTION, tolerance=1e-3)


def on_film(body, film):
    """A rod whose big end has this film."""
    mechanism = flexible_slider_crank(body)
    joint = replace(mechanism.joints["big_end"], film=film)
    return replace(mechanism, joints={**mechanism.joints, "big_end": joint})


def nine_nodes(_):
    run(flexible_slider_crank(make_body(Joint((8, 2)))))


def weighted(_):
    body = make_body(Joint((8, 2)))
    grid = ehd.uniform_grid(RADIUS, WIDTH, (8, 2), "serendipity")
    run(
        on_film(
            body,
            ehd.Film(ehd.FilmParameters(grid, CLEARANCE, ehd.Lubricant(VISCOSITY), rate=SPEED)),
        )
    )


def another_mesh(_):
    body = make_body(Joint((8, 2)))
    run(on_film(body, film(RADIUS, WIDTH, CLEARANCE, VISCOSITY, (12, 3))))


def residual_patterns(_):
    joint = Joint((8, 2))
    run(flexible_slider_crank(with_residual(joint, flexible(joint)[0])))


def both_ends(_):
    run(slider_crank(rigid_rod(), *short_films()))


def journal(folder):
    changes = LOADED_JOURNAL | {"joints.bearing.cells": [8, 2]}
    scene = ehd.read_scene(write_scene(folder / "journal.toml", "loaded-journal", changes))
    mechanism = ehd.build(scene).mechanism
    ehd.simulate(mechanism, period=20e-3, periodicity=0.9, tolerance=1e-2, largest=0.1)


WORK = [nine_nodes, weighted, another_mesh, residual_patterns, both_ends, journal]


@pytest.fixture(scope="module")
def clean():
    """Nothing is to be collected of what was before, nor looked at again."""
    gc.collect()
    PETSc.garbage_cleanup(PETSc.COMM_SELF)
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.mark.parametrize("work", WORK)
def test_petsc_keeps_nothing_of_a_run(work, clean, tmp_path, capfd):
    work(tmp_path)
    gc.collect()
    capfd.readouterr()
    PETSc.garbage_view(PETSc.COMM_SELF)
    # Where there is garbage, a table of it.
    assert "|" not in capfd.readouterr().out


@pytest.mark.slow
def test_memory_does_not_grow_from_run_to_run():
    mechanism = flexible_slider_crank(make_body(Joint((8, 2))))
    sizes = []
    for _ in range(4):
        for _ in range(20):
            run(mechanism, 3e-5)
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        sizes.append(pages * resource.getpagesize() / 1024)
    # It was 31 kB a run once; what the allocator keeps of the first ones is no leak.
    assert sizes[-1] - sizes[1] < 40 * 2
