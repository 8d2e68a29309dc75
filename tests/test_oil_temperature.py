"""Viscosity and density of oils over temperature, against tables."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fenics_ehd as ehd
from fenics_ehd.film.lubricant import (
    GRADES,
    LARGEST,
    SMALLEST,
    WaltherLine,
    grade_name,
    oil_of_grade,
)

#: Synthetic oil of ISO VG 220 [C, mm2/s, kg/m3] (github.com/MadsKirkFoged/SharpFluids,
#: CustomFluids/SHC230.cs).
SYNTHETIC = np.array([
    (-30, 75984.3, 873.6), (-20, 22001.9, 868.2), (-10, 7604.5, 862.9), (0, 3042.5, 857.7),
    (10, 1374.9, 852.6), (20, 688.0, 847.5), (30, 375.2, 842.4), (40, 220.0, 837.4),
    (50, 137.2, 832.5), (60, 90.2, 827.7), (70, 62.1, 822.8), (80, 44.4, 818.1),
    (90, 32.8, 813.4), (100, 25.0, 808.8), (110, 19.5, 804.2), (120, 15.6, 799.6),
])  # fmt: skip

#: Six mineral oils: density at 25 C [kg/m3], viscosity at 30, 60 and 100 C [mPa s] (The Tribology
#: Handbook, table 25, at digilib.universitaspertamina.ac.id, read by machine).
MINERAL = {
    "naphthenic, spindle": (862, 18.6, 6.3, 2.4),
    "naphthenic, light machine": (880, 45.0, 12.0, 3.9),
    "naphthenic, heavy machine": (897, 171.0, 31.0, 7.5),
    "paraffinic, light machine": (862, 42.0, 13.5, 4.3),
    "paraffinic, heavy machine": (875, 153.0, 34.0, 9.1),
    "paraffinic, cylinder": (891, 810.0, 135.0, 27.0),
}


def test_line_of_a_synthetic_oil_gives_its_table(figure):
    oil = ehd.Oil(220.0, 25.0, density_15=850.0, expansion=5.8e-4)
    temperature, nu, density = SYNTHETIC.T
    ours = np.array([oil.kinematic_viscosity(t) for t in temperature])
    group = "oil"
    defect = np.abs(ours / nu - 1)
    figure(group, "ISO VG 220, -30 to 120 C, from 40 and 100 C", defect.max(), most=2e-3,
           unit="%")  # fmt: skip
    assert np.abs(np.array([oil.density(t) for t in temperature]) / density - 1).max() < 3e-3


def test_line_of_mineral_oils_through_two_gives_the_third(figure):
    # Values have two figures. One of six is far from its line, its own misprint or not.
    defects = []
    for density, *values in MINERAL.values():
        rho = [density * (1 - 6.5e-4 * (t - 25)) for t in (30, 60, 100)]
        first, middle, last = 1e3 * np.array(values) / rho
        line = WaltherLine.through((30, first), (100, last))
        defects.append(abs(line(60) / middle - 1))
    worst = sorted(defects)
    group = "oil"
    figure(
        group, "mineral oils, 60 C from 30 and 100 C, five of six", worst[-2], most=0.03, unit="%"
    )
    figure(group, "mineral oils, 60 C from 30 and 100 C, the sixth", worst[-1], most=0.09, unit="%")


def test_line_agrees_with_calculations_by_the_standard():
    # olezol.com/viscosity-temperature-extrapolation-astm-d341
    assert WaltherLine.through((40, 404), (100, 28))(60) == pytest.approx(132.126, rel=1e-4)
    assert WaltherLine.through((40, 68), (80, 14.85))(100) == pytest.approx(8.8, abs=0.05)


OIL = ehd.Oil(98.96, 14.4)


@given(nu=st.floats(10, 1000), share=st.floats(0.05, 0.5), temperature=st.floats(0, 150))
def test_line_goes_through_its_points_and_back(nu, share, temperature):
    if nu * share < SMALLEST:
        return
    line = WaltherLine.through((40, nu), (100, nu * share))
    assert line(40) == pytest.approx(nu)
    assert line(100) == pytest.approx(nu * share)
    assert line.temperature(line(temperature)) == pytest.approx(temperature, abs=1e-6)


def test_range_of_the_equation_is_told():
    assert OIL.kinematic_viscosity(OIL.hottest - 1e-6) == pytest.approx(SMALLEST, rel=1e-6)
    assert OIL.kinematic_viscosity(OIL.coldest + 1e-6) == pytest.approx(LARGEST, rel=1e-6)
    for temperature in (OIL.hottest + 1, OIL.coldest - 1, np.nan):
        with pytest.raises(ehd.errors.SettingsError, match="must lie between"):
            OIL.viscosity(temperature)


@pytest.mark.parametrize(
    "values", [(1.9, 1.5), (10.0, 1.9), (10.0, 12.0), (10.0, 10.0), (np.inf, 5.0), (np.nan, 5.0)]
)
def test_viscosities_out_of_range_are_refused(values):
    with pytest.raises(ehd.errors.SettingsError, match=r"mm2/s|must be a finite number"):
        ehd.Oil(*values)


@pytest.mark.parametrize("key", ["density_15", "specific_heat", "expansion"])
def test_properties_out_of_range_are_refused(key):
    with pytest.raises(ehd.errors.SettingsError, match=key):
        ehd.Oil(100.0, 11.0, **{key: -1.0})


def test_grades_become_thicker_with_their_numbers():
    for family in ("ISO VG", "SAE"):
        names = [n for n in GRADES if n.startswith(family) and "W" not in n]
        oils = [oil_of_grade(name) for name in names]
        for temperature in (40, 100):
            values = [oil.viscosity(temperature) for oil in oils]
            assert values == sorted(values)
            assert len(values) >= 5


#: Ranges of the kinematic viscosity at 100 C in SAE J300 of 2015 [mm2/s], by the last number.
RANGES = {
    "8": (4.0, 6.1), "12": (5.0, 7.1), "16": (6.1, 8.2), "20": (6.9, 9.3), "30": (9.3, 12.5),
    "40": (12.5, 16.3), "50": (16.3, 21.9), "60": (21.9, 26.1),
}  # fmt: skip


def test_grades_lie_in_the_middle_of_their_range():
    names = [name for name in GRADES if name.startswith("SAE") and name != "SAE 10"]
    assert len(names) == 18
    for name in names:
        least, most = RANGES[name.removeprefix("SAE ").rpartition("-")[2]]
        assert GRADES[name].viscosity_100 == pytest.approx((least + most) / 2, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("sae 10w40", "SAE 10W-40"), ("5W-30", "SAE 5W-30"), ("ISO VG 46", "ISO VG 46"),
     ("vg46", "ISO VG 46"), ("SAE30", "SAE 30")],
)  # fmt: skip
def test_grades_are_found_however_they_are_spelled(name, expected):
    assert grade_name(name) == expected


@pytest.mark.parametrize("name", ["30", "SAE 31", "", "W"])
def test_an_unknown_grade_is_refused_with_those_there_are(name):
    with pytest.raises(ehd.errors.SettingsError, match="is not one of ISO VG 10"):
        grade_name(name)


def test_lubricant_at_another_temperature():
    oil = oil_of_grade("SAE 5W-30")
    warm = ehd.Lubricant.of(oil, 90.0)
    cold = ehd.Lubricant.of(oil, 20.0)
    assert warm.viscosity == oil.viscosity(90.0) < cold.viscosity
    assert cold.at(90.0) == warm
    thick = ehd.Lubricant(cold.viscosity, ehd.Barus(1e-8), oil=oil)
    assert thick.at(90.0).viscosity_law == ehd.Barus(1e-8)
    thick = ehd.Lubricant(cold.viscosity, ehd.Roelands(cold.viscosity), oil=oil)
    assert thick.at(90.0).viscosity_law == ehd.Roelands(warm.viscosity)
    with pytest.raises(ehd.errors.SettingsError, match="give a grade"):
        ehd.Lubricant(0.01).at(90.0)
