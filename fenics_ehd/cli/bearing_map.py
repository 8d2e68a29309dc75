"""``fenics-ehd bearing`` over ranges of speeds and loads: table, picture, printed rows, JSON.

Imports inside functions: ``--help`` must work without NumPy and films, and quickly.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import beginning_with, keeping_failed_film, require_output
from fenics_ehd.base.printed import scatter_text
from fenics_ehd.base.progress import shown_progress
from fenics_ehd.cli.options import aligned, answer, warn_of

if TYPE_CHECKING:
    from fenics_ehd.analysis.bearing_settings import BearingSettings
    from fenics_ehd.scenes.bearing_map import BearingMap

#: Entries of a matrix of coefficients, by their names.
ENTRIES = ("xx", "xy", "yx", "yy")

#: Kind of the table of a map: its first column is the speed, by the name that ROSS reads.
TABLE_KIND = beginning_with("a table of bearing coefficients", b"frequency,")

#: Columns of printed rows: name in the table, column of its scatter, heading, factor, format.
Columns = tuple[tuple[str, str, str, float, str], ...]

#: Columns that name the point of a row.
POINT: Columns = (
    ("frequency", "", "rad/s", 1.0, ".5g"),
    ("load_N", "", "load N", 1.0, ".5g"),
)

#: Columns of each of the printed tables, after those of the point.
SHOWN: tuple[Columns, ...] = (
    (
        ("eccentricity_ratio", "", "e / c", 1.0, ".3f"),
        *(
            (f"k{entry}", f"k{entry}_scatter_N_per_m", f"k{entry} MN/m", 1e-6, ".4g")
            for entry in ENTRIES
        ),
    ),
    tuple(
        (f"c{entry}", f"c{entry}_scatter_Ns_per_m", f"c{entry} kN s/m", 1e-3, ".4g")
        for entry in ENTRIES
    ),
    (
        ("critical_mass_kg", "critical_mass_scatter_kg", "critical mass kg", 1.0, ".4g"),
        (
            "whirl_frequency_ratio",
            "whirl_frequency_ratio_scatter",
            "whirl ratio",
            1.0,
            ".3f",
        ),
    ),
)


def answer_map(
    settings: BearingSettings,
    speeds: Sequence[float],
    loads: Sequence[float],
    eccentricity: float | None,
    *,
    table: str | None,
    plot: str | None,
    inputs: Sequence[str],
    as_json: bool,
) -> None:
    """Compute a bearing map, write its table and picture, and print its rows.

    Parameters
    ----------
    settings, speeds, loads, eccentricity
        See `fenics_ehd.scenes.bearing_map.bearing_map`.
    table, plot
        Paths of the table and of the picture; a file whose path is None is not written.
    inputs
        Paths of the input files, which must not be replaced.
    as_json
        Whether results are printed as JSON.

    Raises
    ------
    FailedCasesError
        Some points have no result; all other points are written and printed.
    """
    from fenics_ehd.scenes.bearing_map import bearing_map
    from fenics_ehd.study.cases import write_table
    from fenics_ehd.study.pool import FailedCasesError

    if plot:
        from fenics_ehd.plotting.bearing_map import plot_bearing_map
        from fenics_ehd.plotting.picture import ENDINGS, require_format

        if len(speeds) > 1 and len(loads) > 1:
            raise SettingsError(
                "--plot: a picture has one axis, but --speed and --load are both ranges: give one "
                "of them, or --table alone"
            )
        require_format("--plot", plot, ENDINGS, inputs)
    if table:
        if Path(table).suffix.lower() != ".csv":
            raise SettingsError(f"--table {table}: the file must end with .csv")
        require_output(table, TABLE_KIND, inputs, "--table")
    with keeping_failed_film("."):
        points = bearing_map(
            settings,
            speeds=speeds,
            loads=loads,
            eccentricity=eccentricity,
            progress=shown_progress(logs=True),
        )
    rows = points.rows()
    if rows and table:
        Path(table).parent.mkdir(parents=True, exist_ok=True)
        write_table(Path(table), tuple(rows[0]), rows)
    if rows and plot:
        plot_bearing_map(points, plot)
    warn_of(f"{point.name}: {point.reason}" for point in points.failed)
    answer(_summary(points), "\n".join(_lines(rows, table, plot)), as_json)
    if points.failed:
        number = len(points.failed)
        total = number + len(rows)
        raise FailedCasesError(
            f"{number} of {total} points have no result: {points.failed[0].name}"
        )


def _summary(points: BearingMap) -> dict[str, Any]:
    """Content of the JSON output: rows of the map, and points without a result."""
    failed = [
        {"speed_rad_per_s": point.speed, "load_N": point.load, "reason": point.reason}
        for point in points.failed
    ]
    return {"rows": points.rows(), "failed": failed}


def _lines(
    rows: Sequence[dict[str, float | None]], table: str | None, plot: str | None
) -> list[str]:
    """Printed rows of a map, and the paths of its files."""
    if not rows:
        return ["no point has a result"]
    lines = []
    for columns in SHOWN:
        shown = (*POINT, *columns)
        cells = [[heading for _, _, heading, _, _ in shown]]
        for row in rows:
            cells.append(
                [
                    _cell(row[name], row.get(scatter), factor, form)
                    for name, scatter, _, factor, form in shown
                ]
            )
        lines += aligned(cells, words=())
    if rows[0]["stiffness_scatter_N_per_m"] is not None:
        lines.append("+-: half the range over the film meshes")
    written = [f"{what} in {path}" for what, path in (("table", table), ("picture", plot)) if path]
    return [*lines, *written]


def _cell(value: float | None, scatter: float | None, factor: float, form: str) -> str:
    """Text of a value and its scatter, both times a factor; a dash if the value is None."""
    if value is None:
        return "-"
    bound = scatter_text(None if scatter is None else factor * scatter)
    return format(factor * value, form) + bound
