"""Films of a scene's lubricated joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.quantities import SMALLEST_RATIO, too_narrow
from fenics_ehd.film import Film, FilmGrid, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.film.feed import Feed
from fenics_ehd.film.feed_region import FeedHole
from fenics_ehd.film.grid import aligned_grid
from fenics_ehd.film.layout import film_grid
from fenics_ehd.film.shape import Shape
from fenics_ehd.film.supply import AxialGroove, Sides
from fenics_ehd.multibody.lubricated_joint import ConservedContent, LubricatedJoint
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.reduction.bore import BoreSurface
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.contact import rough_surfaces
from fenics_ehd.scenes.fields import FEWEST_CELLS
from fenics_ehd.scenes.heat import joint_heat, joint_lubricant
from fenics_ehd.scenes.scene import Scene, meshed
from fenics_ehd.scenes.shapes import ROUND, joint_shapes
from fenics_ehd.scenes.supplies import check_supply, feeds, holes_of, recesses

#: Film cells around and along a bore that offers none.
DEFAULT_CELLS = (20, 5)

#: Largest difference of journal and bore, share of the bore's radius: the film has one radius.
FIT = 0.01

#: Largest clearance over bore radius; the film's equations neglect terms of that order.
THIN_FILM = 0.05


def reference_rate(scene: Scene) -> float:
    """Largest angular speed of a scene as written [rad/s]; results do not depend on it."""
    speeds = [2 * np.pi / scene.span]
    for table in (scene.bodies, scene.drives, scene.forces):
        speeds += [abs(getattr(settings, "speed", 0.0)) for settings in table.values()]
    return float(max(speeds))


def check_fit(scene: Scene, name: str, bore: BoreSurface | None = None) -> None:
    """Refuse a film that is not thin, and a journal that does not fit its bore.

    Parameters
    ----------
    scene, name
        Which joint.
    bore
        Of a flexible body; None: it is rigid.

    Raises
    ------
    SettingsError
        Naming both sizes.
    """
    joint, key = scene.joints[name], f"joints.{name}"
    own = None if bore is None else (bore.radius, bore.width)
    radius, width = own or (joint.radius, joint.width)
    if own is not None:
        for size, value in zip(("radius", "width"), own, strict=True):
            given = getattr(joint, size)
            if given and not abs(given - value) <= FIT * value:
                raise SettingsError(
                    f"{key}.{size} = {given:g} m must be that of the bore {joint.bore}, "
                    f"{value:g} m, within {100 * FIT:g} %: drop it or change the part, "
                    f"bodies.{joint.bore.partition('.')[0]}.geometry"
                )
    check_thin_film(joint.clearance, radius, f"{key}.clearance")
    joint_shapes(joint, name, width)
    if own is not None and joint.grooves and not joint.cells:
        raise SettingsError(f"{key}.cells: grooves need film cells of their own, [40, 10] say")
    grid = uniform_grid(radius, width, joint.cells or DEFAULT_CELLS, joint.element)
    if joint.grooves:
        try:
            grid = _film(scene, joint, grid, 1.0).parameters.grid
        except SettingsError as error:
            raise SettingsError(f"{key}.grooves: {error}") from None
    holes = holes_of(bore)
    if joint.supply or holes:
        if own is not None and not joint.cells:
            raise SettingsError(
                f"{key}.cells: a supply or a hole of the bore needs film cells "
                "of its own, [40, 10] say"
            )
        check_supply(scene, name, grid, holes)
    body = joint.journal.partition(".")[0]
    shaft = scene.bodies.get(body)
    if (
        isinstance(shaft, schema.ShaftSettings)
        and not abs(0.5 * shaft.diameter - radius) <= FIT * radius
    ):
        raise SettingsError(
            f"bodies.{body}.diameter = {shaft.diameter:g} m must be that of the bore "
            f"{joint.bore}, {2 * radius:g} m, within {100 * FIT:g} %"
        )


def check_thin_film(clearance: float, radius: float, key: str) -> None:
    """Refuse a clearance that is no small part of the bore's radius [m], or hardly any.

    Raises
    ------
    SettingsError
        Naming both.
    """
    both = f"{key} = {clearance:g} m must be {{}} of the bore radius {radius:g} m"
    if not clearance < THIN_FILM * radius:
        raise SettingsError(f"{both.format(f'below {THIN_FILM:g}')}: the film is taken as thin")
    if too_narrow(clearance, radius):
        raise SettingsError(f"{both.format(f'at least {SMALLEST_RATIO:g}')}: lengths are in metres")


def planned_cells(scene: Scene, joint: str) -> tuple[int, int]:
    """Cells around and along that a film will have, as far as its settings tell."""
    settings = scene.joints[joint]
    if settings.cells:
        around, along = settings.cells
        return around, along
    elastic = scene.elastic_bore(settings)
    if elastic is None or elastic[0] not in meshed(scene):
        return DEFAULT_CELLS
    part = scene.bodies[elastic[0]]
    if part.cells != "hex":
        return DEFAULT_CELLS
    names = ("bore_cells_around", "bore_cells_along")
    around, along = (
        int(part.geometry.get(name, cells))
        for name, cells in zip(names, DEFAULT_CELLS, strict=True)
    )
    return around, along


def build_film(scene: Scene, name: str, body: ReducedBody | None, rate: float) -> Film:
    """Film of a joint.

    Parameters
    ----------
    scene, name
        Which joint.
    body
        The part whose bore it is; None: the bore is rigid.
    rate
        See `FilmParameters`.

    Raises
    ------
    InterfaceMismatchError
        The cells of a flexible bore are wanted and are not a structured quadratic mesh.
    """
    joint = scene.joints[name]
    holes = holes_of(body.bore if body else None)
    fed = feeds(scene, name, holes)
    return _film(scene, joint, film_mesh(joint, body), rate, fed, recesses(fed, holes))


def film_mesh(joint: schema.LubricatedSettings, body: ReducedBody | None) -> FilmGrid:
    """The cells that a joint asks for, or those of its flexible bore.

    Raises
    ------
    InterfaceMismatchError
        See `build_film`.
    """
    if body is None or joint.cells or body.bore.pressure_family == "triangle":
        size = (body.bore.radius, body.bore.width) if body else (joint.radius, joint.width)
        around, along = joint.cells or DEFAULT_CELLS
        return uniform_grid(*size, (around, along), joint.element)
    grid = film_grid(body.pressure_nodes)
    return replace(grid, family="bilinear") if joint.element == "bilinear" else grid


def _film(
    scene: Scene,
    joint: schema.LubricatedSettings,
    grid: FilmGrid,
    rate: float,
    fed: tuple[Feed, ...] = (),
    closed: tuple[FeedHole, ...] = (),
) -> Film:
    """Film on a mesh."""
    grooves = tuple(
        AxialGroove(np.radians(angle), np.radians(width), pressure)
        for angle, width, pressure in joint.grooves
    )
    edges = np.array([edge for groove in grooves for edge in groove.edges])
    return Film(
        FilmParameters(
            aligned_grid(grid, edges),
            joint.clearance,
            joint_lubricant(scene, joint),
            rate,
            Sides(joint.ambient_pressure, joint.ambient_pressure),
            grooves,
            fed,
            closed,
            rough_surfaces(scene, joint),
        )
    )


def stand_in_film(joint: schema.LubricatedSettings) -> Film:
    """A film of the joint's clearance that only assembly looks at."""
    radius = 1e3 * joint.clearance
    grid = uniform_grid(radius, radius, FEWEST_CELLS, "bilinear")
    return Film(FilmParameters(grid, joint.clearance, Lubricant(0.01), 1.0))


def lubricated(
    joint: schema.LubricatedSettings, film: Film, shapes: tuple[Shape | None, Shape | None] = ROUND
) -> LubricatedJoint:
    """The joint with its film, and the shapes of bore and journal."""
    x, y = joint.eccentricity
    return LubricatedJoint(
        joint.journal,
        joint.bore,
        film,
        transfer=joint.transfer,
        friction=joint.friction,
        eccentricity=(joint.clearance * x, joint.clearance * y),
        eccentricity_rate=joint.eccentricity_rate,
        smallest_film=joint.smallest_film,
        bore_shape=shapes[0],
        journal_shape=shapes[1],
        shear_rule=joint.shear_rule,
        heat=joint_heat(joint),
        oil=ConservedContent(joint.initial_filling, joint.ambient == "oil")
        if joint.cavitation == "mass-conserving"
        else None,
    )
