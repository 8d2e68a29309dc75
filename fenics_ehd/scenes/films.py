"""Films of a scene's lubricated joints: meshes, supplies, shapes and roughness of surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import radians

import attrs
import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import require_thin_film
from fenics_ehd.base.shared_settings import Deviations
from fenics_ehd.film.film import Film
from fenics_ehd.film.grid import FilmGrid, MeshMaker, aligned_grid, film_grid, uniform_grid
from fenics_ehd.film.kinematics import Shape, ShapeTable, is_shape
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
from fenics_ehd.reduction.bore import BoreHole, BoreSurface, bore_holes
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.inputs import SURFACES, Inputs
from fenics_ehd.scenes.scene import Scene, joint_lubricant, meshed
from fenics_ehd.scenes.schema import NONE
from fenics_ehd.scenes.shape_tables import require_covering

#: Young's modulus [Pa] and Poisson's ratio of steel, for a bore without a material in the scene.
STEEL = (210e9, 0.3)


def rough_surfaces(scene: Scene, joint: schema.LubricatedSettings) -> RoughSurfaces | None:
    """Rough surfaces of a joint; None if they are smooth."""
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
    modulus = 1.0 / sum((1 - ratio**2) / youngs for youngs, ratio in (journal, bore))
    return RoughSurfaces.of(contact, modulus)


def _bore_material(scene: Scene, joint: schema.LubricatedSettings) -> tuple[float, float]:
    """Young's modulus [Pa] and Poisson's ratio of a bore; the values of steel by default."""
    body = scene.bodies.get(joint.bore.partition(".")[0])
    if isinstance(body, schema.FlexibleSettings) and body.model != NONE:
        return body.material.youngs_modulus, body.material.poissons_ratio
    return STEEL


def surface_shape(
    settings: Deviations,
    path: str,
    width: float,
    clearance: float,
    measured: ShapeTable | None = None,
) -> Shape | None:
    """Shape of a surface with deviations; None for a circular cylinder.

    Parameters
    ----------
    settings
        Deviations of the surface; a `Shape` made in Python is returned unchanged.
    path
        Section of the settings followed by a dot, for messages.
    width, clearance
        Width and radial clearance of the bearing [m].
    measured
        Measured shape from the table of the settings; None without a table.

    Raises
    ------
    SettingsError
        The shape closes the gap for any position of the journal, or its table does not cover the
        bearing; the message names the key.
    """
    if is_shape(settings):
        return settings
    # Two lobes or more close the gap at every position of the journal.
    if settings.lobes > 1 and abs(settings.ovality) >= clearance:
        raise SettingsError(
            f"{path}ovality = {settings.ovality:g} m closes the gap: its magnitude must be below "
            f"the clearance of {clearance:g} m"
        )
    if measured is not None:
        require_covering(measured, f"{path}table {settings.table}", width, clearance)
    elif not any((settings.ovality, settings.barrel, settings.taper, *settings.misalignment)):
        return None
    return Shape(**attrs.asdict(settings), half_width=0.5 * width, measured=measured)


def recesses(supplies: Sequence[Supply], holes: Sequence[BoreHole]) -> tuple[HoleSupply, ...]:
    """Closed recesses of a film: the holes in the mesh of its bore at which there is no supply."""
    in_bore = [s for s in supplies if isinstance(s, HoleSupply) and not s.on_journal]
    return tuple(
        _in_mesh(HoleSupply(), hole)
        for hole in holes
        if not any(hole.contains(np.array([s.middle]), np.array([s.height]))[0] for s in in_bore)
    )


def _in_mesh(supply: HoleSupply, hole: BoreHole) -> HoleSupply:
    """Copy of a supply that has the angle, height and diameter of a hole in the bore's mesh."""
    return attrs.evolve(
        supply,
        angle=float(np.degrees(hole.angle)),
        height=hole.height,
        diameter=hole.diameter,
    )


def _in_hole(supply: Supply, key: str, holes: Sequence[BoreHole]) -> Supply:
    """Give a hole supply without a diameter the geometry of the nearest hole in the bore's mesh.

    Raises
    ------
    SettingsError
        The supply has no diameter, and the mesh has no hole.
    """
    if not isinstance(supply, HoleSupply) or supply.diameter:
        return supply
    if not holes or supply.on_journal:
        raise SettingsError(
            f"{key}.diameter is missing [m], and this {supply.on} has no hole in a mesh whose "
            "diameter could be used: give a diameter"
        )

    def distance(hole: BoreHole) -> float:
        turn = np.mod(hole.angle - supply.middle + np.pi, 2 * np.pi) - np.pi
        return float(np.hypot(hole.radius * turn, hole.height - supply.height))

    return _in_mesh(supply, min(holes, key=distance))


#: Largest flow through the passage of a supply, over the flow ``c R w B / 2`` that a rotating
#: surface drags, below which the supply counts as shut: it cannot change the film by 0.1 %.
SHUT = 1e-3


def shut_supplies(name: str, film: Film) -> list[str]:
    """Notice, at most one line, of holes and supplies of a joint through which no oil enters.

    They are holes in the mesh of the bore without a supply, supplies of pressure 0, and supplies
    whose passage has a very large resistance.

    Parameters
    ----------
    name
        Name of the joint.
    film
        Film of the joint.
    """
    parameters = film.parameters
    shut = [
        f"the hole in the mesh of the bore at {hole.angle:.4g} degrees, z = "
        f"{1e3 * hole.height:.4g} mm has no supply and is closed"
        for hole in parameters.recesses
    ]
    grid = parameters.grid
    dragged = 0.5 * parameters.clearance * grid.radius * parameters.rate * grid.width
    for supply in parameters.feeds:
        if not (supply.pressure or supply.curve or supply.head):
            shut.append(f"supply.{supply.name}.pressure is 0, the cavitation pressure")
        elif supply.resistance * SHUT * dragged > supply.pressure_at(0.0) > 0.0:
            shut.append(
                f"supply.{supply.name}.resistance = {supply.resistance:g} Pa s/m3 lets at most "
                f"{1e6 * supply.pressure_at(0.0) / supply.resistance:.2g} cm3/s through, below "
                f"{SHUT:g} of the {1e6 * dragged:.2g} cm3/s that the journal drags"
            )
    if not shut:
        return []
    return [
        f"joints.{name}: no oil enters through {len(shut)} of its openings: {'; '.join(shut)}: "
        f"give [joints.{name}.supply.NAME] with kind, angle, height and pressure"
    ]


#: Numbers of film cells around and along for a bore without a mesh.
DEFAULT_CELLS = (20, 5)

#: Largest relative difference between sizes of bore, journal and joint that count as equal.
FIT = 0.01


def reference_rate(scene: Scene) -> float:
    """Largest angular speed in a scene [rad/s], by which equations are scaled.

    The scale changes only the round-off of results.
    """
    speeds = [2 * np.pi / scene.span]
    for table in (scene.bodies, scene.drives, scene.forces):
        speeds += [abs(getattr(settings, "speed", 0.0)) for settings in table.values()]
    return float(max(speeds))


def check_fit(scene: Scene, name: str, bore: BoreSurface | None) -> None:
    """Refuse a film that is not thin, or whose size or journal does not fit the bore.

    Parameters
    ----------
    scene, name
        The scene, and the name of the joint.
    bore
        Bore of a flexible body; None for a rigid bore.

    Raises
    ------
    SettingsError
        Two sizes do not fit each other; the message has both.
    """
    joint = scene.joints[name]
    key = f"joints.{name}"
    radius = joint.radius
    if bore is not None:
        radius = bore.radius
        for size in ("radius", "width"):
            written = getattr(joint, size)
            value = getattr(bore, size)
            if written and not abs(written - value) <= FIT * value:
                raise SettingsError(
                    f"{key}.{size} = {written:g} m must be that of the bore {joint.bore}, "
                    f"{value:g} m, within {100 * FIT:g} %: drop the key or change the part's "
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
    """Numbers of film cells around and along, predicted from settings before parts are meshed."""
    settings = scene.joints[joint]
    if settings.cells:
        around, along = settings.cells
        return around, along
    elastic = scene.elastic_surfaces(settings)
    if not elastic or elastic[0].body not in meshed(scene):
        return DEFAULT_CELLS
    part = scene.bodies[elastic[0].body]
    if part.cells != "hex":
        return DEFAULT_CELLS
    names = ("bore_cells_around", "bore_cells_along")
    around, along = (
        int(part.geometry.get(name, cells))
        for name, cells in zip(names, DEFAULT_CELLS, strict=True)
    )
    return around, along


def build_film(
    scene: Scene,
    name: str,
    bore: BoreSurface | None,
    rate: float,
    supplies: Sequence[Supply],
    mesh: MeshMaker | None = None,
) -> Film:
    """Make the film of a joint.

    Parameters
    ----------
    scene, name
        The scene, and the name of the joint.
    bore
        Bore of a flexible body; None for a rigid bore.
    rate
        Reference angular speed [rad/s], see `FilmParameters`.
    supplies
        Supplies of the joint, see `supplies_of`.
    mesh
        Function that makes the film's mesh from the angles of groove edges; by default the mesh
        is that of `film_mesh`.

    Raises
    ------
    SettingsError
        The mesh of the film is too coarse for a groove, supply or hole.
    InterfaceMismatchError
        The film needs the cells of a flexible bore, whose mesh is not structured and quadratic.
    """
    joint = scene.joints[name]
    key = f"joints.{name}"
    mesh = mesh or partial(_aligned_mesh, joint, bore)
    holes: list[BoreHole] = []
    if bore is not None and bore.cells.size:
        holes = bore_holes(bore.coordinates, bore.cells, bore.family)
    if bore is not None and not joint.cells and (joint.grooves or joint.supply or holes):
        raise SettingsError(
            f"{key}.cells is missing: grooves, supplies and holes of the bore need film cells of "
            "their own, for instance [40, 10]"
        )
    try:
        grooves = tuple(
            AxialGroove(radians(angle), radians(width), pressure)
            for angle, width, pressure in joint.grooves
        )
        edges = np.array([edge for groove in grooves for edge in groove.edges])
        grid = mesh(edges)
    except SettingsError as error:
        raise SettingsError(f"{key}.grooves: {error}") from None
    feeds = tuple(_in_hole(supply, f"{key}.supply.{supply.name}", holes) for supply in supplies)
    closed = recesses(feeds, holes)
    for supply in feeds:
        check_supply(f"{key}.supply.{supply.name}", supply, grid)
    for hole in closed:
        position = f"at {hole.angle:.4g} degrees, z = {1e3 * hole.height:.4g} mm"
        check_supply(f"{key}: the hole in the mesh of the bore {position},", hole, grid)
    return Film(
        FilmParameters(
            grid,
            joint.clearance,
            joint_lubricant(scene, joint),
            rate,
            Sides(joint.ambient_pressure, joint.ambient_pressure),
            grooves,
            feeds,
            closed,
            rough_surfaces(scene, joint),
        )
    )


def _aligned_mesh(
    joint: schema.LubricatedSettings, bore: BoreSurface | None, edges: np.ndarray
) -> FilmGrid:
    """Film mesh of a joint, see `film_mesh`, with cell boundaries at the angles `edges` [rad]."""
    return aligned_grid(film_mesh(joint, bore), edges)


def film_mesh(joint: schema.LubricatedSettings, bore: BoreSurface | None) -> FilmGrid:
    """Film mesh of a joint, with the cells in its settings or the cells of its flexible bore.

    Raises
    ------
    InterfaceMismatchError
        The mesh of the bore cannot be used, see `build_film`.
    """
    if bore is None or joint.cells or bore.pressure_family == "triangle":
        size = bore or joint
        around, along = joint.cells or DEFAULT_CELLS
        return uniform_grid(size.radius, size.width, (around, along), joint.element)
    grid = film_grid(bore.pressure_coordinates)
    return replace(grid, family="bilinear") if joint.element == "bilinear" else grid


def lubricated_joint(
    scene: Scene,
    name: str,
    bore: BoreSurface | None,
    rate: float,
    inputs: Inputs,
    mesh: MeshMaker | None = None,
) -> LubricatedJoint:
    """Make a lubricated joint: its film, and the shapes of bore and journal.

    Parameters
    ----------
    scene, name, bore, rate, mesh
        See `build_film`.
    inputs
        Supplies and measured shapes of the scene.

    Raises
    ------
    SettingsError
        The journal does not fit its bore, the film is not thin, or `build_film` refuses the film.
    """
    check_fit(scene, name, bore)
    joint = scene.joints[name]
    film = build_film(scene, name, bore, rate, inputs.supplies[name], mesh)
    width = film.parameters.grid.width
    shapes = {}
    for surface in SURFACES:
        path = f"joints.{name}.{surface}."
        measured = inputs.shapes.get(f"{path}table")
        settings = getattr(joint, surface)
        shapes[surface] = surface_shape(settings, path, width, joint.clearance, measured)
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
