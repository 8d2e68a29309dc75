"""Every demo runs, and one number of it is known; those of whole machines: test_demo_scenes.py."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

DEMOS = Path(__file__).parents[1] / "demos"


def demo(name):
    spec = importlib.util.spec_from_file_location(name, DEMOS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_demo_is_tested():
    texts = [path.read_text() for path in Path(__file__).parent.glob("test_*.py")]
    tested = {name for text in texts for name in re.findall(r'demo\("(\w+)"\)', text)}
    assert {path.stem for path in DEMOS.glob("*.py")} == tested


def test_slider_crank_builds_up_its_film():
    result = demo("slider_crank").main(revolutions=0.05)
    # The inertia of the rod's end against the crank: 38 MPa after a twentieth of a revolution.
    assert result.joints["big_end"].max_pressure.max() == pytest.approx(37.5e6, rel=0.05)
    assert result.energy_balance_error < 1e-2


def test_rigid_bearing_becomes_ocvirks():
    # A twentieth as wide as its diameter: what the theory leaves out is of order (B/D)^2 and c/R.
    assert demo("rigid_bearing").main() == pytest.approx(1.0, abs=4e-3)


def test_foreign_matrices_keep_their_frequency():
    found, expected = demo("foreign_matrices").main()
    assert found == pytest.approx(expected, rel=1e-8)


@pytest.mark.slow
def test_foreign_matrices_need_no_dolfinx():
    lines = "import sys; sys.path.insert(0, sys.argv[1]); import foreign_matrices as f; f.main()"
    subprocess.run(
        [sys.executable, "-c", f"{lines}; assert 'dolfinx' not in sys.modules", DEMOS],
        check=True, capture_output=True,
    )  # fmt: skip
