"""The film of forms against the one whose derivatives are written by hand."""

import film_forms
import film_forms_film
import pytest
from film_cases import FAMILIES

LAWS = "Patir-Cheng, rough bore, Cross, Barus, Dowson-Higginson"


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_all_derivatives_are_those_written_by_hand(family):
    worst = {}
    film_forms.difference(family, film_forms.CASES[LAWS], worst)
    assert len(worst) == 6
    assert max(worst.values()) < 3e-12


@pytest.mark.slow
def test_a_second_mesh_compiles_nothing(monkeypatch):
    grids = [film_forms.uniform_grid(film_forms.R, 0.04, cells) for cells in ((12, 3), (16, 4))]
    first, second = (film_forms.parameters(grid, {}, {}) for grid in grids)
    film_forms_film.FormsEquation(first)
    monkeypatch.setattr(film_forms_film.compat_forms, "compile_forms", None)
    film_forms_film.FormsEquation(second)
