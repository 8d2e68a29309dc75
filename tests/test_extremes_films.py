"""Quick rows of the benchmark of extreme films."""

from pathlib import Path

import pytest
from extremes_films import films, measured
from extremes_films_case import Shop

QUICK = (
    "Barus 40e-9 at 100 MPa",
    "Barus 40e-9 at 500 MPa",
    "heat, centred: nothing leaves",
    "heat at 20 000 rad/s",
    "hole as wide as the bearing",
    "ovality 3 c",
    "dry start without mass",
)


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    return {case.name: case for case in films(Path(tmp_path_factory.mktemp("tables")))}


def test_there_are_forty_rows_and_no_name_twice(rows, tmp_path):
    assert len(rows) == len(list(films(tmp_path))) >= 40


@pytest.mark.parametrize("name", QUICK)
def test_a_row_goes_as_expected(rows, name):
    row = measured(Shop(), rows[name])
    assert row.passed, row.cells()
