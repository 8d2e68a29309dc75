"""Counts of work are those of the golden file: lost speed shows in them on any machine."""

import pytest
from golden_curves import SHIPPED
from hand_made_rod import Joint, make_body
from study_cases import COARSE
from work_counts import (
    EXACT,
    FEW,
    REDUCTIONS,
    SHARE,
    counts_of,
    differing,
    rod_part,
    stored,
)

import fenics_ehd as ehd
from fenics_ehd.reduction.reductor import rigid
from fenics_ehd.scenes.part import body_counts

CASES = [*SHIPPED, *(pytest.param(name, marks=pytest.mark.slow) for name in REDUCTIONS)]


@pytest.mark.parametrize("name", CASES)
def test_scenes_and_reductions_take_the_work_of_the_golden_file(name):
    expected = stored()[name]
    counts = counts_of(name)
    assert counts.keys() == expected.keys()
    assert not differing(counts, expected)


def test_counts_differ_by_more_than_rounding_or_not_at_all():
    expected = {"static_solves": 100, "steps": 60, "evaluations": 1000}
    assert not differing(expected, expected)
    assert not differing({"static_solves": 100, "steps": 58, "evaluations": 1020}, expected)
    found = differing({"static_solves": 101, "steps": 63, "evaluations": 1021}, expected)
    assert found == {"static_solves": (101, 100), "steps": (63, 60), "evaluations": (1021, 1000)}
    assert set(differing({}, expected)) == set(expected)
    assert EXACT >= {"static_solves", "part_factorisations"}
    assert (SHARE, FEW) == (0.02, 2)


@pytest.fixture(scope="module")
def part():
    return rod_part(
        {key.removeprefix("bodies.rod."): value for key, value in COARSE.items()}
    ).source


def test_bodies_of_one_reductor_have_the_work_that_was_left_to_them(part):
    alone = {n: body_counts(ehd.craig_bampton(part, n)) for n in (8, 4)}
    assert all(counts["part_factorisations"] == 1 for counts in alone.values())
    # One column for each pressure of the family, and those of boundary, modes and checks.
    family = ehd.Reductor(part).measure.shape[1]
    assert alone[8]["static_solves"] == alone[4]["static_solves"] > family
    assert alone[8]["eigensolver_applications"] > 8
    shared = ehd.Reductor(part)
    first, second = (body_counts(ehd.craig_bampton(shared, n)) for n in (8, 4))
    assert first == alone[8]
    assert not any(second.values())
    # Without factors they are made again; results are not.
    shared.forget()
    third = body_counts(ehd.load_dependent(shared, 4, 4))
    assert third["part_factorisations"] == 1
    assert third == body_counts(ehd.load_dependent(ehd.Reductor(part), 4, 4))


def test_a_body_without_a_part_or_of_a_former_version_has_no_counts():
    assert body_counts(make_body(Joint())) == {}


def test_a_rigid_body_takes_no_work(part):
    assert not any(body_counts(rigid(part)).values())
