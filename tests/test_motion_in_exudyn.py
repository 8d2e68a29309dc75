"""Mechanisms with ideal joints, and a flexible rod in them, against Exudyn.

Exudyn moves the same bodies by its own equations and its own integrator; what needs it is skipped
without it, see `test_export.py`.
"""

import numpy as np
import pytest
from mechanism_cases import CRANK, REVOLUTION, ROD, SPEED
from scene_cases import RIGID_ROD, tables_of
from scipy.interpolate import CubicHermiteSpline
from test_demos import demo

import fenics_ehd as ehd
from fenics_ehd.multibody.mechanism import System, assemble
from fenics_ehd.scenes.scene import scene_of

exudyn_body = demo("exudyn_body")

GRAVITY, TORQUE = 9.81, 2.0

#: Speed that a rod is spun up to [rad/s], time it takes, end of the comparison [s].
TOP_SPEED, RISE, END = 500.0, 3e-3, 4e-3

MODES = 6


@pytest.fixture(scope="module")
def exudyn():
    return pytest.importorskip("exudyn")


def solve(exudyn, mbs, end, steps):
    mbs.Assemble()
    options = exudyn.SimulationSettings()
    options.timeIntegration.endTime = end
    options.timeIntegration.numberOfSteps = steps
    options.timeIntegration.verboseMode = 0
    options.timeIntegration.newton.relativeTolerance = 1e-10
    options.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    options.solution.file.write = False
    options.solution.sensors.writePeriod = end / 400
    mbs.SolveDynamic(options)


# --- Rigid bodies


def of_scene(name, *changes):
    """A shipped scene whose crank a torque turns, under gravity."""
    together = {
        "drives.crank": {"kind": "torque", "torque": TORQUE},
        "forces.weight": {"kind": "gravity", "acceleration": [0.0, -GRAVITY]},
    }
    for change in changes:
        together |= change
    return ehd.build(scene_of(tables_of(name, together), name)).mechanism


def linkage():
    """Four bars, the rocker's tip on a spring."""
    ends = {"between": ["rocker.tip", "ground.wall"]}
    return of_scene("four-bar", {
        "bodies.ground.points.wall": [0.4, 0.2],
        "bodies.crank.speed": 50.0,
        "bodies.coupler.centre": [0.06, 0.01],
        "bodies.rocker.centre": [0.04, 0.01],
        "joints.rocker_end": {"kind": "revolute", "between": ["rocker.tip", "coupler.tip"]},
        "forces.spring": {"kind": "spring-damper", "stiffness": 500.0, "damping": 5.0, **ends},
    })  # fmt: skip


def slider_crank():
    """Crank, rod and piston, the line tilted."""
    tilt = np.radians(17.0)
    along = [np.cos(tilt), np.sin(tilt)]
    return of_scene("slider-crank-paper", RIGID_ROD, {
        "bodies.crank.angle": 28.6,
        "bodies.crank.speed": 30.0,
        "bodies.rod.position": [0.04, 0.02],
        "bodies.piston.position": [0.2 * along[0], 0.2 * along[1]],
        "bodies.piston.angle": 17.0,
        "joints.big_end": {"kind": "revolute", "between": ["crank.pin", "rod"]},
        "joints.cylinder.direction": along,
        "joints.cylinder.angle": 17.0,
    })  # fmt: skip


def double_pendulum():
    """Two rods that fall from the side, the lower one heavy at its end."""
    return ehd.Mechanism(
        {
            "upper": ehd.RigidBody(1.0, 5e-3, {"tip": (0.2, 0.0)}, centre=(0.1, 0.0)),
            "lower": ehd.RigidBody(
                0.7, 2e-3, centre=(0.13, 0.02), position=(0.2, 0.0), angle=40.1, speed=-5.0
            ),
        },
        {"hinge": ehd.Revolute(("ground", "upper")), "elbow": ehd.Revolute(("upper.tip", "lower"))},
        gravity=(0.0, -GRAVITY),
    )


class InExudyn:
    """The same mechanism there, its bodies at places of assembly, joint by joint."""

    def __init__(self, exudyn, mechanism):
        self._item = pytest.importorskip("exudyn.itemInterface")
        self.container = exudyn.SystemContainer()
        self.mbs = self.container.AddSystem()
        self._exudyn, self._mechanism = exudyn, mechanism
        self._bodies, self.sensors = {}, {}
        self._ground = self.mbs.AddObject(self._item.ObjectGround())
        system = System(mechanism)
        z, v = assemble(system)
        for name, body in mechanism.bodies.items():
            if not body.held:
                self._add_body(name, body, z[system.bodies[name]], v[system.bodies[name]])
        for joint in mechanism.joints.values():
            self._add_joint(joint)
        for force in mechanism.forces.values():
            self._add_force(force)

    def _add_body(self, name, body, place, rate):
        item, mbs = self._item, self.mbs
        turn = np.array(
            [[np.cos(place[2]), -np.sin(place[2])], [np.sin(place[2]), np.cos(place[2])]]
        )
        arm = turn @ body.centre
        node = mbs.AddNode(item.NodeRigidBody2D(
            referenceCoordinates=[*(place[:2] + arm), place[2]],
            initialVelocities=[rate[0] - rate[2] * arm[1], rate[1] + rate[2] * arm[0], rate[2]],
        ))  # fmt: skip
        self._bodies[name] = mbs.AddObject(item.ObjectRigidBody2D(
            nodeNumber=node, mass=body.mass, inertia=body.inertia
        ))  # fmt: skip
        centre = mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=self._bodies[name]))
        pull = [body.mass * g for g in (*self._mechanism.gravity, 0.0)]
        mbs.AddLoad(item.LoadForceVector(markerNumber=centre, loadVector=pull))
        self.sensors[name] = mbs.AddSensor(item.SensorNode(
            nodeNumber=node, storeInternal=True,
            outputVariableType=self._exudyn.OutputVariableType.Coordinates,
        ))  # fmt: skip

    def _marker(self, name, kind):
        """Of a point, from the centre of mass where the body is not the ground."""
        body_name, _, point = name.partition(".")
        body = self._mechanism.bodies.get(body_name, ehd.ground())
        at = np.array(body.points[point] if point else (0.0, 0.0))
        number = self._bodies.get(body_name, self._ground)
        return self.mbs.AddMarker(kind(bodyNumber=number, localPosition=[*(at - body.centre), 0.0]))

    def _add_joint(self, joint):
        item = self._item
        if isinstance(joint, ehd.Revolute):
            markers = [self._marker(m, item.MarkerBodyPosition) for m in joint.markers]
            self.mbs.AddObject(item.ObjectJointRevolute2D(markerNumbers=markers))
            return
        markers = [self._marker(m, item.MarkerBodyRigid) for m in joint.markers]
        # The normal belongs to the piston, which is turned as the line is.
        self.mbs.AddObject(item.ObjectJointPrismatic2D(
            markerNumbers=markers, axisMarker0=[*joint.direction, 0.0],
            normalMarker1=[0.0, 1.0, 0.0],
        ))  # fmt: skip

    def _add_force(self, force):
        item = self._item
        if isinstance(force, ehd.Torque):
            marker = self._marker(force.body, item.MarkerBodyRigid)
            self.mbs.AddLoad(
                item.LoadTorqueVector(markerNumber=marker, loadVector=[0.0, 0.0, TORQUE])
            )
            return
        markers = [self._marker(m, item.MarkerBodyPosition) for m in force.markers]
        self.mbs.AddObject(item.ObjectConnectorCartesianSpringDamper(
            markerNumbers=markers, stiffness=[force.stiffness] * 3, damping=[force.damping] * 3
        ))  # fmt: skip

    def angles(self, end, steps):
        """Times, and how far every body has turned, by name."""
        solve(self._exudyn, self.mbs, end, steps)
        found = {n: np.array(self.mbs.GetSensorStoredData(s)) for n, s in self.sensors.items()}
        return next(iter(found.values()))[:, 0], {n: f[:, 3] for n, f in found.items()}


@pytest.mark.parametrize("make", [linkage, slider_crank, double_pendulum])
def test_rigid_mechanisms_move_as_in_exudyn(exudyn, make, figure):
    end, mechanism = 0.12, make()
    result = ehd.simulate(mechanism, end, tolerance=2e-8, order=3)
    times, expected = InExudyn(exudyn, mechanism).angles(end, 20000)
    late = times > 1e-3
    for name, turned in expected.items():
        ours = result.bodies[name].coordinates[:, 2]
        spline = CubicHermiteSpline(result.time, ours, result.bodies[name].rates[:, 2])
        error = np.abs(spline(times[late]) - ours[0] - turned[late]).max()
        figure("mechanisms", "rigid mechanisms with ideal joints, angles against Exudyn",
               error / max(np.ptp(turned), 0.1), most=1e-4)  # fmt: skip


# --- An elastic rod


@pytest.fixture(scope="module")
def body(rod_structure):
    return ehd.craig_bampton(rod_structure, MODES, keep_basis=True, estimate_error=False)


@pytest.fixture(scope="module")
def file(rod_structure, body, tmp_path_factory):
    return exudyn_body.export(body, rod_structure, tmp_path_factory.mktemp("exudyn") / "rod.npz")


class RodInExudyn:
    """The rod in space, its bore's frame on a given path."""

    def __init__(self, exudyn, file, modes, **motion):
        self._item = item = pytest.importorskip("exudyn.itemInterface")
        self.container, self._exudyn = exudyn.SystemContainer(), exudyn
        self.mbs = mbs = self.container.AddSystem()
        self.ids = exudyn_body.add_body(mbs, file, **motion)
        for name in ("initialCoordinates", "initialCoordinates_t"):
            mbs.SetNodeParameter(self.ids["nGenericODE2"], name, [0.0] * modes)
        self._ground = mbs.AddObject(item.ObjectGround())
        self._sensor = mbs.AddSensor(item.SensorNode(
            nodeNumber=self.ids["nGenericODE2"], storeInternal=True,
            outputVariableType=exudyn.OutputVariableType.Coordinates,
        ))  # fmt: skip

    def lead(self, path, axes):
        """Give place and angles of the frame over time, six numbers, as far as `axes` say."""
        item, mbs = self._item, self.mbs
        rest = mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=self._ground))
        node = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=self.ids["nRigidBody"]))
        mbs.AddObject(item.GenericJoint(
            markerNumbers=[rest, node], constrainedAxes=axes,
            offsetUserFunction=lambda mbs, time, index, parameters: path(time),
        ))  # fmt: skip

    def add_piston(self, mass, place, pin):
        """A point on the x axis that a node of the rod's, its pin, moves."""
        item, mbs = self._item, self.mbs
        piston = mbs.AddNode(item.NodePoint(referenceCoordinates=place))
        body = mbs.AddObject(item.MassPoint(mass=mass, nodeNumber=piston))
        nothing = mbs.AddMarker(item.MarkerNodeCoordinate(
            nodeNumber=mbs.AddNode(item.NodePointGround()), coordinate=0
        ))  # fmt: skip
        for coordinate in (1, 2):
            held = mbs.AddMarker(
                item.MarkerNodeCoordinate(nodeNumber=piston, coordinate=coordinate)
            )
            mbs.AddObject(item.CoordinateConstraint(markerNumbers=[nothing, held]))
        pin = mbs.AddMarker(item.MarkerSuperElementPosition(
            bodyNumber=self.ids["oFFRFreducedOrder"], weightingFactors=[1.0],
            meshNodeNumbers=[pin],
        ))  # fmt: skip
        there = mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=body))
        joint = item.ObjectJointSpherical(markerNumbers=[pin, there], constrainedAxes=[1, 1, 0])
        mbs.AddObject(joint)

    def coordinates(self, end, steps):
        """Times and elastic coordinates."""
        solve(self._exudyn, self.mbs, end, steps)
        found = np.array(self.mbs.GetSensorStoredData(self._sensor))
        return found[:, 0], found[:, 1:]


def deflections(body, result, times, coordinates):
    """Deflections of the pin in the rod's frame, here and in Exudyn, shape (times, 2) [m]."""
    pin = body.points["pin"][:2, 3:].T
    start = np.zeros((1, body.modes))
    ours, rates = (
        np.vstack([start, values[:, 3:]]) @ pin
        for values in (result.bodies["rod"].coordinates, result.bodies["rod"].rates)
    )
    return CubicHermiteSpline(np.append(0.0, result.time), ours, rates)(times), coordinates @ pin


def spinning(time):
    """Angle and speed of the rod's frame (Kane, Ryan and Banerjee, 1987)."""
    if time >= RISE:
        return TOP_SPEED * (time - 0.5 * RISE), TOP_SPEED
    turn = 2 * np.pi * time / RISE
    angle = 0.5 * time**2 + (RISE / (2 * np.pi)) ** 2 * (np.cos(turn) - 1.0)
    speed = time - RISE / (2 * np.pi) * np.sin(turn)
    return TOP_SPEED / RISE * angle, TOP_SPEED / RISE * speed


def test_a_rod_that_is_spun_up_bends_as_in_exudyn(exudyn, body, file, figure):
    mechanism = ehd.Mechanism(
        {"rod": ehd.FlexibleBody(body)},
        {"hinge": ehd.Revolute(("ground", "rod.bore"))},
        {"rod": spinning},
    )
    result = ehd.simulate(mechanism, END, tolerance=1e-8, order=3)
    rod = RodInExudyn(exudyn, file, body.modes)
    rod.lead(lambda time: [0.0, 0.0, 0.0, 0.0, 0.0, spinning(time)[0]], [1] * 6)
    ours, expected = deflections(body, result, *rod.coordinates(END, 8000))
    worst = (np.abs(ours - expected).max(axis=0) / np.abs(expected).max(axis=0)).max()
    figure("machines", "rod spun up, deflection against Exudyn", worst, most=1e-5)


def test_an_elastic_rod_of_a_slider_crank_bends_as_in_exudyn(exudyn, body, file, figure):
    damping_time, end = 1e-4, 0.5 * REVOLUTION
    mechanism = ehd.Mechanism(
        {
            "crank": ehd.RigidBody(1.0, 1e-3, {"pin": (CRANK, 0.0)}),
            "rod": ehd.FlexibleBody(body, damping_time, position=(CRANK, 0.0)),
            "piston": ehd.RigidBody(0.5, 1e-3, position=(CRANK + ROD, 0.0)),
        },
        {
            "main": ehd.Revolute(("ground", "crank")),
            "big_end": ehd.Revolute(("crank.pin", "rod.bore")),
            "gudgeon": ehd.Revolute(("rod.pin", "piston")),
            "cylinder": ehd.Slider("ground", "piston"),
        },
        {"crank": ehd.Speed(SPEED)},
    )
    result = ehd.simulate(mechanism, end, tolerance=1e-7, order=3)
    rod = RodInExudyn(
        exudyn, file, body.modes, positionRef=[CRANK, 0.0, 0.0],
        initialVelocity=[0.0, CRANK * SPEED, 0.0],
        initialAngularVelocity=[0.0, 0.0, -CRANK / ROD * SPEED],
        stiffnessProportionalDamping=damping_time,
    )  # fmt: skip
    rod.lead(
        lambda t: [CRANK * np.cos(SPEED * t), CRANK * np.sin(SPEED * t), 0.0, 0.0, 0.0, 0.0],
        [1, 1, 1, 1, 1, 0],
    )
    pin = len(body.bore_nodes) + list(body.points).index("pin")
    rod.add_piston(0.5, [CRANK + ROD, 0.0, 0.0], pin)
    ours, expected = deflections(body, result, *rod.coordinates(end, 8000))
    worst = (np.abs(ours - expected).max(axis=0) / np.abs(expected).max(axis=0)).max()
    name = "elastic rod of a slider-crank, deflection against Exudyn"
    figure("mechanisms", name, worst, most=1e-4)
