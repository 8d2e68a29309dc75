"""What tests take of settings, files and scenes below the public names."""

# ruff: noqa: F401

from fenics_ehd.base import compat, fields, files, sealed_file
from fenics_ehd.base.columns import Quantity, split_unit, with_unit
from fenics_ehd.base.fields import (
    NO_TEMPERATURE,
    SHEAR_RULES,
    OilSettings,
    in_unit,
    require_thin_film,
)
from fenics_ehd.base.files import (
    HEADER,
    claim,
    clear,
    complete_result,
    keeping_failed_film,
    listed,
    to_json,
    versions,
)
from fenics_ehd.base.plane import rotation
from fenics_ehd.base.processes import printing_kept
from fenics_ehd.base.sealed_file import digest, open_sealed, save_tree, seal
from fenics_ehd.base.settings import read_toml
from fenics_ehd.scenes import films, part, part_settings, schema
from fenics_ehd.scenes.accuracy import account, begun, choosable, search_of, water_level
from fenics_ehd.scenes.films import (
    build_film,
    film_mesh,
    planned_cells,
    read_shape_table,
    rough_surfaces,
)
from fenics_ehd.scenes.library import shipped, shipped_names, table_file
from fenics_ehd.scenes.part import (
    elastic_part,
    reduce_structure,
    reduction_provenance,
    structure_provenance,
    with_body,
    with_counts,
    with_method,
)
from fenics_ehd.scenes.part_settings import ReductionSettings
from fenics_ehd.scenes.run import run_scene
from fenics_ehd.scenes.scene import as_stored, changed, scene_of, scene_text, stored
from fenics_ehd.scenes.schema import LubricatedSettings
from fenics_ehd.scenes.tables import angle_table, load_curves, read_angle_table, read_time_table
