"""Pictures of a run's report: the five that decide, chosen by the data that the run has.

All joints share a picture, with one curve each. A run with many joints shows those with the
smallest minimum film, relative to the clearance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.figure import Figure

from fenics_ehd.plotting.curves import Curves, common_axis
from fenics_ehd.plotting.maps import draw_rasters, raster_of
from fenics_ehd.plotting.picture import PRESSURES
from fenics_ehd.plotting.pictures import QUANTITIES
from fenics_ehd.plotting.shown import ANGLE, TIME, ShownJoint, ShownRun

#: Share of the load on asperities above which the picture of contact is shown.
CARRIED = 0.01

#: Largest number of joints whose curves share a picture.
MOST_JOINTS = 4

#: Pictures of which the first one with data is the last picture of the report, with captions.
LAST = {
    "contact": "Asperity contact: force, largest pressure, shares of load and area, and film over "
    "combined roughness.",
    "friction": "Friction torques on journal and bore, and friction power loss; lines: means.",
    "energy": "Energy stored, work done on the mechanism, energy lost, and error of the balance.",
}


@dataclass(frozen=True)
class Picture:
    """A picture of the report.

    Attributes
    ----------
    name
        Name of the picture, unique in the report.
    caption
        Sentence below the picture.
    figure
        The drawn figure.
    """

    name: str
    caption: str
    figure: Figure


def thinnest_first(run: ShownRun) -> list[ShownJoint]:
    """Joints of a run, sorted by minimum film thickness over clearance."""

    def relative_film(joint: ShownJoint) -> float:
        return float(joint.columns["min_film_thickness_m"].min()) / float(joint.film.clearance)

    return sorted(run.joints.values(), key=relative_film)


def deciding_pictures(run: ShownRun) -> Iterator[Picture]:
    """Yield the pictures that decide whether a run's bearings are acceptable, at most five."""
    ranked = thinnest_first(run)
    joints = [joint for joint in run.joints.values() if joint in ranked[:MOST_JOINTS]]
    if joints:
        yield from _of_films(joints)
        highest = max(joints, key=lambda joint: float(joint.columns["max_pressure_Pa"].max()))
        yield Picture(
            "pressure_at_the_peak",
            f"Film pressure on the unwrapped bore of {highest.name} at the instant of its peak. "
            "The circle marks the largest value.",
            _pressure_at_peak(highest),
        )
    for name, caption in LAST.items():
        if name == "contact" and not _touching(joints):
            continue
        figure = _figure(name, joints, run)
        if figure is not None:
            yield Picture(name, caption, figure)
            return


def _touching(joints: Sequence[ShownJoint]) -> bool:
    """Whether asperities carry a share of a load that decides anything."""
    shares = [
        joint.columns["contact_share"] for joint in joints if "contact_share" in joint.columns
    ]
    return any(float(share.max()) > CARRIED for share in shares)


def _of_films(joints: Sequence[ShownJoint]) -> Iterator[Picture]:
    """Yield pictures of pressure and film over the cycle, of orbits and of loads."""
    panels = [
        panel
        for name in ("max_pressure", "min_film_thickness")
        for panel in QUANTITIES[name].panels  # type: ignore[union-attr]
    ]
    yield Picture(
        "over_the_cycle",
        "Peak oil film pressure and minimum oil film thickness over the cycle. Bands are the "
        "estimated errors of the curves.",
        Curves(tuple(panels)).draw({joints[0].name if len(joints) == 1 else "": joints}),
    )
    run = joints[0].run
    along = (
        f"{run.angle_name} in degrees" if common_axis(joints) == ANGLE else f"{run.time_name} in ms"
    )
    for name, caption in (
        (
            "orbit",
            "Path of the journal in the deformed bore, in the frame of the bore. The black circle "
            f"is the clearance; numbers along the path: {along}.",
        ),
        ("force", "Polar load diagram: load of the journal on the bore, in the frame of the bore."),
    ):
        figure = _figure(name, joints)
        if figure is not None:
            yield Picture(name, caption, figure)


def _pressure_at_peak(joint: ShownJoint) -> Figure:
    """Map of the film pressure of a joint at the step with its largest pressure."""
    step = int(np.argmax(joint.columns["max_pressure_Pa"]))
    peak, angle, height = (
        float(joint.columns[name][step])
        for name in ("max_pressure_Pa", "max_pressure_angle_deg", "max_pressure_height_m")
    )
    raster = raster_of(joint.grid, 1e-6 * np.asarray(joint.film.pressure[step]), joint.name)
    _, peak = joint.extreme("max_pressure_Pa", TIME) or (0.0, peak)
    raster = raster._replace(mark=(1e-6 * peak, angle, 1e3 * height))
    return draw_rasters([[raster]], "pressure [MPa]", PRESSURES)


def _figure(name: str, joints: Sequence[ShownJoint], run: ShownRun | None = None) -> Figure | None:
    """Figure of a quantity for several joints, or for a whole run; None without data."""
    quantity = QUANTITIES[name]
    if isinstance(quantity, Curves) and quantity.of_run:
        joints = [run.whole] if run is not None else []
    drawn = [joint for joint in joints if quantity.has(joint)]
    title = drawn[0].name if len(drawn) == 1 else ""
    return quantity.draw({title: drawn}) if drawn else None
