"""One rigid bearing as a scene: a massless journal in a massless bore with a fixed axis.

The scene is built as the scene of any machine, with two exceptions. The film's mesh is finer where
the film is thin, and is made again if the journal moves (`fenics_ehd.analysis.bearing_mechanism`).
The shape of the bore may be a Python object. `fenics_ehd.analysis.bearing` computes the
equilibrium.
"""

from __future__ import annotations

from math import degrees, pi
from typing import Any

import attrs
import numpy as np

from fenics_ehd.analysis.bearing import BearingResult, bearing_result
from fenics_ehd.analysis.bearing_mechanism import Bearing
from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.base.arguments import require_class, require_names
from fenics_ehd.base.checks import as_float, require_finite
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.shared_settings import Roughness
from fenics_ehd.film.grid import MeshMaker
from fenics_ehd.multibody.body import MasslessBody
from fenics_ehd.multibody.joints import Revolute, Speed
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.build import unassembled
from fenics_ehd.scenes.scene import Scene

#: Names of the lubricated joint and of its oil.
FILM = "film"
OIL = "oil"

#: Angle of the maximum film in the film's frame, if the bore is round [degrees].
MAX_FILM = 180.0


def bearing_scene(settings: BearingSettings, angle: float) -> Scene:
    """Scene of a bearing without a load, its journal centred in the bore.

    Parameters
    ----------
    settings
        Settings of the bearing.
    angle
        Angle from the load line to the x axis of the film's frame [rad]; the bore starts at this
        angle.
    """
    squeeze_rate = float(np.hypot(*settings.squeeze)) / settings.clearance
    return Scene(
        bodies={"shaft": MasslessBody(), "bore": MasslessBody(angle=degrees(angle))},
        joints={FILM: _joint(settings, angle), "axis": Revolute(("bore", "ground"))},
        drives={
            "shaft": Speed(settings.direction * settings.speed),
            "bore": Speed(settings.direction * settings.bore_speed),
        },
        lubricants={OIL: settings.oil},
        # The duration affects only the film's reference rate, and thereby only round-off.
        time=schema.TimeSettings(end=2 * pi / max(squeeze_rate, 1.0)),
        name="bearing",
    )


def _joint(settings: BearingSettings, angle: float) -> schema.LubricatedSettings:
    """Settings of the lubricated joint of a bearing, with angles measured in the film's frame."""
    grooves = tuple(
        (degrees(groove.angle - angle), degrees(groove.width), groove.pressure)
        for groove in settings.grooves
    )
    if settings.line_at_max_film:
        grooves = ((MAX_FILM, 0.0, 0.0),)
    return schema.LubricatedSettings(
        journal="shaft",
        bore="bore",
        clearance=settings.clearance,
        lubricant=OIL,
        radius=settings.radius,
        width=settings.width,
        element=settings.element,
        ambient_pressure=settings.ambient,
        grooves=grooves,
        cavitation=settings.cavitation,
        shear_rule=settings.shear_rule,
        contact=_contact(settings),
        bore_shape=settings.relative_shape(angle),
    )


def _contact(settings: BearingSettings) -> schema.ContactSettings:
    """Contact settings that give a contact modulus [Pa].

    Both surfaces have the same Young's modulus, and a Poisson's ratio of 0.
    """
    roughness = {field.name: getattr(settings, field.name) for field in attrs.fields(Roughness)}
    youngs_modulus = 2 * settings.contact_modulus
    return schema.ContactSettings(
        journal_modulus=youngs_modulus,
        journal_poissons_ratio=0.0,
        bore_modulus=youngs_modulus,
        bore_poissons_ratio=0.0,
        **roughness,
    )


def build_bearing(settings: BearingSettings, angle: float, mesh: MeshMaker) -> Mechanism:
    """Mechanism of a bearing without a load, see `bearing_scene`.

    Parameters
    ----------
    settings, angle
        Settings of the bearing and angle of the film's frame, see `bearing_scene`.
    mesh
        Function that makes the film's mesh, see `MeshMaker`.

    Raises
    ------
    SettingsError
        A value cannot be used; the message names its key in the settings of the bearing.
    """
    try:
        return unassembled(bearing_scene(settings, angle), {FILM: mesh})
    except SettingsError as error:
        raise SettingsError(str(error).removeprefix(f"joints.{FILM}.")) from None


def solve_bearing(
    settings: BearingSettings,
    *,
    eccentricity: float | None = None,
    load: float | None = None,
    with_coefficients: bool = False,
) -> BearingResult:
    """Operating point of a bearing, see `bearing_result`.

    Parameters
    ----------
    settings
        Settings of the bearing.
    eccentricity, load
        Eccentricity ratio in 0..1 or load [N], exactly one of them.
    with_coefficients
        Whether to compute stiffness, damping and the stability threshold.
    """
    require_class("settings", settings, BearingSettings)
    return bearing_result(
        Bearing(settings, build_bearing),
        eccentricity=eccentricity,
        load=load,
        with_coefficients=with_coefficients,
    )


def bearing(
    *,
    eccentricity: float | None = None,
    load: float | None = None,
    with_coefficients: bool = False,
    **settings: Any,
) -> BearingResult:
    """Compute the operating point of a bearing whose settings are keyword arguments.

    The keyword arguments are the fields of `BearingSettings` and the parameters of `solve_bearing`.
    A load may have a unit: ``"5 kN"``.
    """
    require_names("bearing", settings, attrs.fields_dict(BearingSettings))
    size = as_float(load, "N")
    if load is not None:
        require_finite("load", size, "N")
    return solve_bearing(
        BearingSettings(**settings),
        eccentricity=eccentricity,
        load=size,
        with_coefficients=with_coefficients,
    )
