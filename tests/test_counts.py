"""Counts of work are those of the golden file: no machine changes them, unlike times."""

import json

import pytest
from golden_curves import SHIPPED
from work_counts import GOLDEN, counts_of

#: Counts may differ between BLAS kernels by so much, or by two.
SHARE = 0.02
FEW = 2


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_the_first_steps_of_a_scene_cost_as_much_work_as_ever(name):
    expected = json.loads(GOLDEN.read_text())[name]
    counts = counts_of(name)
    assert counts.keys() == expected.keys()
    wrong = {
        key: (count, expected[key])
        for key, count in counts.items()
        if abs(count - expected[key]) > max(SHARE * expected[key], FEW)
    }
    assert not wrong
