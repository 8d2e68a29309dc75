"""Picture of an orbit: path in the clearance circle, load, film and pressure over the cycle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from fenics_ehd.plotting.picture import FORMATS, plt, save

#: Signs at every quarter of the period, on the orbit and on the load alike.
MARKERS = ("o", "s", "D", "^")


@dataclass(frozen=True, eq=False)
class _Orbit:
    """Last whole cycle of a run, closed: time [s], and per time the rest, in SI units."""

    time: np.ndarray
    ratio: np.ndarray
    load: np.ndarray
    thickness: np.ndarray
    pressure: np.ndarray

    def at_quarters(self, values: np.ndarray) -> np.ndarray:
        """Values at 0, 1/4, 1/2 and 3/4 of the period, shape (4, 2)."""
        quarters = self.time[-1] * np.arange(4) / 4
        return np.column_stack([np.interp(quarters, self.time, column) for column in values.T])


def _last_cycle(history: Mapping[str, np.ndarray]) -> _Orbit:
    """The last cycle, or the last but one where that was cut short."""
    cycle, time = history["cycle"], history["cycle_time_s"]
    last = cycle[-1]
    if last > 1 and time[cycle == last][-1] < time[cycle == last - 1][-1]:
        last -= 1
    chosen = np.flatnonzero(cycle == last)
    # Its start is no step and has no row, but the cycle before ended there, near enough.
    rows = np.concatenate([chosen[:1] - 1, chosen]) if last > 1 else chosen
    path = np.column_stack([history["eccentricity_x_m"], history["eccentricity_y_m"]])[rows]
    thickness = history["min_film_thickness_m"][rows]
    # Between two parallel cylinders the thinnest film is c - |e|.
    clearance = thickness + np.hypot(*path.T)
    return _Orbit(
        time=np.concatenate([[0.0], time[chosen]]) if last > 1 else time[chosen],
        ratio=path / clearance[:, None],
        load=np.column_stack([history["load_x_N"], history["load_y_N"]])[rows],
        thickness=thickness,
        pressure=history["max_pressure_Pa"][rows],
    )


def plot_orbits(
    histories: Mapping[str, Mapping[str, np.ndarray]],
    directory: str | Path,
    formats: tuple[str, ...] = FORMATS,
) -> list[Path]:
    """Orbit, load diagram, thinnest film and highest pressure of one or more runs.

    Parameters
    ----------
    histories
        Columns of ``history.csv`` by the name to show in the legend.
    directory
        Where the pictures go.
    formats
        File formats.

    Returns
    -------
    list of Path
        ``orbit`` in each format.
    """
    orbits = {name: _last_cycle(history) for name, history in histories.items()}
    figure = plt.figure(figsize=(10.0, 8.2), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(3.0, 1.2, 1.2))
    _draw_orbits(figure.add_subplot(grid[0, 0]), orbits)
    _draw_loads(figure.add_subplot(grid[0, 1]), orbits)
    film = figure.add_subplot(grid[1, :])
    _draw_curves(film, orbits, "thickness", 1e6, "min. film [µm]")
    film.tick_params(labelbottom=False)
    pressure = figure.add_subplot(grid[2, :], sharex=film)
    _draw_curves(pressure, orbits, "pressure", 1e-6, "max. pressure [MPa]")
    pressure.set_xlabel("time in the period [ms]")
    figure.align_ylabels([film, pressure])
    if len(orbits) > 1:
        film.legend(loc="upper right", ncols=min(len(orbits), 4))
    return save(figure, [Path(directory) / f"orbit.{suffix}" for suffix in formats])


def _draw_path(axes: Axes, orbit: _Orbit, path: np.ndarray, colour: str) -> None:
    """A closed curve with its direction and its quarters."""
    axes.plot(*path.T, color=colour, linewidth=1.4)
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 0, "mutation_scale": 13}
    for share in (1 / 8, 3 / 8, 5 / 8, 7 / 8):
        times = orbit.time[-1] * np.array([share - 0.004, share + 0.004])
        tail, head = (np.array([np.interp(t, orbit.time, x) for x in path.T]) for t in times)
        axes.annotate("", xy=head, xytext=tail, arrowprops=style)
    for number, (point, marker) in enumerate(zip(orbit.at_quarters(path), MARKERS, strict=True)):
        filled = colour if number == 0 else "white"
        axes.plot(*point, marker, color=colour, markerfacecolor=filled, markersize=6, zorder=3)


def _draw_orbits(axes: Axes, orbits: Mapping[str, _Orbit]) -> None:
    for radius in (0.25, 0.5, 0.75, 1.0):
        outer = radius == 1.0
        axes.add_patch(
            plt.Circle(
                (0, 0),
                radius,
                fill=False,
                color="0.2" if outer else "0.85",
                linewidth=1.6 if outer else 0.8,
            )
        )
    for spine in ((-1, 1), (0, 0)), ((0, 0), (-1, 1)):
        axes.plot(*spine, color="0.85", linewidth=0.8, zorder=0)
    for number, orbit in enumerate(orbits.values()):
        _draw_path(axes, orbit, orbit.ratio, f"C{number}")
    marks = [
        axes.plot(
            [], [], marker, color="0.3", markerfacecolor="0.3" if i == 0 else "white", linestyle=""
        )[0]
        for i, marker in enumerate(MARKERS)
    ]
    axes.legend(
        marks,
        ["start", "1/4", "1/2", "3/4 period"],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.1),
        ncols=4,
        frameon=False,
        handletextpad=0.1,
        columnspacing=1.0,
    )
    axes.set(
        aspect="equal",
        xlim=(-1.06, 1.06),
        ylim=(-1.06, 1.06),
        xlabel="eccentricity x / c",
        ylabel="eccentricity y / c",
        title="orbit in the clearance circle",
    )


def _draw_loads(axes: Axes, orbits: Mapping[str, _Orbit]) -> None:
    largest = max(np.abs(orbit.load).max() for orbit in orbits.values())
    factor, unit = (1e-3, "kN") if largest >= 1e3 else (1.0, "N")
    for number, orbit in enumerate(orbits.values()):
        _draw_path(axes, orbit, factor * orbit.load, f"C{number}")
    axes.plot(0, 0, "+", color="0.2", markersize=9)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.grid(alpha=0.3)
    axes.set(xlabel=f"load x [{unit}]", ylabel=f"load y [{unit}]", title="load on the shaft")


def _draw_curves(
    axes: Axes, orbits: Mapping[str, _Orbit], name: str, factor: float, label: str
) -> None:
    for number, (legend, orbit) in enumerate(orbits.items()):
        values = factor * getattr(orbit, name)
        axes.plot(1e3 * orbit.time, values, color=f"C{number}", label=legend)
        quarters = 1e3 * orbit.time[-1] * np.arange(4) / 4
        for i, (time, marker) in enumerate(zip(quarters, MARKERS, strict=True)):
            axes.plot(
                time,
                np.interp(time, 1e3 * orbit.time, values),
                marker,
                color=f"C{number}",
                markerfacecolor=f"C{number}" if i == 0 else "white",
                markersize=5,
                clip_on=False,
                zorder=3,
            )
    axes.set(ylabel=label, ylim=(0, None))
    axes.margins(x=0)
    axes.grid(alpha=0.3)
