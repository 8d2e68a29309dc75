"""Films of a scene's joints: rough surfaces, shapes, supplies.

The deviations of a bore or journal from the round one are given by its settings, or measured, in a
CSV file:

    # anything
    angle_deg,height_m,deviation_m
    0,-0.01,1.2e-6
    0,0.01,1.0e-6
    15,-0.01,...

Every angle with every height, in any order; angles within one turn, perhaps a last one that is the
first again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import radians
from pathlib import Path

import attrs
import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import require_thin_film
from fenics_ehd.base.shared_settings import Deviations
from fenics_ehd.film.film import Film
from fenics_ehd.film.grid import FilmGrid, aligned_grid, film_grid, uniform_grid
from fenics_ehd.film.kinematics import FEWEST_ANGLES, Shape, ShapeTable
from fenics_ehd.film.parameters import FilmParameters
from fenics_ehd.film.rough_surfaces import RoughSurfaces
from fenics_ehd.film.supply import (
    AxialGroove,
    HoleSupply,
    Sides,
    Supply,
    check_supply,
)
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.shaft import ShaftBody
from fenics_ehd.multibody.tabulated import Curve
from fenics_ehd.reduction.bore import BoreHole, BoreSurface, bore_holes
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.library import table_file
from fenics_ehd.scenes.scene import Scene, joint_lubricant, meshed
from fenics_ehd.scenes.schema import NONE
from fenics_ehd.scenes.tables import (
    Units,
    read_columns,
    read_time_table,
    require_closed,
)

#: Young's modulus of a bore whose material nothing tells [Pa]: steel.
STEEL = 210e9


def rough_surfaces(scene: Scene, joint: schema.LubricatedSettings) -> RoughSurfaces | None:
    """Surfaces of a joint, None for smooth ones."""
    contact = joint.contact
    if contact.asperity_radius:
        contact = attrs.evolve(
            contact,
            asperity_product=contact.asperity_density * contact.asperity_radius * contact.roughness,
            asperity_slenderness=contact.roughness / contact.asperity_radius,
        )
    journal = contact.journal_modulus, contact.journal_poissons_ratio
    bore = contact.bore_modulus, contact.bore_poissons_ratio
    if not contact.bore_modulus:
        bore = _bore_material(scene, joint)
    modulus = 1.0 / sum((1 - ratio**2) / own for own, ratio in (journal, bore))
    return RoughSurfaces.of(contact, modulus)


def _bore_material(scene: Scene, joint: schema.LubricatedSettings) -> tuple[float, float]:
    """Young's modulus [Pa] and Poisson's ratio of a bore: its part's, or steel's."""
    body = scene.bodies.get(joint.bore.partition(".")[0])
    if isinstance(body, schema.FlexibleSettings) and body.model != NONE:
        return body.material.youngs_modulus, body.material.poissons_ratio
    return STEEL, 0.3


#: Units of a table's columns.
_LENGTH: Mapping[str, float] = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
UNITS: Units = {"angle": {"deg": 1.0}, "height": _LENGTH, "deviation": _LENGTH}

#: Part of the bearing's width that heights of a table may leave out at each end: its own rounding.
UNCOVERED = 1e-3

#: Widths that heights of a table may span, and clearances that a deviation may have: in another
#: unit they are a thousand times as large.
WIDEST, HIGHEST = 10.0, 30.0

#: Digits of an angle [degrees], and of a height over the largest, in which rows of a table agree.
DIGITS = 6


def surface_shape(settings: Deviations, path: str, width: float, clearance: float) -> Shape | None:
    """Shape of one surface, None for a round one; `path` stands before its keys in messages."""
    # Two lobes or more close the gap somewhere, wherever the journal is.
    if settings.lobes > 1 and abs(settings.ovality) >= clearance:
        raise SettingsError(
            f"{path}ovality = {settings.ovality:g} m closes the gap: its size must be below "
            f"the clearance of {clearance:g} m"
        )
    measured = None
    if settings.table != NONE:
        measured = read_shape_table(settings.table, f"{path}table", width, clearance)
    elif not any((settings.ovality, settings.barrel, settings.taper, *settings.misalignment)):
        return None
    return Shape(**attrs.asdict(settings), half_width=0.5 * width, measured=measured)


def read_shape_table(path: str | Path, key: str, width: float, clearance: float) -> ShapeTable:
    """Shape of a CSV file.

    Parameters
    ----------
    path
        The file; lines that start with ``#`` are comments.
    key
        Setting that names it, for messages.
    width
        Of the bearing [m], which the heights must cover; one height stands for all.
    clearance
        Of the bearing [m].

    Raises
    ------
    SettingsError
        Naming setting, file and what is wrong.
    """
    where = f"{key} {path}"
    _, rows = read_columns(path, where, UNITS, FEWEST_ANGLES, ascending=False)
    degrees = rows[:, 0].round(DIGITS)
    first = float(rows[:, 0].min())
    largest = float(np.abs(rows[:, 1]).max()) or 1.0
    heights = (rows[:, 1] / largest).round(DIGITS)
    angles, i = np.unique(degrees, return_inverse=True)
    levels, k = np.unique(heights, return_inverse=True)
    values = np.full((len(angles), len(levels)), np.nan)
    values[i, k] = rows[:, 2]
    if len(rows) != values.size or np.isnan(values).any():
        raise SettingsError(
            f"{where}: {len(rows)} rows for {len(angles)} angles and {len(levels)} heights: every "
            "angle needs every height, once"
        )
    span = float(angles[-1] - angles[0])
    if abs(span - 360.0) < 10.0**-DIGITS:
        if not np.array_equal(values[-1], values[0]):
            raise SettingsError(f"{where}: deviations at {first + 360:g} and {first:g} deg differ")
        angles, values = angles[:-1], values[:-1]
    elif span > 360.0:
        raise SettingsError(f"{where}: the angles span {span:g} deg, at most 360 are a turn")
    levels = levels * largest
    reach = (0.5 - UNCOVERED) * width
    if len(levels) > 1 and not (levels[0] <= -reach and levels[-1] >= reach):
        raise SettingsError(
            f"{where}: heights from {levels[0]:g} to {levels[-1]:g} m must cover the bearing's "
            f"width, {-0.5 * width:g} to {0.5 * width:g} m; one height alone stands for all"
        )
    for name, size, limit in (
        ("height", 2 * float(np.abs(levels).max()), WIDEST * width),
        ("deviation", float(np.abs(values).max()), HIGHEST * clearance),
    ):
        if size > limit:
            raise SettingsError(
                f"{where}: {name}s of {size:g} m, more than {limit:g} m: name the column by its "
                f"unit, {name}_m, {name}_mm or {name}_um"
            )
    try:
        return ShapeTable(np.radians(angles), levels, values)
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from None


def supplies_of(scene: Scene, name: str) -> tuple[Supply, ...]:
    """Supplies of a lubricated joint with their names and tables.

    Raises
    ------
    SettingsError
        A pressure that is given twice, or a table that cannot be used.
    """
    found = []
    for own, supply in scene.joints[name].supply.items():
        key = f"joints.{name}.supply.{own}"
        curve = _pressure_curve(supply, key, periodic=scene.time.periodic)
        found.append(attrs.evolve(supply, name=own, curve=curve))
    return tuple(found)


def supply_tables(scene: Scene) -> dict[str, Curve]:
    """Pressures over the time of supplies that have a table, by key; errors as `supplies_of`."""
    return {
        f"joints.{name}.supply.{supply.name}": supply.curve
        for name in scene.films
        for supply in supplies_of(scene, name)
        if isinstance(supply.curve, Curve)
    }


def recesses(supplies: Sequence[Supply], holes: Sequence[BoreHole]) -> tuple[HoleSupply, ...]:
    """Holes in the mesh of a bore that no supply is at: they are closed."""
    at = [s for s in supplies if isinstance(s, HoleSupply) and not s.on_journal]
    return tuple(
        _in_mesh(HoleSupply(), hole)
        for hole in holes
        if not any(hole.contains(np.array([s.middle]), np.array([s.height]))[0] for s in at)
    )


def _in_mesh(supply: HoleSupply, hole: BoreHole) -> HoleSupply:
    """A supply with place and size of a hole in the mesh."""
    return attrs.evolve(
        supply,
        angle=float(np.degrees(hole.angle)),
        height=hole.height,
        diameter=hole.diameter,
    )


def _placed(supply: Supply, key: str, holes: Sequence[BoreHole]) -> Supply:
    """A supply; one without a size at the hole in the mesh nearest to its angle and height.

    Raises
    ------
    SettingsError
        The mesh should have a hole and has none.
    """
    if not isinstance(supply, HoleSupply) or supply.diameter:
        return supply
    if not holes or supply.on_journal:
        raise SettingsError(
            f"{key}.diameter is missing [m]: only a flexible bore may have a hole in its mesh, and "
            f"this {supply.on} has none"
        )

    def distance(hole: BoreHole) -> float:
        turn = np.mod(hole.angle - supply.middle + np.pi, 2 * np.pi) - np.pi
        return float(np.hypot(hole.radius * turn, hole.height - supply.height))

    return _in_mesh(supply, min(holes, key=distance))


def _pressure_curve(supply: Supply, key: str, *, periodic: bool) -> Curve | None:
    """Pressure over the time where there is a table, over and over where the scene is periodic."""
    if supply.table == NONE:
        return None
    if supply.pressure:
        raise SettingsError(f"{key}: give a pressure or a table, one of them")
    path = table_file(supply.table, f"{key}.table")
    curve = read_time_table(path, f"{key}.table", {"pressure": {"Pa": 1.0, "bar": 1e5}})
    values = np.array([curve(row)[0] for row in curve.curve.x])
    if values.min() < 0.0:
        raise SettingsError(
            f"{key}.table {path}: a pressure of {values.min():g} Pa, it must be at least 0, that "
            "at which the film cavitates"
        )
    if periodic:
        ends = values[[0, -1]][:, None]
        require_closed(f"{key}.table {path}", ends, "a periodic run needs a table that closes")
    return replace(curve, periodic=periodic)


#: Film cells around and along a bore that offers none.
DEFAULT_CELLS = (20, 5)

#: Largest difference of journal and bore, share of the bore's radius: the film has one radius.
FIT = 0.01


def reference_rate(scene: Scene) -> float:
    """Largest angular speed of a scene as written [rad/s]; results do not depend on it."""
    speeds = [2 * np.pi / scene.span]
    for table in (scene.bodies, scene.drives, scene.forces):
        speeds += [abs(getattr(settings, "speed", 0.0)) for settings in table.values()]
    return float(max(speeds))


def check_fit(scene: Scene, name: str, bore: BoreSurface | None) -> None:
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
    radius = joint.radius
    if bore is not None:
        radius = bore.radius
        for size in ("radius", "width"):
            given, value = getattr(joint, size), getattr(bore, size)
            if given and not abs(given - value) <= FIT * value:
                raise SettingsError(
                    f"{key}.{size} = {given:g} m must be that of the bore {joint.bore}, "
                    f"{value:g} m, within {100 * FIT:g} %: drop it or change the part, "
                    f"bodies.{joint.bore.partition('.')[0]}.geometry"
                )
    require_thin_film(joint.clearance, radius, f"{key}.clearance")
    body = joint.journal.partition(".")[0]
    shaft = scene.bodies.get(body)
    if isinstance(shaft, ShaftBody) and not abs(0.5 * shaft.diameter - radius) <= FIT * radius:
        raise SettingsError(
            f"bodies.{body}.diameter = {shaft.diameter:g} m must be that of the bore "
            f"{joint.bore}, {2 * radius:g} m, within {100 * FIT:g} %"
        )


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


def build_film(scene: Scene, name: str, bore: BoreSurface | None, rate: float) -> Film:
    """Film of a joint.

    Parameters
    ----------
    scene, name
        Which joint.
    bore
        Of a flexible body; None: it is rigid.
    rate
        See `FilmParameters`.

    Raises
    ------
    SettingsError
        Grooves, supplies or holes in the mesh that the film cannot hold.
    InterfaceMismatchError
        The cells of a flexible bore are wanted and are not a structured quadratic mesh.
    """
    joint = scene.joints[name]
    key = f"joints.{name}"
    holes: list[BoreHole] = []
    if bore is not None and bore.cells.size:
        holes = bore_holes(bore.coordinates, bore.cells, bore.family)
    if bore is not None and not joint.cells and (joint.grooves or joint.supply or holes):
        raise SettingsError(
            f"{key}.cells: grooves, supplies and holes of the bore need film cells of their own, "
            "[40, 10] say"
        )
    try:
        grooves = tuple(
            AxialGroove(radians(angle), radians(width), pressure)
            for angle, width, pressure in joint.grooves
        )
        edges = np.array([edge for groove in grooves for edge in groove.edges])
        grid = aligned_grid(film_mesh(joint, bore), edges)
    except SettingsError as error:
        raise SettingsError(f"{key}.grooves: {error}") from None
    supplies = tuple(
        _placed(supply, f"{key}.supply.{supply.name}", holes) for supply in supplies_of(scene, name)
    )
    closed = recesses(supplies, holes)
    for supply in supplies:
        check_supply(f"{key}.supply.{supply.name}", supply, grid)
    for hole in closed:
        told = f"at {hole.angle:.4g} degrees, z = {1e3 * hole.height:.4g} mm"
        check_supply(f"{key}: the hole in the mesh of the bore {told},", hole, grid)
    return Film(
        FilmParameters(
            grid,
            joint.clearance,
            joint_lubricant(scene, joint),
            rate,
            Sides(joint.ambient_pressure, joint.ambient_pressure),
            grooves,
            supplies,
            closed,
            rough_surfaces(scene, joint),
        )
    )


def film_mesh(joint: schema.LubricatedSettings, bore: BoreSurface | None) -> FilmGrid:
    """The cells that a joint asks for, or those of its flexible bore.

    Raises
    ------
    InterfaceMismatchError
        See `build_film`.
    """
    if bore is None or joint.cells or bore.pressure_family == "triangle":
        size = bore or joint
        around, along = joint.cells or DEFAULT_CELLS
        return uniform_grid(size.radius, size.width, (around, along), joint.element)
    grid = film_grid(bore.pressure_coordinates)
    return replace(grid, family="bilinear") if joint.element == "bilinear" else grid


def lubricated_joint(
    scene: Scene, name: str, bore: BoreSurface | None, rate: float
) -> LubricatedJoint:
    """A joint with its film, and the shapes of bore and journal; arguments as of `build_film`.

    Raises
    ------
    SettingsError
        A journal that does not fit its bore, a film that is not thin, or see `build_film`.
    """
    check_fit(scene, name, bore)
    joint, film = scene.joints[name], build_film(scene, name, bore, rate)
    width, key = film.parameters.grid.width, f"joints.{name}"
    shapes = {
        surface: surface_shape(getattr(joint, surface), f"{key}.{surface}.", width, joint.clearance)
        for surface in ("bore_shape", "journal_shape")
    }
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
        shear_rule=joint.shear_rule,
        heat=joint.heat,
        cavitation=joint.cavitation,
        initial_filling=joint.initial_filling,
        ambient=joint.ambient,
        **shapes,
    )
