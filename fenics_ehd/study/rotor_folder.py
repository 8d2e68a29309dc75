"""Folder of a rotor map: stored points, tables of modes, films, shapes and unbalance, summary.

A point of the map is the rotor at one speed: its equilibrium and the small motions about it. Every
point is stored as soon as it is computed, in ``points/0001.npz`` and so on. ``rotor.json`` has all
data on which the points depend. Another map of the same scene, or the same map after an
interruption, reads these points and computes only those that are missing. Tables and summary are
written at the end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from fenics_ehd.analysis.equilibrium import Linearisation, SearchStart
from fenics_ehd.analysis.film_memory import SampledStiffness
from fenics_ehd.analysis.modes import (
    damping_ratio,
    damping_ratio_scatter,
    log_decrement,
    log_decrement_scatter,
)
from fenics_ehd.analysis.rotor_map import MapPoint, RotorMap
from fenics_ehd.analysis.unbalance import UnbalanceResponse
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.files import (
    PICTURE_FORMATS,
    SUMMARY,
    claim,
    clear,
    listed,
    locked,
    require_writable,
    to_json,
    write_whole,
)
from fenics_ehd.base.units import RPM
from fenics_ehd.multibody.forces import Unbalance
from fenics_ehd.scenes.kept_bodies import checksum
from fenics_ehd.scenes.rotor_map import RotorPlan
from fenics_ehd.study.cases import UNREADABLE, difference, identity, write_table

#: Files and folders of a rotor map.
ABOUT = "rotor.json"
MODES = "modes.csv"
FILMS = "films.csv"
SHAPES = "shapes.csv"
UNBALANCE = "unbalance.csv"
POINTS = "points"
MADE = (ABOUT, MODES, FILMS, SHAPES, UNBALANCE, SUMMARY, f"{POINTS}/")

#: Array in the file of a point that has its checksum, see `_seal`.
SEAL = "seal"


class StoredPoints(dict[float, MapPoint]):
    """Points of a map by speed [rad/s]; each point is also stored in a file.

    Parameters
    ----------
    directory
        Folder of the files.
    made_by
        Checksum of all data on which the points depend. A file that is damaged, or was made from
        other data, is not used: its point is computed again.

    Attributes
    ----------
    read
        Number of points that were read.
    notices
        For each file that is not used, a line with the reason.
    """

    def __init__(self, directory: Path, made_by: str):
        super().__init__()
        self._directory = directory
        self._made_by = made_by
        self.notices: list[str] = []
        for path in sorted(directory.glob("*.npz")):
            try:
                point = _read_point(path, made_by)
            except (OSError, ValueError, KeyError, EOFError, TypeError, BadZipFile):
                self.notices.append(
                    f"{path} is damaged, or belongs to a map with other settings: its point is "
                    "computed again if the map needs it, and the file can be deleted"
                )
            else:
                super().__setitem__(point.speed, point)
        self.read = len(self)

    def __setitem__(self, speed: float, point: MapPoint) -> None:
        number = 1
        while (self._directory / _file_name(number)).exists():
            number += 1
        claim(self._directory, [_file_name(number)])
        write_whole(self._directory / _file_name(number), _content(point, self._made_by))
        super().__setitem__(speed, point)


def _file_name(number: int) -> str:
    return f"{number:04d}.npz"


def _content(point: MapPoint, made_by: str) -> bytes:
    """Content of the file that stores a point of a map, as bytes."""
    linear = point.linear
    arrays: dict[str, Any] = {
        "speed": point.speed,
        "basis": linear.basis,
        "mass": linear.mass,
        "damping": linear.damping,
        "stiffness": linear.stiffness,
        "growth": point.growth,
        "scatter": point.scatter,
        "joints": np.array(list(linear.films), dtype=str),
        "columns": np.array(list(point.figures), dtype=str),
        "figures": np.array(list(point.figures.values()), dtype=float),
    }
    arrays |= {f"film_{n}": film for n, film in enumerate(linear.films.values())}
    sampled = linear.sampled
    arrays["shifts"] = np.zeros(0) if sampled is None else sampled.shifts
    if sampled is not None:
        arrays["sampled"] = sampled.values
        arrays |= {f"sampled_film_{n}": sampled.films[name] for n, name in enumerate(linear.films)}
    for n, start in enumerate(point.starts):
        arrays |= {
            f"x_{n}": start.x,
            f"values_{n}": start.values,
            f"patterns_{n}": start.patterns,
            f"heated_{n}": np.array(list(start.temperatures), dtype=str),
            f"temperatures_{n}": np.array(list(start.temperatures.values()), dtype=float),
        }
    content = BytesIO()
    np.savez(content, **arrays, **{SEAL: _seal(arrays, made_by)})
    return content.getvalue()


def _seal(arrays: Mapping[str, Any], made_by: str) -> str:
    """Checksum of the arrays of a point, and of the data on which the points of a map depend."""
    texts = {"made_by": made_by}
    for name, values in arrays.items():
        array = np.ascontiguousarray(values)
        content = sha256(array.tobytes()).hexdigest()
        texts[f"array {name}"] = f"{array.dtype.str} {np.shape(values)} {content}"
    return checksum(texts)


def _read_point(path: Path, made_by: str) -> MapPoint:
    """Read the file of a point.

    Raises
    ------
    OSError, ValueError, KeyError, EOFError, TypeError, BadZipFile
        The file cannot be read, was changed after it was written, or is a point of another map.
    """
    with np.load(path, allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files}
    if str(arrays.pop(SEAL)) != _seal(arrays, made_by):
        raise ValueError("the seal of the file is not that of its content in this map")
    films = {str(joint): arrays[f"film_{n}"] for n, joint in enumerate(arrays["joints"])}
    starts = [
        SearchStart(
            arrays[f"x_{n}"],
            arrays[f"values_{n}"],
            int(arrays[f"patterns_{n}"]),
            _by_name(arrays[f"heated_{n}"], arrays[f"temperatures_{n}"]),
        )
        for n in range(len(arrays["growth"]))
    ]
    return MapPoint(
        float(arrays["speed"]),
        Linearisation(
            arrays["basis"],
            arrays["mass"],
            arrays["damping"],
            arrays["stiffness"],
            films,
            _read_sampled(arrays, list(films)),
        ),
        _by_name(arrays["columns"], arrays["figures"]),
        arrays["growth"],
        arrays["scatter"],
        tuple(starts),
    )


def _read_sampled(
    arrays: Mapping[str, np.ndarray], joints: Sequence[str]
) -> SampledStiffness | None:
    """Samples of the dynamic stiffness in the file of a point; None without samples."""
    shifts = arrays["shifts"]
    if not len(shifts):
        return None
    films = {joint: arrays[f"sampled_film_{n}"] for n, joint in enumerate(joints)}
    return SampledStiffness(shifts, arrays["sampled"], films)


def _by_name(names: np.ndarray, values: np.ndarray) -> dict[str, float]:
    return {str(name): float(value) for name, value in zip(names, values, strict=True)}


def _identity(plan: RotorPlan) -> dict[str, str]:
    """All data on which the points of a map depend, as text by key.

    Unbalances do not act in an equilibrium: the response to them is computed from stored points.
    The times of a run are not used.
    """
    unused = [
        f"forces.{name}."
        for name, force in plan.scene.forces.items()
        if isinstance(force, Unbalance)
    ]
    values = identity(plan.scene).items()
    about = {key: text for key, text in values if not key.startswith(("time.", *unused))}
    return about | {"rotating": ", ".join(plan.rotating), "meshes": str(plan.meshes)}


class RotorFolder(ExitStack):
    """Folder of a rotor map, which one process at a time can use.

    Parameters
    ----------
    directory
        Path of the folder; it is created if it does not exist.
    plan
        Checked arguments of the map.
    overwrite
        Whether the points of another map are removed.

    Attributes
    ----------
    points
        Points that are stored in the folder.

    Raises
    ------
    InputError
        The folder has the map of another scene, or cannot be written to.
    InUseError
        Another process uses the folder.
    """

    command = "rotor"

    def __init__(self, directory: str | Path, plan: RotorPlan, *, overwrite: bool = False):
        super().__init__()
        self.path = Path(directory)
        self.plan = plan
        about = _identity(plan)
        require_writable(self.path)
        self.path.mkdir(parents=True, exist_ok=True)
        with ExitStack() as held:
            held.enter_context(locked(self.path))
            claim(self.path, MADE, self.command)
            if overwrite:
                clear(self.path, MADE)
            self._require_same(about)
            (self.path / SUMMARY).unlink(missing_ok=True)
            write_whole(self.path / ABOUT, to_json(about) + "\n")
            claim(self.path / POINTS, [])
            self.points = StoredPoints(self.path / POINTS, checksum(about))
            self.push(held.pop_all())

    def _require_same(self, about: Mapping[str, str]) -> None:
        """Refuse the folder if its points are those of another scene."""
        path = self.path / ABOUT
        if not any((self.path / POINTS).glob("*.npz")):
            return
        reason = difference(path, about, more_keys=False)
        if reason == UNREADABLE:
            raise InputError(f"{path} cannot be read: choose another folder or use --overwrite")
        if reason:
            raise InputError(
                f"{self.path} has the rotor map of another scene ({reason}): choose another folder "
                "or use --overwrite"
            )

    def write(self, chart: RotorMap, shown: Sequence[int]) -> None:
        """Write the tables of a map, and remove former pictures.

        `shown` are the indices of the speeds whose mode shapes are written.
        """
        drawn = tuple(f".{ending}" for ending in PICTURE_FORMATS)
        clear(self.path, [name for name in listed(self.path) if name.endswith(drawn)])
        _write(self.path / MODES, mode_rows(chart))
        _write(self.path / FILMS, film_rows(chart))
        _write(self.path / SHAPES, shape_rows(chart, shown))
        if chart.response is not None:
            _write(self.path / UNBALANCE, unbalance_rows(chart.response))

    def write_summary(self, entries: Mapping[str, Any]) -> None:
        """Write the summary of the map, after all other files."""
        write_whole(self.path / SUMMARY, to_json(entries) + "\n")


def _write(path: Path, rows: Iterator[dict[str, Any]]) -> None:
    """Write a table; its columns are the keys of its first row, in the same order."""
    table = list(rows)
    columns = dict.fromkeys(column for row in table for column in row)
    write_table(path, list(columns), table)


def mode_rows(chart: RotorMap) -> Iterator[dict[str, Any]]:
    """Rows of ``modes.csv``: one for every mode at every speed."""
    for n, speed in enumerate(chart.speeds):
        for track in np.flatnonzero(chart.tracks[:, n] >= 0):
            root = complex(chart.roots[track, n])
            scatter = complex(chart.scatter[track, n])
            yield {
                "speed_rad_per_s": float(speed),
                "mode": int(track) + 1,
                "real_part_1_per_s": root.real,
                "frequency_rad_per_s": root.imag,
                "damping_ratio": damping_ratio(root),
                "logarithmic_decrement": log_decrement(root),
                "direction": chart.direction(n, int(track)) if root.imag else None,
                "real_part_scatter_1_per_s": scatter.real,
                "frequency_scatter_rad_per_s": scatter.imag,
                "damping_ratio_scatter": damping_ratio_scatter(root, scatter),
                "logarithmic_decrement_scatter": log_decrement_scatter(root, scatter),
                "overlap": float(chart.overlaps[track, n]),
            }


def film_rows(chart: RotorMap) -> Iterator[dict[str, Any]]:
    """Rows of ``films.csv``: figures of all films in equilibrium at every speed."""
    for point in chart.points:
        yield {"speed_rad_per_s": point.speed, **point.figures}


def shape_rows(chart: RotorMap, shown: Sequence[int]) -> Iterator[dict[str, Any]]:
    """Rows of ``shapes.csv``: complex deflections of all points of the rotor in its modes.

    `shown` are the indices of the speeds.
    """
    stations = chart.stations
    for n in shown:
        for track in np.flatnonzero(chart.tracks[:, n] >= 0):
            shape = chart.shape(n, int(track))
            for k, name in enumerate(stations.names):
                u, v = shape[k]
                yield {
                    "speed_rad_per_s": float(chart.speeds[n]),
                    "mode": int(track) + 1,
                    "point": name,
                    "z_m": float(stations.heights[k]),
                    "u_real": float(u.real),
                    "u_imag": float(u.imag),
                    "v_real": float(v.real),
                    "v_imag": float(v.imag),
                }


def unbalance_rows(response: UnbalanceResponse) -> Iterator[dict[str, Any]]:
    """Rows of ``unbalance.csv``: amplitudes, phases and bearing forces at every speed."""
    columns: dict[str, np.ndarray] = {"speed_rad_per_s": response.speeds}
    for name in response.points:
        columns[f"{name}.amplitude_m"] = response.amplitude(name)
        columns[f"{name}.phase_deg"] = np.degrees(response.phase(name))
    for joint in response.forces:
        columns[f"{joint}.force_amplitude_N"] = response.bearing_force(joint)
    for n in range(len(response.speeds)):
        yield {column: float(values[n]) for column, values in columns.items()}


def figures_of_map(chart: RotorMap) -> dict[str, Any]:
    """Entries of ``summary.json`` for a map: stability limits, critical speeds and resonances."""
    lost = next((limit for limit in chart.limits if limit.lost), None)
    return {
        "speeds": len(chart.points),
        "failed_speeds": [
            {"speed_rad_per_s": speed, "reason": reason} for speed, reason in chart.failures.items()
        ],
        "stable_at_first_speed": chart.stable_at_first_speed,
        "stability_limit_rad_per_s": lost.speed if lost else None,
        "stability_limit_scatter_rad_per_s": lost.scatter if lost else None,
        "whirl_ratio": lost.whirl_ratio if lost else None,
        "whirl_ratio_scatter": lost.whirl_ratio_scatter if lost else None,
        "stability_limits": [
            {
                "speed_rad_per_s": limit.speed,
                "speed_rpm": limit.speed * RPM,
                "mode": limit.mode + 1,
                "whirl_ratio": limit.whirl_ratio,
                "direction": limit.direction,
                "stability": "lost" if limit.lost else "regained",
                "scatter_rad_per_s": limit.scatter,
                "whirl_ratio_scatter": limit.whirl_ratio_scatter,
            }
            for limit in chart.limits
        ],
        "critical_speeds": [
            {
                "speed_rad_per_s": critical.speed,
                "speed_rpm": critical.speed * RPM,
                "mode": critical.mode + 1,
                "damping_ratio": critical.damping_ratio,
                "direction": critical.direction,
                "scatter_rad_per_s": critical.scatter,
                "damping_ratio_scatter": critical.damping_ratio_scatter,
                "unstable": not chart.stable_at(critical.speed),
            }
            for critical in chart.critical_speeds
        ],
        **({} if chart.response is None else _response_figures(chart, chart.response)),
    }


def _response_figures(chart: RotorMap, response: UnbalanceResponse) -> dict[str, Any]:
    return {
        "unbalances": [
            {"point": each.point, "magnitude_kg_m": each.magnitude, "phase_deg": each.phase}
            for each in response.unbalances
        ],
        "resonances": [
            {
                "point": peak.point,
                "speed_rad_per_s": peak.speed,
                "speed_rpm": peak.speed * RPM,
                "amplitude_m": peak.amplitude,
                "amplification_factor": peak.amplification,
                "unstable": not chart.stable_at(peak.speed),
            }
            for peak in response.resonances
        ],
        "max_bearing_force_N": {
            joint: float(response.bearing_force(joint).max()) for joint in response.forces
        },
    }
