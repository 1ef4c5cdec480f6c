"""A drone in the physics engine whose arm holds its tool in the world, without ROS."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import ImuSample, rotation_matrix
from aerarm_ros.control.base.free_base_estimator import FreeBaseEstimator
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.flight.arm_load import ArmFeedForward, ArmLoadModel, MassProperties
from aerarm_ros.flight.flight_control import FlightControl, FlightGains
from aerarm_ros.flight.flight_estimator import FlightEstimator
from aerarm_ros.flight.flight_state import FlightTarget, OdometrySample
from aerarm_ros.identification.files.identified_robot import LoadFriction, identified_urdf
from aerarm_ros.model.inertia import barycentric_inertia, parameters_of_body
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import ArmState, JointReference
from aerarm_ros.nodes.controllers.world_control import WorldControlNode
from aerarm_ros.ros.controllers.controller_parameters import ControlledArm
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.flying_plant import FlyingPlant
from aerarm_ros.simulation.sensors import (
    BandLimitedNoise,
    DelayedSensor,
    FaultyImu,
    NoisyOdometry,
    OdometryReading,
)
from aerarm_ros.world.world_law import WorldGains
from aerarm_ros.world.world_reference import WorldPath

Array = npt.NDArray[np.float64]
Told = Callable[[OdometrySample], list[OdometrySample]]

CYCLE, IMU_RATE = 1e-3, 250.0
LINK_DELAY = 4  # cycles from a rotor command to its rotor
LEAD, AHEAD = 0.028, 0.06  # [s] as in flight_control and base_reaction
POSTURE = 0.0, 1.3, 0.0, 1.5
SETTLED, BEGIN = 2.0, 3.0  # [s] of the target, and of the start of the evaluation
GENERALISED, HELD = 'generalised', 'joints held'
COPLANAR = FlightGains(2.5, 4.5, 8.0, position_integral=0.1, attitude_integral=0.1)
FULL = FlightGains(8.67, 8.67, 9.0, position_integral=0.1, attitude_integral=0.1)
GOOD = 100.0, 0.01, 1e-3, 5e-3
POOR = 30.0, 0.03, 5e-3, 20e-3
"""Odometry: rate [Hz], delay [s], noise of position [m] and velocity [m/s]."""

CONFIG = load_arm_config()
ROTORS = CONFIG.column('reflected_inertia')


@dataclass(frozen=True)
class HeldFlight:
    """Settings of a flight.

    Attributes
    ----------
    drone : file of a packaged drone; mass : another mass [kg] at constant density and thrust.
    law : GENERALISED, or HELD joints.
    wind : root mean square of the force on the drone [N], below 0.5 Hz.
    odometry : of the arm's controller; the pilot has GOOD.
    wrong : relative error of every link in the model.
    path : whether the tool moves on a path of 20 cm at 0.25 Hz.
    """

    drone: str = 'drone.yaml'
    mass: float = 0.0
    law: str = GENERALISED
    wind: float = 1.5
    odometry: tuple[float, float, float, float] = GOOD
    wrong: float = 0.0
    path: bool = False
    gains: WorldGains = WorldGains()
    seed: int = 0


class Figures(NamedTuple):
    """RMS and maximum of the tool's error and of the drone's place [mm], least singular value."""

    tool: float
    tool_max: float
    drone: float
    drone_max: float
    least: float


class HoldingFlight:
    """Plant, sensors, pilot and the arm's control loop, cycle by cycle."""

    def __init__(self, flight: HeldFlight) -> None:
        self.flight = flight
        self.drone = drone = flown_drone(flight)
        self.robot = robot = load_robot(gravity_in_base=drone.gravity_in_base)
        parameters = PlantParameters.nominal(CONFIG, robot)
        random = np.random.default_rng(flight.seed)
        each = flight.wind / np.sqrt(3.0)
        gust = BandLimitedNoise(each, 0.5, CYCLE, random) if flight.wind else None
        self.plant = FlyingPlant(robot, parameters, POSTURE, drone, gust=gust)
        self.kinematics = Kinematics(robot)
        faulty = FaultyImu(1.0 / IMU_RATE, flight.seed, 0.05, 0.003, 0.05, 0.002)
        self.imu = DelayedSensor(lambda: faulty.apply(self.plant.imu), IMU_RATE, CYCLE, 4e-3)
        self.seen = self._odometry(GOOD, 1)
        self.told = self.seen if flight.odometry == GOOD else self._odometry(flight.odometry, 2)
        self.tell: Told = lambda sample: [sample]
        self.place = FlightTarget(np.zeros(3), 0.0)
        self._make_pilot()
        self._make_loop()
        self.effort = MovingBaseDynamics(robot, ROTORS).gravity(self.plant.position)
        self.now, self._cycle = 0.0, 0
        self.rows: list[Array] = []
        self.target: Array | None = None  # desired place of the tool
        self.rejected = ''
        self._commands: deque[tuple[int, Array]] = deque()

    def _odometry(
        self, quality: tuple[float, float, float, float], seed: int
    ) -> DelayedSensor[OdometryReading]:
        rate, delay, *noise = quality
        noisy = NoisyOdometry(10 * self.flight.seed + seed, (*noise, 0.0, 0.0))
        return DelayedSensor(lambda: noisy.apply(self.plant.odometry), rate, CYCLE, delay)

    def _make_pilot(self) -> None:
        drone = self.drone
        self._loads = ArmLoadModel(self.robot)
        composite = self._loads.dynamics.composite_inertia(np.array(POSTURE))
        body = MassProperties.of(drone, *composite)
        self.pilot = FlightControl(drone, body, FULL if drone.is_fully_actuated else COPLANAR)
        self._feed = ArmFeedForward(drone, body, lead=LEAD)
        self._sight = FlightEstimator(drone)

    def _make_loop(self) -> None:
        """Create the control loop as `world_control` does, without its ROS node."""
        flight, gains = self.flight, self.flight.gains
        robot = _with_errors(self.robot, flight.wrong) if flight.wrong else self.robot
        node = WorldControlNode.__new__(WorldControlNode)
        node.values = SimpleNamespace(**{p.name: p.default for p in WorldControlNode.parameters})
        vars(node.values).update(
            base_motion='attitude' if flight.law == HELD else 'free',
            imu_latency=4e-3,
            rotor_latency=LINK_DELAY * CYCLE,
            kp=gains.kp,
            kd=gains.kd,
            posture=list(POSTURE),
            rotor_share=0.0,
            mass_ratio_min=0.0,
        )
        node.arm = ControlledArm(CONFIG, robot, JointLimits.from_config(CONFIG), self.drone)
        node.base = node.arm.base(node.values)
        self.loop = node.make_loop()
        self.node, self.base, self.law = node, node.base, node.law
        self.pose, self.source = node.pose, node.reference

    def run(self, seconds: float) -> None:
        """Simulate for a time [s]."""
        for _ in range(round(seconds / CYCLE)):
            self._step()

    def tool(self) -> Array:
        """Return the place of the tool in the world (3,) [m]."""
        position, attitude, _, _ = self.plant.odometry
        mount = self.drone.mount
        place = mount.rotation @ self.kinematics.position(self.plant.position)
        return np.asarray(position + rotation_matrix(attitude) @ (mount.position + place))

    def figures(self, since: float = BEGIN) -> Figures:
        """Return the figures of the flight from a time [s] on."""
        rows = np.array(self.rows)
        rows = rows[rows[:, 0] >= since]
        tool = 1e3 * np.linalg.norm(rows[:, 4:7], axis=1)
        drone = 1e3 * np.linalg.norm(rows[:, 1:4], axis=1)
        tool_rms, drone_rms = (float(np.sqrt((x**2).mean())) for x in (tool, drone))
        return Figures(
            tool_rms, float(tool.max()), drone_rms, float(drone.max()), float(rows[:, 7].min())
        )

    def _step(self) -> None:
        now, stamp_ns = self.now, self._cycle * 1_000_000
        self._sense(now, stamp_ns)
        while self._commands and self._commands[0][0] <= self._cycle:
            self.plant.rotors.command(self._commands.popleft()[1])
        state = ArmState(self.plant.position, self.plant.velocity, self.effort)
        command = self.loop.update(state, now)
        if self._cycle % 5 == 0:
            self._note()
        self.plant.apply_effort(self.effort)
        self.plant.advance(CYCLE)
        if command is not None:
            assert command.tau is not None
            self.effort = command.tau  # acts from the next cycle on
        self.loop.observe()
        self._cycle += 1
        self.now = self._cycle * CYCLE

    def _sense(self, now: float, stamp_ns: int) -> None:
        imu, seen = self.imu.update(stamp_ns), self.seen.update(stamp_ns)
        told = seen if self.told is self.seen else self.told.update(stamp_ns)
        if imu is not None:
            attitude, rate, force = imu[1]
            sample = ImuSample(imu[0] * 1e-9, attitude, rate, force)
            self.node.take_imu(sample, now)
            self._sight.offer_imu(sample)
        if seen is not None:
            self._sight.offer_odometry(_sample(*seen))
        if told is not None and self.flight.law != HELD:
            for sent in self.tell(_sample(*told)):
                try:
                    self.pose.offer_odometry(sent, now)
                except RejectedInputError as error:
                    self.rejected = str(error)
        if imu is not None:
            self._fly(now)

    def _fly(self, now: float) -> None:
        q, still, ahead = self.plant.position, np.zeros(4), now + AHEAD
        load = self._loads.evaluate(JointReference(q, still, still))
        self._feed.offer_inertia(ahead, load.mass, load.com, load.inertia)
        self.node.state, self.node.stamp_ns = ArmState(q, still, still), round(1e9 * now)
        planned = self.node._ahead(np.array([now, ahead]))
        motion = JointReference(*(part[1] for part in planned))
        self._feed.offer_motion(ahead, self._loads.evaluate(motion).motion)
        state = self._sight.state()
        if state is None:
            return
        fed = self._feed.at(self._sight.stamp or now)
        thrust = self.pilot.update(state, self.place, 1.0 / IMU_RATE, fed)
        self._commands.append((self._cycle + LINK_DELAY, thrust))
        if isinstance(self.base, FreeBaseEstimator):
            self.base.rotors.offer(self.drone.rotor_names, thrust, now, now)

    def _note(self) -> None:
        target, tool = self.target, self.tool()
        if target is None:
            reference = self.source.reference
            target = tool if reference is None else reference.p
        place = self.plant.odometry[0]
        least = self.law.least_singular_value
        self.rows.append(np.concatenate([[self.now], place, tool - target, [least]]))


def flown_drone(flight: HeldFlight) -> DroneConfig:
    """Return the drone of a flight."""
    drone = load_drone_config(resource('config', flight.drone))
    if not flight.mass:
        return drone
    scale, arm = flight.mass / drone.mass, 1.49
    thrust = (flight.mass + arm) / (drone.mass + arm)
    rotors = tuple(replace(r, thrust_max=thrust * r.thrust_max) for r in drone.rotors)
    return replace(drone, rotors=rotors).with_errors(scale, scale ** (5.0 / 3.0))


def oval(centre: Array, seconds: float) -> WorldPath:
    """Return a path of 20 cm length at 0.25 Hz about a place, which grows over 2 s."""
    times = np.arange(0.0, seconds, 0.05)
    grown = np.minimum(times / 2.0, 1.0)
    share = grown**3 * (10.0 - 15.0 * grown + 6.0 * grown**2)
    swing = 0.1 * share * np.sin(0.5 * np.pi * times)
    return WorldPath(times, centre + np.outer(swing, [0.0, 1.0, 0.0]))


def fly(flight: HeldFlight, seconds: float) -> HoldingFlight:
    """Return a flight of some seconds; the tool is held from the second one on."""
    flown = HoldingFlight(flight)
    flown.run(SETTLED)
    if flight.law == HELD:
        flown.target = flown.tool()
    elif flight.path:
        goal = flown.source.goal
        assert goal is not None
        flown.source.follow(oval(goal, seconds), flown.now, flown.now)
    flown.run(seconds - SETTLED)
    return flown


def _sample(stamp_ns: int, reading: OdometryReading) -> OdometrySample:
    position, attitude, velocity, rate = reading
    return OdometrySample(stamp_ns * 1e-9, position, attitude, velocity, rate)


def _with_errors(robot: Robot, share: float, seed: int = 1) -> Robot:
    """Return an arm with a relative error in the model of every link."""
    draws, believed = np.random.default_rng(seed), []
    for link in robot.inertial_parameters:
        wrong = 1.0 + share * draws.choice([-1.0, 1.0], 5)
        inertia = wrong[4] * barycentric_inertia(link)
        centre = wrong[1:4] * link[1:4] / link[0]
        believed.append(parameters_of_body(wrong[0] * link[0], centre, inertia))
    friction = robot.viscous, robot.coulomb
    load = LoadFriction(robot.load_friction, *friction)
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'wrong.urdf'
        path.write_text(identified_urdf(robot, np.array(believed), *friction, load).text)
        return load_robot(path, gravity_in_base=robot.gravity_in_base)
