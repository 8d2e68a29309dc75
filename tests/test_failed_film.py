"""The film of a solve that ends a command is not lost."""

import h5py
import numpy as np
import pytest

from fenics_ehd.base.errors import CavitationError, MeshError, StepSizeError
from fenics_ehd.base.output import keeping_failed_film


def test_film_behind_a_step_that_fell_too_short_is_kept(tmp_path):
    film = CavitationError("no active set", {"pressure": np.arange(4.0), "thickness": np.eye(2)})
    with (
        pytest.raises(StepSizeError, match=r"too short; the film is kept in .*failed_film\.h5"),
        keeping_failed_film(tmp_path),
    ):
        raise StepSizeError("too short") from film
    with h5py.File(tmp_path / "failed_film.h5") as file:
        np.testing.assert_array_equal(file["pressure"], np.arange(4.0))
        np.testing.assert_array_equal(file["thickness"], np.eye(2))


def test_error_without_a_film_is_left_alone(tmp_path):
    with pytest.raises(MeshError, match=r"^no bore$"), keeping_failed_film(tmp_path):
        raise MeshError("no bore")
    assert not list(tmp_path.iterdir())
