"""Contact in the coupled step: derivatives, agreement of methods, energy, convergence."""

from dataclasses import replace

import numpy as np
import pytest
from csv_history import only_joint
from film_cases import oval
from hand_made_rod import CLEARANCE
from mechanism_cases import REVOLUTION, film, flexible_slider_crank, rigid_rod, slider_crank
from rough_cases import surfaces
from test_coupled_steps import assert_derivatives, mechanism_with

import fenics_ehd as ehd
from fenics_ehd.multibody import step_equations
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.step_equations import FilmFriction
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.scenes.films import rough_surfaces
from fenics_ehd.scenes.scene import scene_text


def with_surfaces(mechanism, rough, **changes):
    """The same with rough surfaces in its lubricated joint, and other changes of that."""
    ((name, joint),) = ((n, j) for n, j in mechanism.joints.items() if hasattr(j, "film"))
    film = ehd.Film(replace(joint.film.parameters, surfaces=rough))
    joint = replace(joint, film=film, **changes)
    return replace(mechanism, joints={**mechanism.joints, name: joint})


@pytest.mark.kernels
@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize(("share", "shape"), [(0.5, None), (0.9, None), (0.5, oval(3e-6, 0.3))])
def test_derivatives_equal_central_differences(residual, share, shape):
    # So rough and stiff that contact is everywhere, and as strong as the film.
    # Tips that stand out reach further than they would.
    rough = surfaces(CLEARANCE / 2, share, modulus=1e13, offset=4 * share - 2)
    mechanism = with_surfaces(mechanism_with("lagrange", residual), rough, journal_shape=shape)
    point = assert_derivatives(mechanism, 1e-6)
    assert point.films[0].contact.pressure.max() > 1e6


@pytest.mark.kernels
@pytest.mark.parametrize("residual", [False, True])
def test_derivatives_of_boundary_friction_are_exact(residual, monkeypatch):
    # The oil's own shear, whose derivative is left out, must not act.
    rough = surfaces(CLEARANCE / 3, modulus=1e13, friction=0.3)
    mechanism = with_surfaces(mechanism_with("lagrange", residual), rough, friction=True)
    (place,) = System(mechanism).films
    none = FilmFriction(np.zeros(place.film.size), 0.0, 0.0, np.zeros(1))
    monkeypatch.setattr(step_equations, "film_friction", lambda *_: none)
    assert_derivatives(mechanism, 1e-6)


def machine(rough, cells=(16, 3), viscosity=2e-4, **changes):
    """The paper's machine with a rigid rod, its oil so thin that smooth surfaces would touch."""
    oil = film(22.5e-3, 22e-3, 17e-6, viscosity, cells)
    mechanism = slider_crank(rigid_rod(), oil)
    return with_surfaces(mechanism, rough, **changes)


END = 1.7e-3


@pytest.fixture(scope="module")
def run():
    return ehd.simulate(machine(surfaces(), friction=True), END, tolerance=2e-5)


def test_a_run_that_ends_with_smooth_surfaces_goes_on_with_rough_ones(run):
    with pytest.raises(ehd.errors.FilmTooThinError):
        ehd.simulate(machine(None), END, tolerance=1e-4)
    columns = run.columns
    assert run.time[-1] == pytest.approx(END)
    assert columns["contact_share"].max() > 0.3
    assert columns["max_contact_pressure_Pa"].max() > 2e7
    assert columns["unpublished_share"].max() > 0
    assert columns["contact_power_W"].max() > 1e3


def test_newtons_method_converges_fast(run):
    assert run.summary()["newton_iterations"] < 3.0 * len(run.time)


def test_energy_of_contact_is_balanced(run, figure):
    columns = run.columns
    defect = np.abs(columns["energy_defect_J"]).max() / columns["film_work_J"][-1]
    figure("contact", "energy balance over what is dissipated, tolerance 2e-5", defect, most=1e-3)


def test_wear_is_where_the_surfaces_rub():
    equations = Run(machine(surfaces()), IntegratorOptions(tolerance=1e-4), END)
    tracker = Recorder(equations, END)
    rows = [tracker.add(step) for step in equations.until(END)]
    figures = only_joint(RunSummary(tracker).entries())
    largest = max(row["big_end.max_contact_pressure_Pa"] for row in rows)
    assert figures["max_contact_pressure_Pa"] == largest
    distance = 500.0 * 22.5e-3 * 1.5 * END  # at most: the rod turns against the crank
    assert 0 < figures["contact_sliding_Pa_m"] < largest * distance
    # Recorded values continue without a jump.
    other = Recorder(equations, END)
    other.state, other.rows = tracker.state, tracker.rows
    np.testing.assert_equal(only_joint(RunSummary(other).entries()), figures)


def test_surfaces_that_overlap_too_far_end_a_run_with_a_named_error():
    # Asperities a thousand times softer than steel's bear nothing.
    rough = surfaces(modulus=1e7, flow_factors=False)
    with pytest.raises(ehd.errors.ContactError, match=r"big_end overlap .*big_end\.contact"):
        ehd.simulate(machine(rough, (12, 2), viscosity=2e-5), END, tolerance=1e-3)


def test_smooth_surfaces_know_nothing_of_contact():
    mechanism = machine(None)
    found = Run(mechanism, IntegratorOptions(), 1e-4)
    assert not any(found.equations.contacts.joints)
    tracker = Recorder(found, 1e-4)
    row = tracker.add(next(found.until(1e-4)))
    figures = only_joint(RunSummary(tracker).entries())
    assert not [name for name in (*row, *figures) if "contact" in name]


@pytest.mark.slow
@pytest.mark.parametrize("flow_factors", [True, False])
def test_contact_converges_with_the_mesh(flow_factors, figure):
    rough, peaks = surfaces(1e-6, flow_factors=flow_factors), []
    for cells in ((24, 4), (48, 8), (96, 16)):
        result = ehd.simulate(machine(rough, cells), 1.5e-3, tolerance=1e-5)
        peaks.append(result.columns["contact_force_N"][-1])
    coarse, fine = abs(peaks[0] - peaks[1]), abs(peaks[1] - peaks[2])
    figure("contact", "observed order of the contact force in the mesh",
           np.log2(coarse / fine), least=1.5)  # fmt: skip


@pytest.mark.slow
def test_energy_of_contact_converges_with_the_tolerance(figure):
    defects = []
    for tolerance in (1e-4, 1e-6):
        columns = ehd.simulate(machine(surfaces()), END, tolerance=tolerance).columns
        defects.append(np.abs(columns["energy_defect_J"]).max())
    # A formula of order 3: steps shrink with the fourth root of the tolerance, 0.03 in all at best.
    figure("contact", "energy defect at tolerance 1e-6 over that at 1e-4",
           defects[1] / defects[0], most=0.15)  # fmt: skip


#: Edges that a scene gives for rough surfaces: pressures of contact do not vanish at the ends.
ENDS = {"bore": (-np.inf, np.inf)}


@pytest.mark.slow
def test_methods_agree_in_contact(rod_structure, figure):
    found = {}
    for name, body in {
        "m4": ehd.residual_flexibility(ehd.Reductor(rod_structure, film_edges=ENDS), 6),
        "full": ehd.full_interface(rod_structure, 10),
    }.items():
        mechanism = with_surfaces(flexible_slider_crank(body), surfaces())
        joint = mechanism.joints["big_end"]
        thin = ehd.Film(replace(joint.film.parameters, lubricant=ehd.Lubricant(1e-3)))
        joints = {**mechanism.joints, "big_end": replace(joint, film=thin)}
        found[name] = ehd.simulate(replace(mechanism, joints=joints), REVOLUTION, tolerance=1e-4)
    clock = np.linspace(3e-4, REVOLUTION, 400)
    for column, most in (("min_film_thickness_m", 0.02), ("max_contact_pressure_Pa", 0.02)):
        one, other = (np.interp(clock, r.time, r.columns[column]) for r in found.values())
        error = np.abs(one - other).max() / np.abs(other).max()
        figure("contact", f"{column}, M4 against the full interface", error, most=most)


def test_scene_settings_of_contact_reach_the_film(tmp_path):
    text = scene_text(ehd.read_scene("slider-crank"))
    scene = tmp_path / "scene.toml"
    for change, message in (
        ("boundary_friction = 0.2", "has no effect without journal_roughness or bore_roughness"),
        ("bore_roughness = 9e-6", "must be below 0.3 of the clearance"),
        ("bore_roughness = 1e-6\nasperity_radius = 1e-4", "radius = .* without .*asperity_density"),
        ("bore_roughness = 1e-6\nsummit_offset = 2.5", "summit_offset = 2.5 must be at most 2"),
    ):
        scene.write_text(with_keys(text, change))
        with pytest.raises(ehd.errors.SettingsError, match=rf"joints\.big_end\.contact.*{message}"):
            ehd.read_scene(scene)
    given = "journal_roughness = 0.3e-6\nbore_roughness = 0.4e-6\njournal_modulus = 100e9"
    given += "\nsummit_offset = 1.2"
    scene.write_text(with_keys(text, given))
    found = ehd.read_scene(scene)
    rough = rough_surfaces(found, found.joints["big_end"])
    assert rough.roughness == pytest.approx(0.5e-6)
    assert rough.summit_offset == 1.2
    # The bore is of the rod's own material.
    assert rough.modulus == pytest.approx(1 / (0.91 / 100e9 + 0.91 / 210e9))


def with_keys(text, keys):
    """A scene's text with other keys of contact."""
    lines, inside = [], False
    for line in text.splitlines():
        if line.startswith("["):
            inside = line == "[joints.big_end.contact]"
            lines += [line, keys] if inside else [line]
        elif not inside:
            lines.append(line)
    return "\n".join(lines)
