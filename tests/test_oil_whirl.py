"""Rotors in lubricated bearings, in time, against bearing coefficients: onset of oil whirl."""

from dataclasses import replace
from functools import cached_property
from typing import ClassVar

import attrs
import numpy as np
import pytest
from journal_cases import in_bearing, steady
from scipy.linalg import eig
from scipy.optimize import brentq, least_squares
from test_bearing import COEFFICIENTS

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.mechanism import Instant, System, assemble
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.shaft import beam_plane

R, VISCOSITY, SPEED = 0.0225, 0.01, 600.0
TURN = 2 * np.pi / SPEED

#: Sommerfeld number, attitude and mass at the threshold of stability by eccentricity ratio.
TABLE = {ratio: (number, angle, mass) for ratio, number, angle, _, _, mass in COEFFICIENTS}


def film_of(width, clearance, cells):
    grid = ehd.uniform_grid(R, width, cells, "lagrange")
    return ehd.Film(ehd.FilmParameters(grid, clearance, ehd.Lubricant(VISCOSITY), SPEED))


class Bearing:
    """A bearing of the table (thin film) and a load that it bears at an eccentricity."""

    def __init__(self, ratio, cells=(48, 6)):
        number, attitude, critical = TABLE[ratio]
        self.clearance = 1e-4 * R
        self.film = film_of(2 * R, self.clearance, cells)
        unit = (1e4) ** 2 * VISCOSITY * SPEED / (2 * np.pi) * 4 * R**2
        self.load = unit / number
        # The load along x; the shaft turns from x to y and rests off the load by the attitude.
        angle = np.radians(attitude)
        self.start = ratio * self.clearance * np.array([np.cos(angle), np.sin(angle)])
        self.threshold = critical * self.load / (self.clearance * SPEED**2)

    def rotor(self, mass, force, place, rate=(0.0, 0.0)):
        start = {"eccentricity": tuple(place), "eccentricity_rate": tuple(rate)}
        return in_bearing(self.film, {"load": force}, mass=mass, speed=SPEED, **start)


def least_stable(mass, damping, stiffness):
    """Eigenvalue and right vector ``(x, x')`` of ``M x'' + D x' + K x = 0``."""
    n = len(mass)
    inverse = np.linalg.inv(mass)
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    values, vectors = eig(matrix)
    least = int(np.argmax(values.real + 1e-9 * values.imag))
    return values[least], vectors[:, least]


def whirl_of(time, orbit, guess):
    """Eigenvalue of an orbit (2, steps) about its place of rest: growth and frequency."""
    start = 0.25 * time[-1]
    time, orbit = time[time > start], orbit[:, time > start]

    def left(found):
        wave = np.exp(complex(*found) * time)
        basis = np.stack([wave.real, wave.imag, np.ones_like(time)], axis=1)
        return (orbit.T - basis @ np.linalg.lstsq(basis, orbit.T, rcond=None)[0]).ravel()

    scale = np.abs(orbit).max()
    found = least_squares(
        lambda x: left(x * SPEED) / scale, [guess.real / SPEED, guess.imag / SPEED]
    )
    return complex(*found.x)


def threshold(light, heavy):
    """Mass without growth, of growths at 0.95 and 1.05 of what is expected."""
    assert light.real < 0.0 < heavy.real
    return 0.95 - 0.1 * light.real / (heavy.real - light.real)


@pytest.mark.parametrize("ratio", [pytest.param(0.3, marks=pytest.mark.slow), 0.6])
def test_onset_of_oil_whirl(ratio, figure):
    # Masses 5 % below and above the table's threshold, at its speed and load.
    bearing = Bearing(ratio)
    c, found = bearing.clearance, []
    for share in (0.95, 1.05):
        mass, load = share * bearing.threshold, steady(bearing.load)
        rest = ehd.equilibrium(bearing.rotor(mass, load, bearing.start))
        journal = rest.system.bodies["journal"].start + np.arange(2)
        small, place = ehd.linearise(rest).along(journal), rest.z[journal]
        value, vector = least_stable(small.mass, small.damping, small.stiffness)
        start = 2e-3 * c * (vector / np.abs(vector[:2]).max()).real
        mechanism = bearing.rotor(mass, load, place + start[:2], start[2:])
        result = ehd.simulate(mechanism, 3 * TURN, tolerance=3e-7, order=2, first=1e-6)
        orbit = result.joints["bearing"].eccentricity.T - place[:, None]
        found.append(whirl_of(result.time, orbit, value))
        assert found[-1].real == pytest.approx(value.real / SPEED, abs=4e-4)
        assert abs(found[-1].imag) == pytest.approx(abs(value.imag) / SPEED, rel=0.01)
    error = abs(threshold(*found) - 1.0)
    figure("rotor", "onset of oil whirl in time, mass of the table", error, most=0.02, unit="%")
    # Half the speed of the shaft, and less on a heavily loaded one.
    frequency = 0.5 * sum(abs(value.imag) for value in found)
    error = abs(frequency / {0.3: 0.50038, 0.6: 0.45233}[ratio] - 1)
    figure("rotor", "its frequency", error, most=0.01, unit="%")


# --- A load that turns with the shaft


def test_a_load_that_turns_with_the_shaft_runs_the_table_backwards():
    # In the frame of the load the shaft stands still and the bore turns back at its speed: the
    # journal of the table, seen in a mirror, on a circle.
    bearing = Bearing(0.6, (36, 5))
    place = bearing.start * [1.0, -1.0]
    rate = SPEED * np.array([-place[1], place[0]])
    mechanism = bearing.rotor(
        1e-3 * bearing.threshold, ehd.RotatingForce("journal", bearing.load, SPEED), place, rate
    )
    result = ehd.simulate(mechanism, 0.25 * TURN, tolerance=1e-5, order=2, first=1e-6)
    # A quarter of a turn later.
    found = result.joints["bearing"].eccentricity[-1]
    assert np.hypot(*(found - [-place[1], place[0]])) < 3e-3 * bearing.clearance
    assert result.summary()["energy_balance_error"] < 2e-3


# --- An elastic shaft in two bearings


class TwoBearings:
    """Free shaft with a disk in its middle, in two narrow bearings that are loaded alike.

    The load acts at the journals: the shaft rests straight, for any mass of the disk.
    """

    ratio = 0.3
    width = 0.010
    clearance = 30e-6
    shaft = ehd.Shaft(0.5, 0.03, 210e9, 7850.0, 0.0, 10)
    stations: ClassVar = {"left": 0.1, "right": 0.9}

    @cached_property
    def table(self):
        """Load of one bearing, and its coefficients by the program for bearings."""
        # Damping is 1 % off on the default mesh at so small an eccentricity.
        settings = ehd.BearingSettings(
            radius=R, width=self.width, clearance=self.clearance, viscosity=VISCOSITY, speed=SPEED,
            cells_around=96, cells_along=16,
        )  # fmt: skip
        found = ehd.solve_bearing(settings, eccentricity=self.ratio, with_coefficients=True)
        return found.load, found.coefficients

    def beam(self, mass):
        return beam_plane(self.shaft, [(0.5, mass, 1e-3 * mass, 5e-4 * mass)])

    def matrices(self, mass):
        """Of all beams and both bearings: mass, damping and gyroscopic, stiffness."""
        beam, (_, linear) = self.beam(mass), self.table
        plane = np.eye(2)
        damping = SPEED * np.kron([[0.0, 1.0], [-1.0, 0.0]], beam.gyroscopic)
        stiffness = np.kron(plane, beam.stiffness)
        for share in self.stations.values():
            row = np.kron(plane, beam.point(share)[0])
            damping, stiffness = (
                damping + row.T @ linear.damping @ row,
                stiffness + row.T @ linear.stiffness @ row,
            )
        return np.kron(plane, beam.mass), damping, stiffness

    @cached_property
    def threshold(self):
        """Mass of the disk at which the rotor begins to whirl [kg]."""
        rigid = 2 * self.table[1].critical_mass

        def growth(mass):
            return least_stable(*self.matrices(mass))[0].real

        return brentq(growth, 0.1 * rigid, rigid)

    def mechanism(self, mass, film, place):
        load, names = self.table[0], self.stations
        shaft = ehd.ShaftBody(
            **attrs.asdict(self.shaft),
            modes=12,
            damping_ratio=0.0,
            disks=[(0.5, mass, 1e-3 * mass, 5e-4 * mass)],
            points=self.stations,
        )
        return ehd.Mechanism(
            {"shaft": shaft, "ground": ehd.ground(dict.fromkeys(names, (0.0, 0.0)))},
            {
                name: ehd.LubricatedJoint(
                    f"shaft.{name}", f"ground.{name}", film, eccentricity=tuple(place)
                )
                for name in names
            },
            {"shaft": ehd.Speed(SPEED)},
            {n: ehd.PointForce(f"shaft.{n}", (1.0, 0.0), lambda _: (load, 0.0)) for n in names},
        )

    def whirl(self, mass):
        """Eigenvalue that the rotor shows in time and that of its matrices, over its speed."""
        value, vector = least_stable(*self.matrices(mass))
        film = film_of(self.width, self.clearance, (48, 4))
        start = self.clearance * np.array([0.1, 0.28])
        rest = ehd.equilibrium(self.mechanism(mass, film, start))
        place = rest.z[rest.system.films[0].xi[:2]]
        run = Run(
            self.mechanism(mass, film, place),
            IntegratorOptions(tolerance=3e-7, order=2, first=1e-6),
            3 * TURN,
        )
        self._disturb(run, vector, mass)
        time, orbit = [], []
        for step in run.until(3 * TURN):
            time.append(step.time)
            orbit.append(step.x[run.equations.system.films[0].xi[:2]] - place)
        return whirl_of(np.array(time), np.array(orbit).T, value), value / SPEED

    def _disturb(self, run, vector, mass):
        """Begin with a whirl, as small as a five hundredth of the clearance."""
        beam, system = self.beam(mass), run.equations.system
        both = np.kron(np.eye(2), (ehd.ModalRotor.of(beam, 6).shapes.T @ beam.mass))
        journal = np.kron(np.eye(2), beam.point(self.stations["left"])[0])
        d = 2 * len(beam.mass)
        size = 2e-3 * self.clearance / np.abs(journal @ vector[:d]).max()
        x, rate = run.state.x[0].copy(), run.state.rate[0].copy()
        modes = slice(system.bodies["shaft"].start + 1, system.bodies["shaft"].stop)
        for values, part in ((x, vector[:d]), (rate, vector[d:])):
            change = np.zeros(system.n)
            change[modes] = both @ (size * part).real
            # Eccentricities follow the shaft.
            markers = Instant(system, 0.0, system.rough_pose[0]).jacobian
            own = np.concatenate([film.xi for film in system.films])
            change[own] = -np.linalg.solve(markers[: len(own), own], markers[: len(own)] @ change)
            values[: system.n] += change
        observed = run.norm.observe(x)[None]
        run.state = replace(run.state, x=x[None], rate=rate[None], observed=observed)


@pytest.mark.slow
def test_onset_of_whirl_of_an_elastic_rotor_on_two_bearings(figure):
    rotor = TwoBearings()
    # The shaft's elasticity halves the mass that runs smoothly.
    rigid = 2 * rotor.table[1].critical_mass
    assert 0.4 * rigid < rotor.threshold < 0.6 * rigid
    found = []
    for share in (0.95, 1.05):
        seen, expected = rotor.whirl(share * rotor.threshold)
        assert abs(seen.imag) == pytest.approx(abs(expected.imag), rel=0.01)
        found.append(seen)
    error = abs(threshold(*found) - 1.0)
    figure("rotor", "onset of whirl of an elastic rotor on two bearings, mass by their "
           "coefficients", error, most=0.02, unit="%")  # fmt: skip


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_an_elastic_rotor_linearised_with_its_films_whirls_as_by_their_coefficients(share):
    """Shaft, joints and films as one mechanism: the same roots on either side of the threshold."""
    rotor = TwoBearings()
    mass = share * rotor.threshold
    expected = least_stable(*rotor.matrices(mass))[0]
    film = film_of(rotor.width, rotor.clearance, (48, 4))
    place = rotor.clearance * np.array([0.1, 0.28])
    roots = ehd.linearise(rotor.mechanism(mass, film, place)).roots
    found = roots[np.argmax(roots.real)]
    assert found.real == pytest.approx(expected.real, abs=1e-3 * abs(expected))
    assert abs(found.imag) == pytest.approx(abs(expected.imag), rel=3e-3)


def test_a_shaft_begins_where_its_journals_are_said_to_be():
    rotor = TwoBearings()
    place = np.array([0.2, -0.4]) * rotor.clearance
    film = film_of(rotor.width, rotor.clearance, (12, 2))
    system = System(rotor.mechanism(40.0, film, place))
    z, _ = assemble(system)
    for joint in system.films:
        assert z[joint.xi[:2]] == pytest.approx(place, rel=1e-4)
        assert np.abs(z[joint.xi[2:]]).max() < 1e-4 * rotor.clearance / rotor.width
