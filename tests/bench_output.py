"""What tests take of results, pictures, studies and the command line below the public names."""

# ruff: noqa: F401

from fenics_ehd.cli import check
from fenics_ehd.cli.bearing import report as report_bearing
from fenics_ehd.cli.bearing import summary
from fenics_ehd.cli.main import cli, main
from fenics_ehd.cli.options import answer
from fenics_ehd.cli.reduction import reduce_part
from fenics_ehd.cli.run import accuracy_lines, beside, budget_table, joint_lines
from fenics_ehd.cli.run import report as report_run
from fenics_ehd.cli.stress import instants_of
from fenics_ehd.plotting import maps, shown
from fenics_ehd.plotting.animated_bodies import (
    body_view,
    carried_fields,
    front_faces,
    outline,
    shape_of_bores,
    shape_of_part,
)
from fenics_ehd.plotting.animation import Bearing, draw, draw_pin, draw_slider, save_animation
from fenics_ehd.plotting.maps import round_scale
from fenics_ehd.plotting.picture import plt
from fenics_ehd.plotting.pictures import OF_EVERY_RUN, QUANTITIES, Pictures, plot_run
from fenics_ehd.plotting.shown import ShownJoint, ShownRun, recorded
from fenics_ehd.results import recorded_run
from fenics_ehd.results.motion import RecordedMotion, between_steps, nearest_steps
from fenics_ehd.results.paraview import (
    gather_part,
    part_block,
    part_of_basis,
    write_run,
    write_series,
)
from fenics_ehd.results.recorded_run import (
    MADE,
    CsvFile,
    RunFolder,
    continue_from,
    load_run_state,
    recorded_steps,
    save_run_state,
)
from fenics_ehd.results.stress import cycle_stress, write_fields
from fenics_ehd.results.stress import figures as figures_stress
from fenics_ehd.study.cases import (
    MOST_CASES,
    Case,
    make_case,
    parse_values,
    resolve_key,
    with_values,
)
from fenics_ehd.study.compare import (
    COLUMNS,
    ERROR_COLUMNS,
    StoredRun,
    StudyFolder,
    errors_path,
    read_errors,
    run_study,
)
from fenics_ehd.study.plan import FILM as FILM_PLAN
from fenics_ehd.study.plan import (
    REFERENCE,
    Scope,
    film,
    full,
    m1,
    m3,
    m4,
    make_study,
    rigid,
    steps,
    values_in,
)
from fenics_ehd.study.pool import (
    PROCESSOR_SECONDS,
    OtherFolderError,
    Outcome,
    ProcessPool,
    outcomes,
)
from fenics_ehd.study.report import figures as figures_report
from fenics_ehd.study.report.figures import best_bodies, first_shapes
from fenics_ehd.study.report.study_data import (
    CURVES,
    PRESSURE,
    TEXTS,
    StudyData,
    StudyRow,
    read_study,
)
from fenics_ehd.study.report.study_data import FILM as FILM_STUDY_DATA
from fenics_ehd.study.report.write import render, unknown_floors, write_report
from fenics_ehd.study.sensitivity import mechanism_number, number_of, scene_sensitivity
from fenics_ehd.study.sweep import FIGURES, JOINT_FIGURES, SweepFolder, make_sweep, run_sweep
