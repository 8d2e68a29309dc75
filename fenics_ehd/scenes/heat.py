"""Heat of a scene's lubricated joints, and the oil at the temperature where it begins."""

from __future__ import annotations

from typing import TYPE_CHECKING

import attrs

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.oil import OilSettings
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.scene import Scene

if TYPE_CHECKING:  # slow to import, and what only reads a scene does without
    from fenics_ehd.film.heat import Heat
    from fenics_ehd.film.lubricant import Lubricant


def joint_lubricant(scene: Scene, joint: schema.LubricatedSettings) -> Lubricant:
    """Oil of a joint; where its heat is balanced, at the supply's temperature."""
    from fenics_ehd.film.lubricant import Lubricant
    from fenics_ehd.film.oil_settings import make_lubricant

    if joint.lubricant == NONE:
        return Lubricant(joint.viscosity)
    settings = scene.lubricants[joint.lubricant]
    return make_lubricant(settings if joint.heat is None else _supplied(settings, joint.heat))


def _supplied(settings: OilSettings, heat: schema.HeatSettings) -> OilSettings:
    return attrs.evolve(settings, temperature=heat.supply_temperature)


def joint_heat(joint: schema.LubricatedSettings) -> Heat | None:
    """Balance of a joint's heat, None where none is listed."""
    from fenics_ehd.film.heat import Heat

    return None if joint.heat is None else Heat(**attrs.asdict(joint.heat))


def check_lubricants(scene: Scene) -> None:
    """Refuse oils that cannot be made; one that is always balanced needs no temperature.

    Raises
    ------
    SettingsError
        Naming the oil.
    """
    from fenics_ehd.film.oil_settings import make_lubricant

    joints = [joint for _, joint in scene.joints_of(schema.LubricatedSettings)]
    for name, settings in scene.lubricants.items():
        heats = [joint.heat for joint in joints if joint.lubricant == name]
        balanced = bool(heats) and settings.graded and None not in heats
        try:
            make_lubricant(_supplied(settings, heats[0]) if balanced else settings)
        except SettingsError as error:
            raise SettingsError(f"lubricants.{name}: {error}") from None


def check_heat(scene: Scene, name: str) -> None:
    """Refuse a balance without a cycle, or of an oil that is the same at every temperature.

    Raises
    ------
    SettingsError
        Naming the key to change.
    """
    joint, key = scene.joints[name], f"joints.{name}.heat"
    if joint.heat is None:
        return
    if not scene.time.periodic:
        raise SettingsError(
            f"{key}: heat is balanced over a cycle, and with time.periodic = false there is none: "
            f"set it, or drop [{key}], the oil then at its lubricant's temperature"
        )
    if joint.lubricant == NONE or not scene.lubricants[joint.lubricant].graded:
        oil = f"lubricants.{joint.lubricant}" if joint.lubricant != NONE else f"joints.{name}"
        raise SettingsError(
            f"{key}: the viscosity of {oil} does not depend on its temperature: name a lubricant "
            "with a grade, or viscosity_40 and viscosity_100"
        )
    try:
        joint_heat(joint)
        joint_lubricant(scene, joint)
    except SettingsError as error:
        raise SettingsError(f"{key}: {error}") from None
