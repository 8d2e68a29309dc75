"""Pictures of a run: which there are, and that they show what the history holds."""

import numpy as np
import pytest

from fenics_ehd.plotting import truth


@pytest.fixture
def history():
    time = np.linspace(0.0, 1e-2, 50)
    return {
        "time_s": time,
        "kinetic_energy_J": 100 + np.sin(300 * time),
        "strain_energy_J": 0.1 * time,
        "drive_work_J": np.sin(300 * time),
        "gas_work_J": 0 * time,
        "film_work_J": 2 * time,
        "damping_work_J": time,
        "energy_defect_J": 1e-4 * time,
        "basis_error_estimate_m": 1e-8 * (1 + time),
        "min_film_thickness_m": 3e-6 + 0 * time,
    }


def test_the_energy_picture_shows_what_is_exchanged_and_what_is_lost(
    history, tmp_path, monkeypatch
):
    drawn = {}

    def look(figure, paths):
        for axes in figure.axes:
            for line in axes.lines:
                drawn[line.get_label()] = line.get_ydata()
        return list(paths)

    monkeypatch.setattr(truth, "save", look)
    paths = truth.plot_energy(history, tmp_path, ("png",))
    assert [path.name for path in paths] == ["energy.png"]
    assert set(drawn) >= {"kinetic and strain energy", "drive", "film", "structural damping"}
    # What nothing was exchanged by is not in the legend.
    assert not any("gas" in name for name in drawn)
    stored = history["kinetic_energy_J"] + history["strain_energy_J"]
    np.testing.assert_allclose(drawn["kinetic and strain energy"], stored - stored[0])


def test_the_basis_error_is_drawn_where_it_is_known(history, tmp_path):
    assert {path.suffix for path in truth.plot_basis_error(history, tmp_path)} == {".png", ".svg"}
    unknown = history | {"basis_error_estimate_m": np.full(50, np.nan)}
    assert truth.plot_basis_error(unknown, tmp_path) == []
