"""Spin-up manoeuvre: the connecting rod turned about its bore, against Exudyn.

The rod is driven from rest to a constant speed, its frame by a given angle, without film. Exudyn
moves the same reduced body in space, by its own inertia terms and its own integrator. Skipped
without Exudyn, see `test_export.py`.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from fenics_ehd.multibody.bdf import StepControl, integrate
from fenics_ehd.multibody.crank import CrankMotion
from fenics_ehd.multibody.floating_frame import inertia_forces
from fenics_ehd.multibody.guide import RodAngle
from fenics_ehd.reduction import craig_bampton
from fenics_ehd.reduction.export_exudyn import export_exudyn
from fenics_ehd.reduction.exudyn_body import add_body
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.spatial_inertia import spatial_inertia

#: Speed reached [rad/s], time it takes, end of the comparison [s].
SPEED, RISE, END = 500.0, 3e-3, 4e-3

MODES = 6


def angle_of(time):
    """Angle, speed and acceleration of the frame (Kane, Ryan and Banerjee, 1987)."""
    if time >= RISE:
        return SPEED * (time - 0.5 * RISE), SPEED, 0.0
    turn = 2 * np.pi * time / RISE
    angle = SPEED / RISE * (0.5 * time**2 + (RISE / (2 * np.pi)) ** 2 * (np.cos(turn) - 1.0))
    return (
        angle,
        SPEED / RISE * (time - RISE / (2 * np.pi) * np.sin(turn)),
        (SPEED / RISE * (1.0 - np.cos(turn))),
    )


@dataclass
class TurnedRod:
    """Elastic coordinates of a rod whose frame turns as it is told, about its bore's centre."""

    body: object

    def linearise(self, time, x, rate, acceleration, shifts, guess):
        n = len(x) + 2
        angle, speed, turning = angle_of(time)
        none = np.zeros(n)
        frame = RodAngle(angle, speed, turning, none, none, none, lambda: np.zeros((n, n)))
        state = tuple(np.concatenate([np.zeros(2), values]) for values in (x, rate, acceleration))
        rest = CrankMotion(np.zeros(2), np.zeros(2), np.zeros(2), 0.0)
        forces = inertia_forces(self.body.inertia, rest, frame, state, shifts)
        residual = forces.on_xi[2:] + self.body.stiffness @ x
        return residual, forces.on_xi_slope[2:, 2:] + self.body.stiffness, None

    def watch(self, x):
        return self.body.points["pin"][:2, 3:] @ x

    def error_norm(self, watched, error):
        return float(np.abs(error).max() / 1e-5)

    def norm(self, x, change):
        return float(np.abs(self.watch(change)).max() / 1e-5)

    def admissible_fraction(self, x, change):
        return np.inf


@pytest.fixture(scope="module")
def exudyn():
    return pytest.importorskip("exudyn")


@pytest.fixture(scope="module")
def body(rod_structure):
    return craig_bampton(rod_structure, MODES, keep_basis=True, estimate_error=False)


def in_exudyn(exudyn, path, modes, steps):
    """Times and elastic coordinates."""
    item = pytest.importorskip("exudyn.itemInterface")
    container = exudyn.SystemContainer()
    mbs = container.AddSystem()
    ids = add_body(mbs, path)
    for name in ("initialCoordinates", "initialCoordinates_t"):
        mbs.SetNodeParameter(ids["nGenericODE2"], name, [0.0] * modes)
    ground = mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=mbs.AddObject(item.ObjectGround())))
    node = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=ids["nRigidBody"]))

    def offset(mbs, time, index, parameters):
        return [0.0, 0.0, 0.0, 0.0, 0.0, angle_of(time)[0]]

    mbs.AddObject(item.GenericJoint(markerNumbers=[ground, node], offsetUserFunction=offset))
    sensor = mbs.AddSensor(
        item.SensorNode(
            nodeNumber=ids["nGenericODE2"],
            storeInternal=True,
            outputVariableType=exudyn.OutputVariableType.Coordinates,
        )
    )
    mbs.Assemble()
    options = exudyn.SimulationSettings()
    options.timeIntegration.endTime = END
    options.timeIntegration.numberOfSteps = steps
    options.timeIntegration.verboseMode = 0
    options.timeIntegration.newton.relativeTolerance = 1e-10
    options.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    options.solution.file.write = False
    options.solution.sensors.writePeriod = END / 400
    mbs.SolveDynamic(options)
    found = np.array(mbs.GetSensorStoredData(sensor))
    return found[:, 0], found[:, 1:]


def test_a_rod_that_is_spun_up_bends_as_in_exudyn(exudyn, rod_structure, body, tmp_path, figure):
    mass = MassOperator(rod_structure.mass)
    spatial = spatial_inertia(rod_structure, mass, body.columns)
    path = export_exudyn(body, tmp_path / "rod", spatial)
    rod = TurnedRod(body)
    pin = body.points["pin"][:2, 3:]
    times, coordinates = in_exudyn(exudyn, path, body.modes, 8000)
    theirs = coordinates @ pin.T
    rest = np.zeros(body.modes)
    control = StepControl(1e-7, 1e-7, 1e-13, 2e-6, order=3)
    steps = list(integrate(rod, (0.0, END), rest, rest, control))
    ours = np.array([np.interp(times, [0.0, *(s.time for s in steps)], [0.0, *column])
                     for column in np.array([pin @ s.x for s in steps]).T]).T  # fmt: skip
    size, differences = np.abs(theirs).max(axis=0), np.abs(ours - theirs).max(axis=0)
    worst = (differences / size).max()
    figure("machines", "rod spun up, deflection against Exudyn", worst, most=1e-5)
