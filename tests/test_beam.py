"""The shaft's beam elements, its modes and its whirl against closed forms."""

import attrs
import numpy as np
import pytest
from scipy.linalg import eigh

import fenics_ehd as ehd
from fenics_ehd.multibody.shaft import _element, _shape_functions, beam_plane

LENGTH, MODULUS, DENSITY = 1.0, 210e9, 7446.0
FORCE, BEARING_WIDTH = 3600.0, 0.022


def shaft(diameter=0.045, *, elements=20, density=DENSITY, supports=1e13):
    """Pinned at its ends by default."""
    return ehd.Shaft(LENGTH, diameter, MODULUS, density, supports, elements)


def pinned_frequencies(beam, modes):
    """Of Rayleigh's beam, Euler-Bernoulli's with rotary inertia [rad/s]."""
    k = np.pi * np.arange(1, modes + 1) / LENGTH
    area, moment = beam.area, beam.second_moment
    return k**2 * np.sqrt(MODULUS * moment / (beam.density * (area + moment * k**2)))


def in_modes(beam, modes, disks=(), **more):
    """A shaft in so many modes of either plane."""
    return ehd.ShaftBody(**attrs.asdict(beam), modes=2 * modes, disks=disks, **more)


def turning(body, speed):
    """``M, C, K`` of the deflections of a shaft that turns at a speed."""
    rest, rates = np.zeros((2, body.size))
    rates[0] = speed
    found = body.balance(rest, rates, rest, minus_gravity=np.zeros(2)).derivatives()
    return [part[1:, 1:] for part in (found.acceleration, found.rate, found.position)]


def whirl_frequencies(mass, damping, stiffness):
    """Positive imaginary parts of the eigenvalues of ``M x'' + C x' + K x = 0``, ascending."""
    n = len(mass)
    inverse = np.linalg.inv(mass)
    first_order = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]]
    )
    values = np.linalg.eigvals(first_order)
    return np.sort(values.imag[values.imag > 0])


@pytest.mark.parametrize("diameter", [0.045, 1e-4])
def test_frequencies_of_a_pinned_beam_converge_with_order_four(diameter, figure):
    # The thin beam has no rotary inertia to speak of: Euler and Bernoulli's.
    supports = 1e10 * MODULUS * shaft(diameter).second_moment / LENGTH**3
    if diameter == 1e-4:
        k = np.pi * np.arange(1, 5) / LENGTH
        expected = k**2 * np.sqrt(MODULUS * diameter**2 / 16 / DENSITY)
    else:
        expected = pinned_frequencies(shaft(diameter), 4)
    errors = []
    for elements in (4, 8, 16):
        plane = beam_plane(shaft(diameter, elements=elements, supports=supports))
        errors.append(ehd.ModalRotor.of(plane, 4).angular / expected - 1)
    rates = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    figure("rotor", "beam elements, observed order less 4", np.abs(rates[1] - 4).max(), most=0.2)
    # Leading error of the cubic element: (k h)^4 / 1440.
    np.testing.assert_allclose(errors[-1], (np.pi * np.arange(1, 5) / 16) ** 4 / 1440, rtol=0.05)


def test_a_stiff_beam_bounces_and_pitches_on_its_springs():
    light = shaft(supports=1e3)
    found = ehd.ModalRotor.of(beam_plane(light), 2).angular
    # Rigid: 2 k over the mass, k l^2 / 2 over the inertia, that of the cross section included.
    inertia = light.mass * LENGTH**2 / 12 + light.polar_inertia / 2
    expected = np.sqrt([2e3 / light.mass, 1e3 * LENGTH**2 / 2 / inertia])
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_mass_and_inertia_are_those_of_the_rotor():
    beam = shaft()
    plane = beam_plane(beam, [(0.3, 0.8, 1e-3, 5e-4)])
    nodes = np.linspace(0, LENGTH, beam.elements + 1)
    up, turned = np.zeros((2, 2 * len(nodes)))
    up[::2], turned[::2], turned[1::2] = 1.0, nodes - 0.3, 1.0
    assert up @ plane.mass @ up == pytest.approx(beam.mass + 0.8)
    about = beam.mass * (LENGTH**2 / 12 + 0.2**2) + beam.polar_inertia / 2 + 5e-4
    assert turned @ plane.mass @ turned == pytest.approx(about)
    assert turned @ plane.gyroscopic @ turned == pytest.approx(beam.polar_inertia + 1e-3)
    assert up @ plane.gyroscopic @ up == pytest.approx(0.0, abs=1e-12)
    # Steel of 45 mm and a metre.
    assert beam.mass == pytest.approx(DENSITY * np.pi * 0.0225**2)
    assert beam.polar_inertia == pytest.approx(0.5 * beam.mass * 0.0225**2)


@pytest.mark.parametrize(("diameter", "edge"), [(0.0225, 117e-6), (0.045, 7.4e-6)])
def test_tilt_that_tells_diameter_from_radius(diameter, edge):
    # Under its force the shaft of the table's diameter would tilt through seven clearances.
    plane = beam_plane(shaft(diameter, supports=1.58e8))
    found = np.linalg.solve(plane.stiffness, FORCE * plane.point(0.75)[0])
    deflection, slope = plane.point(0.5) @ found
    rigidity = MODULUS * shaft(diameter).second_moment
    # A quarter and three quarters of the force on the springs.
    ends = FORCE * np.array([0.25, 0.75]) / 1.58e8
    assert slope == pytest.approx(FORCE / 128 / rigidity + np.diff(ends)[0], rel=1e-9)
    assert deflection == pytest.approx(11 / 768 * FORCE / rigidity + ends.mean(), rel=1e-9)
    assert slope * BEARING_WIDTH / 2 == pytest.approx(edge, rel=0.01)


@pytest.mark.parametrize("position", [0.0, 0.013, 0.5, 0.77, 1.0])
def test_points_see_any_cubic(position):
    plane = beam_plane(shaft(elements=3))
    x = np.linspace(0, LENGTH, 4)
    nodal = np.column_stack([x**3 - 2 * x**2 + 1, 3 * x**2 - 4 * x]).ravel()
    p = position
    expected = [p**3 - 2 * p**2 + 1, 3 * p**2 - 4 * p]
    np.testing.assert_allclose(plane.point(p) @ nodal, expected, atol=1e-12)


# --- Whirl


@pytest.mark.parametrize("speed", [600.0, 2e4])
def test_forward_and_backward_whirl_of_a_turning_shaft(speed, figure):
    beam = shaft(0.1, elements=24)
    found = whirl_frequencies(*turning(in_modes(beam, 10, damping_ratio=0.0), speed))[:8]
    # (A + I k^2) w^2 -+ 2 I k^2 Omega w - E I k^4 / rho = 0
    k = np.pi * np.arange(1, 11) / LENGTH
    inertia = beam.area + beam.second_moment * k**2
    half = beam.second_moment * k**2 * speed / inertia
    root = np.sqrt(half**2 + MODULUS * beam.second_moment * k**4 / beam.density / inertia)
    expected = np.sort(np.concatenate([root + half, root - half]))[:8]
    error = np.abs(found / expected - 1).max()
    figure("rotor", "whirl of a turning Rayleigh shaft", error, most=1e-4, unit="%")


@pytest.mark.parametrize("speed", [0.0, 300.0, 3000.0])
def test_forward_and_backward_whirl_of_a_disk(speed, figure):
    # A disk half way on a shaft without mass: it bounces, and it nods against 12 E I / l.
    beam = shaft(0.02, density=1e-6)
    mass, polar, diametral = 5.0, 0.04, 0.025
    body = in_modes(beam, 2, [(0.5, mass, polar, diametral)], damping_ratio=0.0)
    found = whirl_frequencies(*turning(body, speed))
    rigidity = MODULUS * beam.second_moment
    bounce = np.sqrt(48 * rigidity / LENGTH**3 / mass)
    half = polar * speed / 2
    root = np.sqrt(half**2 + diametral * 12 * rigidity / LENGTH)
    nods = np.array([root - half, root + half]) / diametral
    error = np.abs(found / np.sort([bounce, bounce, *nods]) - 1).max()
    figure("rotor", "whirl of a disk on a shaft without mass", error, most=1e-6)


def test_forward_whirl_turns_with_the_shaft():
    beam = shaft(0.02, density=1e-6)
    body = in_modes(beam, 2, [(0.5, 5.0, 0.04, 0.025)], damping_ratio=0.0)
    mass, damping, stiffness = turning(body, 3000.0)
    a, b = damping[:2, :2], damping[:2, 2:]
    # In w = u + i v, of which e^(i w t) is forward.
    forward = whirl_frequencies(mass, damping, stiffness)[-1]
    matrix = stiffness[:2, :2] - forward**2 * np.eye(2) + 1j * forward * (a - 1j * b)
    smallest = np.linalg.svd(matrix, compute_uv=False)[-1]
    assert smallest < 1e-6 * forward**2


def test_gyroscopic_forces_do_no_work():
    body = in_modes(shaft(), 10, damping_ratio=0.0)
    rates = np.append(600.0, np.random.default_rng(3).standard_normal(20))
    forces = body.balance(np.zeros(21), rates, np.zeros(21), minus_gravity=np.zeros(2)).forces
    assert np.abs(forces).max() > 1.0
    assert forces @ rates == pytest.approx(0.0, abs=1e-9)


# --- Jeffcott's rotor


def jeffcott(ratio, damping, modes=1):
    """A disk half way on a shaft without mass, its speed a share of the critical one."""
    beam, mass = shaft(0.02, density=1e-6), 5.0
    more = {"damping_ratio": damping, "points": {"middle": 0.5}}
    body = in_modes(beam, modes, [(0.5, mass, 0.0, 0.0)], **more)
    critical = np.sqrt(48 * MODULUS * beam.second_moment / LENGTH**3 / mass)
    speed = ratio * critical
    # 10 um off centre.
    return body, critical, speed, mass * 1e-5 * speed**2


def circle(ratio, damping):
    """Of the whirl, as a complex number of the unbalance's direction [m]."""
    return 1e-5 * ratio**2 / (1 - ratio**2 + 2j * damping * ratio)


@pytest.mark.parametrize("ratio", [0.3, 0.95, 1.0, 1.4, 5.0])
@pytest.mark.parametrize("damping", [0.001, 0.2])
def test_unbalance_response_of_a_jeffcott_rotor(ratio, damping, figure):
    body, _, speed, amplitude = jeffcott(ratio, damping, modes=2)
    mass, damped, stiffness = turning(body, speed)
    # f(t) = Re (f e^(i speed t)), whose imaginary part is that of a quarter of a turn before.
    force = amplitude * body.rotor.motion(0.5)[:2].T @ [1.0, -1.0j]
    x, y = body.rotor.motion(0.5)[:2] @ np.linalg.solve(
        stiffness - speed**2 * mass + 1j * speed * damped, force
    )
    expected = circle(ratio, damping)
    figure("rotor", "unbalance response of a Jeffcott rotor", abs(x / expected - 1), most=2e-6)
    assert y == pytest.approx(-1j * expected, rel=2e-6)


@pytest.mark.slow
def test_unbalance_whirl_in_time(figure):
    ratio, damping = 1.4, 0.05
    body, critical, speed, amplitude = jeffcott(ratio, damping)
    mechanism = ehd.Mechanism(
        {"shaft": body},
        joints={},
        drives={"shaft": ehd.Speed(speed)},
        forces={"unbalance": ehd.RotatingForce("shaft.middle", amplitude, speed)},
    )
    # From rest: the whirl, and what dies out of the free vibration.
    radius, free = circle(ratio, damping), critical * (-damping + 1j * np.sqrt(1 - damping**2))
    other = np.conj(free)
    shares = np.linalg.solve([[1.0, 1.0], [free, other]], [-radius, -1j * speed * radius])
    errors = []
    to_disk = body.rotor.motion(0.5)[:2].T @ [1.0, 1.0j]
    for tolerance in (1e-6, 1e-8):
        result = ehd.simulate(mechanism, 4 * np.pi / speed, tolerance=tolerance, order=2)
        found = result.bodies["shaft"].coordinates[:, 1:] @ to_disk
        time = result.time
        exact = radius * np.exp(1j * speed * time) + shares @ np.exp(np.outer([free, other], time))
        errors.append(np.abs(found - exact).max() / np.abs(exact).max())
    figure("rotor", "the same in time, from rest", errors[1], most=3e-3, unit="%")
    assert errors[0] / errors[1] > 10  # order 2: tolerance^(2/3), 21


# --- Shear


def sheared(diameter=0.045, *, elements=20, supports=1e13, theory="timoshenko", density=DENSITY):
    """A shaft of Timoshenko's beam theory, pinned at its ends by default."""
    return ehd.Shaft(LENGTH, diameter, MODULUS, density, supports, elements, theory)


def shear_stiffness(beam):
    """Kappa G A of a steel shaft, with the coefficient of Cowper for a circle [N]."""
    return 6 * 1.3 / (7 + 6 * 0.3) * MODULUS / 2.6 * beam.area


def timoshenko_frequencies(beam, modes):
    """Of a pinned beam: lower root of Timoshenko's frequency equation for each half wave [rad/s].

    ``rho^2 I / (kappa G) w^4 - (rho A + rho I k^2 (1 + E / (kappa G))) w^2 + E I k^4 = 0``
    """
    k = np.pi * np.arange(1, modes + 1) / LENGTH
    area, moment, density = beam.area, beam.second_moment, beam.density
    shear = shear_stiffness(beam) / area
    square = density**2 * moment / shear
    linear = density * (area + moment * k**2 * (1 + MODULUS / shear))
    constant = MODULUS * moment * k**4
    return np.sqrt(2 * constant / (linear + np.sqrt(linear**2 - 4 * square * constant)))


def test_element_matrices_are_integrals_of_its_shape_functions():
    h, phi = 0.3, 0.7
    points, weights = np.polynomial.legendre.leggauss(4)
    functions = [_shape_functions((x + 1) / 2, h, phi) for x in points]
    _, translation, rotation = _element(h, phi)
    for matrix, row in ((translation, 0), (rotation, 1)):
        integral = sum(
            0.5 * h * w * np.outer(n[row], n[row]) for w, n in zip(weights, functions, strict=True)
        )
        np.testing.assert_allclose(matrix, integral, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("elements", [1, 7])
@pytest.mark.parametrize("diameter", [0.01, 0.3])
def test_a_cantilever_deflects_by_bending_and_shear(diameter, elements, figure):
    plane = beam_plane(sheared(diameter, elements=elements, supports=0.0))
    deflection, rotation = plane.point(1.0)
    free = np.linalg.solve(plane.stiffness[2:, 2:], FORCE * deflection[2:])
    rigidity = MODULUS * plane.shaft.second_moment
    expected = FORCE * (LENGTH**3 / 3 / rigidity + LENGTH / shear_stiffness(plane.shaft))
    error = abs(deflection[2:] @ free / expected - 1)
    figure("rotor", "end of a cantilever with shear, one element and seven", error, most=1e-9)
    # The section at the end rotates by bending alone; between the nodes the solution is exact too.
    assert rotation[2:] @ free == pytest.approx(FORCE * LENGTH**2 / 2 / rigidity, rel=1e-9)
    x = 0.37 * LENGTH
    bent = x**2 * (3 * LENGTH - x) / 6 / rigidity + x / shear_stiffness(plane.shaft)
    assert plane.point(0.37)[0, 2:] @ free == pytest.approx(FORCE * bent, rel=1e-9)


def test_frequencies_of_a_pinned_beam_with_shear_are_those_of_timoshenko(figure):
    thick = sheared(0.2)
    supports = 1e9 * MODULUS * thick.second_moment / LENGTH**3
    expected = timoshenko_frequencies(thick, 4)
    # Shear takes 26 % off the fourth frequency of this beam, rotary inertia 9 %.
    assert 0.7 < expected[3] / pinned_frequencies(thick, 4)[3] < 0.8
    errors = []
    for elements in (8, 16, 32):
        plane = beam_plane(sheared(0.2, elements=elements, supports=supports))
        errors.append(ehd.ModalRotor.of(plane, 4).angular / expected - 1)
    rates = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    figure("rotor", "beam elements with shear, frequency equation, 32 elements, first mode",
           np.abs(errors[-1][0]), most=4e-5, unit="%")  # fmt: skip
    figure("rotor", "beam elements with shear, observed order less 2",
           np.abs(rates[1] - 2).max(), most=0.05)  # fmt: skip
    # Deflection by shear is piecewise linear, with the error of linear elements on its share.
    k = np.pi * np.arange(1, 5)
    sheared_share = MODULUS * thick.second_moment * k**2 / shear_stiffness(thick)
    leading = (k / 32) ** 2 / 24 * sheared_share / (1 + sheared_share)
    np.testing.assert_allclose(errors[-1], leading, rtol=0.15)


def test_shear_does_not_lock_a_slender_shaft():
    for elements in (1, 4):
        matrices = [
            beam_plane(sheared(1e-4, elements=elements, supports=0.0, theory=theory))
            for theory in ("bernoulli", "timoshenko")
        ]
        for name in ("stiffness", "mass", "gyroscopic"):
            plain, with_shear = (getattr(plane, name) for plane in matrices)
            np.testing.assert_allclose(with_shear, plain, rtol=1e-5, atol=1e-6 * plain.max())


def test_shear_takes_a_percent_off_the_elastic_mode_of_the_shipped_rotor(figure):
    shaft = ehd.read_scene("rotor-two-bearings").bodies["shaft"]
    frequencies = []
    for theory in ("bernoulli", "timoshenko"):
        plane = beam_plane(attrs.evolve(shaft, theory=theory), shaft.disks)
        rows = np.array([plane.point(shaft.points[name])[0] for name in ("left", "right")])
        pinned = plane.stiffness + 1e13 * rows.T @ rows
        frequencies.append(np.sqrt(eigh(pinned, plane.mass, eigvals_only=True)[0]))
    share = 1 - frequencies[1] / frequencies[0]
    figure("rotor", "share of shear in the elastic mode of a 40 mm shaft of 0.6 m", share,
           most=0.01, unit="%")  # fmt: skip
    assert share > 0.009


def test_poissons_ratio_belongs_to_shear():
    scene = "rotor-two-bearings"
    with pytest.raises(ehd.errors.SettingsError, match="has no effect without"):
        ehd.read_scene(scene, **{"bodies.shaft.poissons_ratio": 0.2})
    values = {"bodies.shaft.theory": "timoshenko", "bodies.shaft.poissons_ratio": 0.2}
    assert ehd.read_scene(scene, **values).bodies["shaft"].poissons_ratio == 0.2
    with pytest.raises(ehd.errors.SettingsError, match="theory = 'rayleigh' must be"):
        ehd.Shaft(theory="rayleigh")


# --- A published rotor

#: Natural frequencies [rad/s] at 0 and 4000 rpm of example 5.9.1 (page 206) of M. I. Friswell,
#: J. E. T. Penny, S. D. Garvey, A. W. Lees, Dynamics of Rotating Machines (2010), two disks on a
#: shaft on isotropic bearings, as in ross/tests/test_examples.py of github.com/petrobras/ross.
PUBLISHED = {
    0.0: (86.66, 86.66, 274.31, 274.31, 716.78, 716.78),
    4000.0: (85.39, 87.80, 251.78, 294.71, 600.18, 827.08),
}


def published_disk(position, diameter, *, inner=0.05, width=0.07, density=7810.0):
    """Share of the length, mass, polar and diametral inertia of a disk of the example."""
    mass = density * np.pi / 4 * (diameter**2 - inner**2) * width
    polar = mass * (diameter**2 + inner**2) / 8
    return position, mass, polar, polar / 2 + mass * width**2 / 12


@pytest.mark.parametrize("rpm", [0.0, 4000.0])
def test_published_rotor_of_friswell_and_others(rpm, figure):
    steel = {"youngs_modulus": 211e9, "density": 7810.0, "poissons_ratio": 211 / 2 / 81.2 - 1}
    body = ehd.ShaftBody(
        1.5, 0.05, support_stiffness=1e6, elements=6, theory="timoshenko", modes=28,
        damping_ratio=0.0, disks=[published_disk(1 / 3, 0.28), published_disk(2 / 3, 0.35)],
        **steel,
    )  # fmt: skip
    frequencies = whirl_frequencies(*turning(body, rpm * np.pi / 30))[:6]
    error = np.abs(frequencies / PUBLISHED[rpm] - 1).max()
    figure("rotor", "published rotor at 0 and 4000 rpm, natural frequencies", error, most=2e-4,
           unit="%")  # fmt: skip
