"""Every demo runs, and one number of it is known."""

import importlib.util
from pathlib import Path

import pytest

DEMOS = Path(__file__).parents[1] / "demos"


def demo(name):
    spec = importlib.util.spec_from_file_location(name, DEMOS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_demo_is_tested():
    assert {path.stem for path in DEMOS.glob("*.py")} == {"loaded_journal", "slider_crank"}


def test_slider_crank_builds_up_its_film():
    totals = demo("slider_crank").main(revolutions=0.05)
    # The inertia of the rod's end against the crank: 38 MPa after a twentieth of a revolution.
    assert totals.max_pressure == pytest.approx(37.5e6, rel=0.05)
    assert totals.energy_error < 1e-2
