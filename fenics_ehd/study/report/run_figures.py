"""Tables of a run's report: the figures of its summary, with their estimated errors.

A row has one figure for each joint. An extreme has its position, instant and angle in the same
cell. A figure of the last cycle that equals the same figure of the complete search for a periodic
solution shares its cell. A figure that is zero, or a mean that is zero but for round-off, has no
error and no position. A row of such figures is not in the table: the label of the row is listed
below the table.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from fenics_ehd.multibody.cycle import CRANK
from fenics_ehd.multibody.figures import POSITION, Figure
from fenics_ehd.multibody.trust import NOT_ESTIMATED

#: Factors to printed units, and the printed units, by the end of a figure's name; the first match
#: is used.
UNITS = {
    "_Pa_m": (1.0, "Pa m"),
    "_m3_per_s": (1e6, "cm³/s"),
    "_time_s": (1e3, "ms"),
    "_height_m": (1e3, "mm"),
    "_Pa": (1e-6, "MPa"),
    "_start_s": (1e3, "ms"),
    "_end_s": (1e3, "ms"),
    "_share": (100.0, "%"),
    "_m3": (1e9, "mm³"),
    "_m": (1e6, "µm"),
    "_Nm": (1.0, "N m"),
    "_N_per_m": (1e-3, "N/mm"),
    "_N": (1.0, "N"),
    "_W": (1.0, "W"),
    "_J": (1.0, "J"),
    "_C": (1.0, "°C"),
    "_deg": (1.0, "°"),
    "_s": (1.0, "s"),
}

#: Words for figures whose name does not explain them.
LABELS = {
    "max_pressure_Pa": "peak pressure (POFP)",
    "min_film_thickness_m": "minimum film (MOFT)",
    "max_force_N": "largest load",
    "mean_force_N": "mean load",
    "mean_friction_torque_Nm": "mean friction torque on the journal",
    "mean_bore_friction_torque_Nm": "mean friction torque on the bore",
    "mean_friction_power_W": "mean friction power loss",
    "mean_journal_friction_power_W": "mean friction power from the journal",
    "mean_bore_friction_power_W": "mean friction power from the bore",
    "mean_film_power_W": "mean power into the film",
    "mean_dissipated_power_W": "mean heat in the film",
    "mean_supply_power_W": "mean power of the oil supply",
    "mean_contact_force_N": "mean contact force",
    "mean_contact_power_W": "mean boundary friction power",
    "mean_contact_share": "mean share of the load on asperities",
    "mean_contact_area_share": "mean share of the bore in contact",
    "mean_unpublished_share": "mean share of the bore too rough for the flow factors",
    "mean_oil_content_m3": "mean oil in the film",
    "oil_content_at_start_m3": "oil in the film at the start",
    "oil_content_at_end_m3": "oil in the film at the end",
    "oil_balance_defect": "error of the oil balance / oil",
    "mean_side_flow_m3_per_s": "mean flow out at the sides",
    "mean_leaving_flow_m3_per_s": "mean flow of oil that carries heat",
    "mean_supply_flow_m3_per_s": "mean flow from the supply",
    "max_contact_pressure_Pa": "largest contact pressure",
    "max_eccentricity_ratio": "largest eccentricity / clearance",
    "max_specific_load_Pa": "largest specific load F / (2 R B)",
    "mean_specific_load_Pa": "mean specific load F / (2 R B)",
    "min_lambda_ratio": "least film / roughness (lambda)",
    "max_contact_share": "largest share on asperities",
    "basis_error_estimate_m": "gap error by the reduced basis",
    "orbit_1x_amplitude_m": "orbit, 1x amplitude",
    "orbit_1x_phase_deg": "orbit, 1x phase",
    "orbit_0_5x_amplitude_m": "orbit, 0.5x amplitude",
    "orbit_0_5x_phase_deg": "orbit, 0.5x phase",
    "energy_balance_error": "energy balance error / energy exchanged",
    "periodicity_defect": "change of the films in the last cycle",
    "largest_multiplier": "largest Floquet multiplier (below 1: stable)",
    "simulated_time_s": "simulated time",
    "start_s": "start of the cycle",
    "end_s": "end of the cycle",
    "newton_iterations": "Newton iterations",
    "cycles": "cycles until periodic",
}

#: Prefix of figures of the last complete cycle.
CYCLE = "cycle_"

#: Prefix of means over time.
MEAN = "mean_"

#: Means that are zero if they are round-off next to another column, by their own column.
COMPARED = {"contact_force_N": "force_N", "contact_power_W": "friction_power_W"}

#: Means below this share of their scale are zero: round-off of sums over a film.
ROUND_OFF = 1e-9

#: Words before the value of a position by the end of its name; the first match is used.
POSITIONS = {
    "_crank_angle_deg": "{body} ",
    "_angle_deg": "bore ",
    "_height_m": "z = ",
    "_time_s": "",
}


@dataclass(frozen=True)
class Position:
    """Instant, angle or height of an extreme.

    Attributes
    ----------
    names
        Full names of its figures, ``big_end.cycle_max_pressure_angle_deg``.
    text
        Text of its value, ``bore 12.3°``.
    """

    names: tuple[str, ...]
    text: str


@dataclass
class Cell:
    """A figure in a table.

    Attributes
    ----------
    names
        Full names of the figures with this value, ``big_end.max_pressure_Pa``.
    value, bound
        Texts of the value with its unit, and of its error; the latter is empty for exact values.
    zero
        Whether the value is zero, or a mean that is zero but for round-off.
    positions
        Positions of an extreme.
    """

    names: list[str]
    value: str
    bound: str
    zero: bool = False
    positions: list[Position] = field(default_factory=list)


@dataclass(frozen=True)
class Row:
    """A row of a table: its label, and one cell for each joint, None without a figure."""

    label: str
    cells: tuple[Cell | None, ...]

    @property
    def zero(self) -> bool:
        """Whether all cells of the row are zero."""
        return all(cell.zero for cell in self.cells if cell)


@dataclass(frozen=True)
class Block:
    """A table of figures: its caption, the headings of its columns, and its rows.

    Without headings, the figures follow each other in a paragraph. Rows in `zero` are those whose
    cells are all zero; the page has their labels only.
    """

    caption: str
    heads: tuple[str, ...]
    rows: tuple[Row, ...]
    zero: tuple[Row, ...] = ()


def number_text(value: float, digits: int = 4) -> str:
    """Text of a number with four significant digits, without an exponent for usual sizes."""
    if value == 0.0 or not 1e-3 <= abs(value) < 1e6:
        return f"{value:.{digits}g}".replace("e-0", "e-").replace("-", "−")
    text = np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")
    return text.replace("-", "−")


def unit_of_figure(name: str) -> tuple[float, str]:
    """Factor to the printed unit of a figure, and this unit; 1 and empty without a unit."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), (1.0, ""))


def value_text(figure: Figure) -> str:
    """Text of a figure's value in its printed unit."""
    return _with_unit(figure.value, figure.name)


def _with_unit(value: float, name: str, digits: int = 4) -> str:
    factor, unit = unit_of_figure(name)
    return f"{number_text(factor * value, digits)}{'' if unit == '°' else ' '}{unit}".rstrip()


def position_text(figure: Figure) -> str:
    """Text of the position of an extreme; an angle has one decimal, a height two."""
    if figure.name.endswith("_height_m"):
        return f"{round(1e3 * figure.value, 2) + 0.0:g} mm".replace("-", "−")
    if figure.unit == "deg":
        return f"{figure.value + 0.0:.1f}°".replace("-", "−")
    return value_text(figure)


def bound_text(figure: Figure) -> str:
    """Text of a figure's error, ``± 0.5 %``; empty for a setting, a count and an error."""
    if figure.error is None:
        return "(error not estimated)" if figure.reason == NOT_ESTIMATED else ""
    if figure.relative is not None:
        text = f"± {100 * figure.relative:.2g} %".replace("e-0", "e-")
    else:
        text = f"± {_with_unit(figure.error, figure.name, 2)}"
    return ", ".join(filter(None, (text, figure.reason)))


def label_of(name: str) -> str:
    """Words for a figure, from `LABELS` or from its name without the unit."""
    base = name.removeprefix(CYCLE)
    if base in LABELS:
        return LABELS[base]
    endings = (end for end in UNITS if base.endswith(end))
    words = base.removesuffix(next(endings, ""))
    return words.replace("_per_rad", "").replace("_", " ").replace(".", ": ")


#: Type for columns of every joint over time, by the name of the joint and of the column.
JointColumns = Mapping[str, Mapping[str, np.ndarray]]


def is_zero(figure: Figure, columns: Mapping[str, np.ndarray]) -> bool:
    """Whether a figure is zero, or a mean that is zero but for round-off.

    `columns` has the columns of the joint of the figure, whose means are figures. Angles and
    temperatures are never zero: their zero is an arbitrary value. A mean that is smaller than its
    error is not zero but unknown, and is printed with its error.
    """
    if figure.unit in ("deg", "C"):
        return False
    column = figure.name.removeprefix(CYCLE).removeprefix(MEAN)
    if column == figure.name.removeprefix(CYCLE):
        return figure.value == 0.0
    scale = 1.0 if column.endswith("_share") else 0.0
    for name in (column, COMPARED.get(column, column)):
        if name in columns:
            scale = max(scale, float(np.max(np.abs(columns[name]), initial=0.0)))
    return abs(figure.value) <= ROUND_OFF * scale


def figure_blocks(
    figures: Sequence[Figure],
    body: str,
    *,
    searched: bool,
    columns: JointColumns = MappingProxyType({}),
) -> list[Block]:
    """Tables of all figures of a run: those of the joints, and those of the run.

    Parameters
    ----------
    figures
        Figures of the run, see `fenics_ehd.multibody.figures.figures_of`.
    body
        Name of the body whose angle is the reference angle.
    searched
        Whether the run searched a periodic solution, so that figures are those of a cycle.
    columns
        Columns of the joints over time, which are the scales of their means.
    """
    joints = tuple(dict.fromkeys(figure.joint for figure in figures if figure.joint))
    blocks = []
    if joints:
        cells = {
            joint: _cells(
                [figure for figure in figures if figure.joint == joint],
                body,
                columns.get(joint, {}),
            )
            for joint in joints
        }
        names = list(dict.fromkeys(name for column in cells.values() for name in column))
        rows = tuple(
            Row(
                _label(name, searched=searched),
                tuple(cells[joint].get(name) for joint in joints),
            )
            for name in _main_first(names)
        )
        span = "over the last cycle" if searched else "over the run"
        shown = tuple(row for row in rows if not row.zero)
        zero = tuple(row for row in rows if row.zero)
        blocks.append(Block(f"Results of the oil films, {span}", joints, shown, zero))
    of_run = [figure for figure in figures if not figure.joint]
    if of_run:
        cells_of_run = _cells(of_run, body, None)
        rows = tuple(Row(label_of(name), (cell,)) for name, cell in cells_of_run.items())
        blocks.append(Block("The run", (), rows))
    return blocks


def _label(name: str, *, searched: bool) -> str:
    """Label of a row; in a run without a search, figures of its last cycle are marked as such."""
    of_cycle = name.startswith(CYCLE) and not searched
    return label_of(name) + ", last cycle" * of_cycle


def _main_first(names: Sequence[str]) -> list[str]:
    """Names of rows: peak pressure and minimum film first, then extremes and means of the cycle."""
    first = ["max_pressure_Pa", "min_film_thickness_m"]
    main = [f"{prefix}{name}" for name in first for prefix in ("", CYCLE)]
    order = [*main, *(name for name in names if name.startswith(CYCLE))]
    return [*dict.fromkeys(name for name in (*order, *names) if name in names)]


def _cells(
    figures: Iterable[Figure], body: str, columns: Mapping[str, np.ndarray] | None
) -> dict[str, Cell]:
    """Cells of one joint by the name of their figure; positions belong to the figure they follow.

    `body` is the body whose angle is the reference angle, `columns` are the columns of the joint.
    Without columns, no figure counts as zero.
    """
    by_name = {figure.name: figure for figure in figures}
    main = {name: figure for name, figure in by_name.items() if figure.reason != POSITION}
    cells: dict[str, Cell] = {}
    shared: dict[str, str] = {}
    for name, figure in main.items():
        former = name.removeprefix(CYCLE)
        if former != name and former in cells and by_name[former].value == figure.value:
            cells[former].names.append(_full(figure))
            shared[name] = former
        else:
            zero = columns is not None and is_zero(figure, columns)
            value = _with_unit(0.0, name) if zero else value_text(figure)
            cells[name] = Cell([_full(figure)], value, "" if zero else bound_text(figure), zero)
    for name, figure in by_name.items():
        if figure.reason != POSITION:
            continue
        end = next(end for end in POSITIONS if name.endswith(end))
        stem = name.removesuffix(end)
        # A dimensionless figure has no unit at the end of its name.
        owners = (other for other in main if other == stem or other.startswith(f"{stem}_"))
        owner = next(owners, None)
        if owner is None:
            cells[name] = Cell([_full(figure)], value_text(figure), "")
            continue
        words = POSITIONS[end].format(body="crank" if body in ("", CRANK) else body)
        text = f"{words}{position_text(figure)}"
        cells[shared.get(owner, owner)].positions.append(Position((_full(figure),), text))
    return cells


def _full(figure: Figure) -> str:
    return f"{figure.joint}.{figure.name}".lstrip(".")
