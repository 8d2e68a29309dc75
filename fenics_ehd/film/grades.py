"""Named grades of oils.

A grade stands for two nominal kinematic viscosities. The standard gives one of them: ISO 3448 the
number of an ISO VG grade at 40 C, SAE J300 a range at 100 C, whose middle is taken (fuchs.com,
"Viscosity charts"; "SAE 10", a winter grade, goes from 4.1 mm2/s to where 15W begins). The other
follows from an assumed viscosity index by ASTM D2270, whose formulas are at dgaequipment.com and
whose table of L and H is in ``chemicals.viscosity`` (CalebBell/chemicals). Indices stand in for a
product's data sheet: 95 for ISO and single grades, as the chart at noco.ca/viscosity-chart takes,
as listed for multigrade oils. Density and specific heat are those of `Oil`.
"""

from __future__ import annotations

from dataclasses import dataclass

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.temperature import Oil


@dataclass(frozen=True)
class Grade:
    """Nominal kinematic viscosities at 40 and 100 C [mm2/s] and the assumed viscosity index."""

    viscosity_40: float
    viscosity_100: float
    index: int = 95


GRADES = {
    "ISO VG 10": Grade(10, 2.637),
    "ISO VG 15": Grade(15, 3.381),
    "ISO VG 22": Grade(22, 4.254),
    "ISO VG 32": Grade(32, 5.289),
    "ISO VG 46": Grade(46, 6.645),
    "ISO VG 68": Grade(68, 8.53),
    "ISO VG 100": Grade(100, 11.07),
    "ISO VG 150": Grade(150, 14.55),
    "ISO VG 220": Grade(220, 18.75),
    "ISO VG 320": Grade(320, 23.96),
    "ISO VG 460": Grade(460, 30.35),
    "ISO VG 680": Grade(680, 39.06),
    "SAE 10": Grade(27.58, 4.85),
    "SAE 20": Grade(62.82, 8.1),
    "SAE 30": Grade(97.78, 10.9),
    "SAE 40": Grade(147.8, 14.4),
    "SAE 50": Grade(226.4, 19.1),
    "SAE 0W-20": Grade(43.92, 8.1, 160),
    "SAE 0W-30": Grade(63.21, 10.9, 165),
    "SAE 0W-40": Grade(83.49, 14.4, 180),
    "SAE 5W-20": Grade(46.01, 8.1, 150),
    "SAE 5W-30": Grade(64.85, 10.9, 160),
    "SAE 5W-40": Grade(88.12, 14.4, 170),
    "SAE 10W-30": Grade(72.35, 10.9, 140),
    "SAE 10W-40": Grade(98.96, 14.4, 150),
    "SAE 15W-40": Grade(105.4, 14.4, 140),
    "SAE 20W-50": Grade(173.7, 19.1, 125),
}


def _plain(name: str) -> str:
    """A grade's name without what people write differently: ``sae 5w30`` is SAE 5W-30."""
    return name.upper().replace(" ", "").replace("-", "")


def _spoken(name: str) -> tuple[str, ...]:
    """Plain names of a listed grade: ``VG 32`` is ISO VG 32, ``5W-30`` is SAE 5W-30."""
    full = _plain(name)
    short = full.removeprefix("ISO").removeprefix("SAE")
    return (full, short) if not short.isdigit() else (full,)


_BY_PLAIN_NAME = {plain: name for name in GRADES for plain in _spoken(name)}


def grade_name(name: str) -> str:
    """Name of a grade in `GRADES`, however it is spelled.

    Raises
    ------
    SettingsError
        It is not listed.
    """
    found = _BY_PLAIN_NAME.get(_plain(name))
    if found is None:
        raise SettingsError(
            f"grade = {name!r} is not one of {', '.join(GRADES)}: give viscosity_40 and "
            "viscosity_100 of another"
        )
    return found


def oil_of_grade(name: str, **properties: float) -> Oil:
    """Oil of a named grade; `properties` of `Oil` in place of its defaults."""
    grade = GRADES[grade_name(name)]
    return Oil(grade.viscosity_40, grade.viscosity_100, **properties)
