"""Central differences and arrays of numbers for the property tests."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

#: Central differences of order 8, which leave 1e-11 of values and rates of order 1.
OFFSETS = np.array([-4, -3, -2, -1, 1, 2, 3, 4])
WEIGHTS = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280])


def slope(function, at=0.0, step=0.01):
    """Derivative of a function of one number."""
    values = [np.asarray(function(at + k * step)) for k in OFFSETS]
    return sum(w * v for w, v in zip(WEIGHTS, values, strict=True)) / step


def numbers(*shape, largest=1.0):
    """Arrays of a shape with entries up to `largest` in size."""
    return hnp.arrays(
        float,
        shape,
        elements=st.floats(-largest, largest, allow_subnormal=False),
        fill=st.nothing(),
    )
