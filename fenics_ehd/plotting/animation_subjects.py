"""From a run and its body to what an animation shows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from fenics_ehd.motion import Motion, crank_angles
from fenics_ehd.multibody.rotor import ModalRotor
from fenics_ehd.plotting.animation import Show, Subject
from fenics_ehd.plotting.animation_crank import BigEnd, CrankDrawing, CrankFrames, chord_frames
from fenics_ehd.plotting.animation_film import FilmFrames, film_frames
from fenics_ehd.plotting.animation_part import PartView
from fenics_ehd.plotting.animation_rotor import Deflection, HousingDrawing, Orbit, RotorFrames
from fenics_ehd.plotting.animation_shape import PartShape, bore_displacement, normals
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.rotor_run import build_rotor
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

#: Clearance as drawn over the bore's radius, and largest displacement as drawn over the part's
#: extent, that an automatic scale may reach.
DRAWN_CLEARANCE, DRAWN_DISPLACEMENT = 0.18, 0.08

#: Points along a shaft at which its deflection is drawn.
POINTS = 81

#: First digits of an automatic scale.
DIGITS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)


def automatic_scale(clearance: float, radius: float, displacement: float, extent: float) -> float:
    """Enlargement at which clearance and displacements are seen, a round number of at least 1.

    Parameters
    ----------
    clearance, radius
        Of the bearing [m].
    displacement
        The largest one [m].
    extent
        Of the part [m].
    """
    largest = DRAWN_CLEARANCE * radius / clearance
    if displacement > 0:
        largest = min(largest, DRAWN_DISPLACEMENT * extent / displacement)
    power = 10.0 ** np.floor(np.log10(largest))
    return max(1.0, max(digit for digit in DIGITS if digit * power <= largest * (1 + 1e-9)) * power)


def slider_crank_subject(
    settings: SliderCrankSettings,
    body: ReducedBody,
    shape: PartShape,
    motion: Motion,
    history: Mapping[str, np.ndarray],
    scale: float | None,
) -> Subject:
    """A slider-crank at the instants of `motion`.

    Parameters
    ----------
    settings, body
        Of the run.
    shape
        What shows of the rod.
    motion
        Instants to be shown.
    history
        Columns of the whole run.
    scale
        Enlargement of displacements and clearance, None: automatic.
    """
    translation = motion.coordinates[:, :2]
    film = _film(settings, body, motion, motion.coordinates[:, 2:], translation @ normals(body).T)
    frames, factor = crank_frames(settings, body, shape, motion, scale)

    def machine(figure: Figure, place: SubplotSpec) -> Show:
        return CrankDrawing(figure.add_subplot(place), frames, film, factor).show

    def close_up(figure: Figure, place: SubplotSpec) -> Show:
        return BigEnd(figure.add_subplot(place), frames, film, factor).show

    return Subject(
        motion.time,
        _name(body),
        lambda frame: f"crank angle {np.degrees(frames.crank_angle[frame]):.0f}°",
        _note(factor, shape),
        "the rod's axis",
        film,
        dict(history),
        machine,
        close_up,
    )


def crank_frames(
    settings: SliderCrankSettings,
    body: ReducedBody,
    shape: PartShape,
    motion: Motion,
    scale: float | None,
) -> tuple[CrankFrames, float]:
    """Where a slider-crank is drawn, and the scale; arguments as in `slider_crank_subject`."""
    mechanism = settings.mechanism
    translation, q = motion.coordinates[:, :2], motion.coordinates[:, 2 : 2 + body.modes]
    angle = crank_angles(motion, mechanism.crank_speed)
    crank_pin = mechanism.crank_length * np.column_stack([np.cos(angle), np.sin(angle)])
    pin, nodes = body.points["pin"][:2], shape.nodes[:, :2]

    def moved(frame: int) -> np.ndarray:
        return translation[frame] + shape.displacement(q[frame], motion.quasi_static[frame])

    def enlarged(factor: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        pin_motion = translation + q @ pin[:, 3:].T
        return chord_frames(crank_pin, angle, pin[:, 0], pin_motion, nodes, moved, factor)

    length = float(np.hypot(*pin[:, 0]))
    if scale is None:
        largest = float(np.abs(enlarged(1.0)[0] - nodes).max())
        clearance = settings.bearing.clearance
        scale = automatic_scale(clearance, body.bore_radius, largest, length)
    local, drawn_pin, direction = enlarged(scale)
    beside = np.hypot(*(nodes - pin[:, 0]).T).min()
    radius = float(min(max(beside, 0.04 * length), 0.12 * length))
    rod = PartView(nodes, local, shape.faces, shape.mesh)
    return CrankFrames(crank_pin, angle, direction, drawn_pin, rod, radius), scale


def rotor_subject(
    settings: RotorSettings,
    body: ReducedBody,
    shape: PartShape,
    motion: Motion,
    history: Mapping[str, np.ndarray],
    scale: float | None,
) -> Subject:
    """A rotor in its housing; arguments as in `slider_crank_subject`."""
    rotor, clearance = build_rotor(settings), settings.bearing.clearance
    a, q = np.split(motion.coordinates, [rotor.size], axis=1)
    moved = np.stack(
        [shape.displacement(*pair) for pair in zip(q, motion.quasi_static, strict=True)]
    )
    if scale is None:
        extent = float(np.ptp(shape.nodes[:, :2], axis=0).max())
        largest = float(np.abs(moved).max())
        scale = automatic_scale(clearance, body.bore_radius, largest, extent)
    factor = scale
    frames = _rotor_frames(settings, rotor, shape, a, motion.time, factor * moved)
    film = _film(settings, body, motion, q, -_shaft_outward(body, frames))
    orbit = np.column_stack([history["eccentricity_x_m"], history["eccentricity_y_m"]])

    def machine(figure: Figure, place: SubplotSpec) -> Show:
        return Deflection(figure.add_subplot(place), frames).show

    def close_up(figure: Figure, place: SubplotSpec) -> Show:
        return HousingDrawing(figure.add_subplot(place), frames, film, factor).show

    def aside(figure: Figure, place: SubplotSpec) -> Show:
        axes = figure.add_subplot(place)
        return Orbit(axes, orbit, history["time_s"], motion.time, clearance).show

    return Subject(
        motion.time,
        _name(body),
        lambda frame: f"shaft angle {np.degrees(frames.angle[frame]):.0f}°",
        _note(factor, shape),
        "x",
        film,
        dict(history),
        machine,
        close_up,
        aside,
    )


def _rotor_frames(
    settings: RotorSettings,
    rotor: ModalRotor,
    shape: PartShape,
    coordinates: np.ndarray,
    time: np.ndarray,
    enlarged: np.ndarray,
) -> RotorFrames:
    """Where rotor and housing are drawn, for coordinates of the shaft, shape (t, s)."""
    u, v, psi_x, psi_y = rotor.motion(settings.bearing.position) @ coordinates.T
    positions = np.linspace(0.0, 1.0, POINTS)
    nodes, shaft = shape.nodes[:, :2], settings.shaft
    return RotorFrames(
        PartView(nodes, nodes + enlarged, shape.faces, shape.mesh),
        np.column_stack([u, v]),
        np.column_stack([psi_y, -psi_x]),
        shaft.speed * time,
        shaft.length * positions,
        np.stack([coordinates @ rotor.deflection(p).T for p in positions], axis=1),
        _marks(settings),
    )


def _shaft_outward(body: ReducedBody, frames: RotorFrames) -> np.ndarray:
    """Displacement of the shaft towards each node of the bore, shape (t, m) [m]."""
    height = body.bore_nodes[:, 2]
    centre = frames.shaft[:, None] + frames.slope[:, None] * height[:, None]
    return np.einsum("tmc,mc->tm", centre, normals(body))


def _film(
    settings: SliderCrankSettings | RotorSettings,
    body: ReducedBody,
    motion: Motion,
    coordinates: np.ndarray,
    rigid: np.ndarray,
) -> FilmFrames:
    """Film for coordinates that begin with the elastic ones; `rigid` is the gap's rest, (t, m)."""
    clearance = settings.bearing.clearance
    elastic = bore_displacement(body, coordinates[:, : body.modes], motion.quasi_static)
    gap = clearance + rigid + elastic
    return film_frames(body.pressure_nodes, motion.pressure, body.bore_nodes, gap, clearance)


def _marks(settings: RotorSettings) -> dict[str, float]:
    """Names along the shaft; what shares a place shares a line."""
    places: dict[float, list[str]] = {}
    for name, share in (
        ("bearing", settings.bearing.position),
        ("disk", settings.disk.position),
        ("force", settings.force.position),
    ):
        places.setdefault(share, []).append(name)
    return {", ".join(names): settings.shaft.length * share for share, names in places.items()}


def _name(body: ReducedBody) -> str:
    return f"{body.method.upper()}, {body.modes} modes" if body.modes else "rigid part"


def _note(scale: float, shape: PartShape) -> str:
    text = f"displacements and clearance × {scale:g}, dashed: without"
    return text if shape.mesh else f"{text}; of the part, only the bore is known"
