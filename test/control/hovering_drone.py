"""A drone with its arm in the physics engine, hovering under a plain PID controller."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import ImuSample, Mount
from aerarm_ros.control.base.base_motion_estimator import BaseMotionEstimator
from aerarm_ros.control.base.feedback_check import OscillationWatch
from aerarm_ros.control.base.free_base_estimator import FREE, AnswerCorrection, FreeBaseEstimator
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.base.rotor_wrench import RotorWrench, carrier_parameters
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.computed_torque import ComputedTorque
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.inertia import cross
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import ArmState, JointReference
from aerarm_ros.simulation.arm_plant import ArmPlant, PlantParameters
from aerarm_ros.simulation.flying_plant import FlyingPlant, Rotors

Array = npt.NDArray[np.float64]

CYCLE = 1e-3
IMU_CYCLES = 4  # 250 Hz, the rate of the drone's controller
LINK_DELAY = 4e-3
CENTRE, PHASES = np.array([0.0, np.pi / 2, 0.0, 0.3]), np.array([0.0, 0.7, 1.4, 2.1])
SWINGS = {
    'slow': (np.array([0.5, 0.4, 0.5, 0.5]), np.array([0.2, 0.25, 0.3, 0.35])),
    'fast': (np.array([0.8, 0.5, 0.8, 0.7]), np.array([0.5, 0.6, 0.75, 0.9])),
}
BEGIN = 2.0  # [s] in which a swing grows from rest
CHEAP = {'force': 0.3, 'rate': 0.01, 'force_bias': 0.15, 'rate_bias': 0.01}

CONFIG = load_arm_config()
ROTORS = CONFIG.column('reflected_inertia')


def drone_of(mass: float) -> DroneConfig:
    """Return the packaged drone closest to a mass [kg], scaled to that mass with its density."""
    light = mass < 2.0
    path = resource('config', 'drones/quadrotor.yaml') if light else None
    drone = load_drone_config(path)
    scale = mass / drone.mass
    size = scale ** (1.0 / 3.0)
    rotors = tuple(
        replace(
            rotor,
            position=tuple(size * x for x in rotor.position),
            thrust_max=rotor.thrust_max * max(scale, 0.8),
        )
        for rotor in drone.rotors
    )
    inertia = tuple(scale * size**2 * x for x in drone.inertia)
    return replace(drone, mass=mass, inertia=inertia, rotors=rotors)


class SwingingReference:
    """A reference that swings about a hanging posture."""

    def __init__(self, kind: str) -> None:
        self._amplitude, frequency = SWINGS[kind]
        self._rate = 2.0 * np.pi * frequency

    def take_over(self, q: Array) -> None:
        """Start at the arm's present posture."""

    def update(self, q: Array, now: float, dt: float) -> JointReference:
        w, r = self._rate, min(now / BEGIN, 1.0)
        share = r**3 * (10.0 - 15.0 * r + 6.0 * r**2)
        slope = 30.0 * r**2 * (1.0 - r) ** 2 / BEGIN
        curve = 60.0 * r * (1.0 - r) * (1.0 - 2.0 * r) / BEGIN**2
        f = self._amplitude * np.sin(w * now + PHASES)
        df = self._amplitude * w * np.cos(w * now + PHASES)
        return JointReference(
            CENTRE + share * f,
            share * df + slope * f,
            curve * f + 2.0 * slope * df - share * w**2 * f,
        )


class Pilot:
    """A plain PID controller of a drone, with the posture of its arm at take-off."""

    def __init__(self, drone: DroneConfig, robot: Robot, q: Array) -> None:
        whole = WholeBodyDynamics(robot, ROTORS, carrier_parameters(drone))
        self._mass, com, inertia = whole.composite_inertia(q)
        rotation = drone.mount.rotation
        self._centre = np.array(drone.mount.position) + rotation @ com
        self._inertia = rotation @ inertia @ rotation.T
        self._mixer = np.linalg.pinv(drone.allocation)
        self._sums = np.zeros((2, 3))
        weight = np.array([0.0, 0.0, 9.81 * self._mass])
        self.hover = self._mixer @ np.concatenate([weight, np.cross(self._centre, weight)])

    def control(self, plant: FlyingPlant) -> Array:
        """Return the thrusts (n,) [N], at 250 Hz."""
        position, quaternion, velocity, turning = plant.odometry
        period, attitude = IMU_CYCLES * CYCLE, Rotation.from_quat(quaternion)
        self._sums[0] -= period * position
        wanted = -4.95 * position - 3.3 * attitude.apply(velocity) + 2.0 * self._sums[0]
        wanted = wanted + [0.0, 0.0, 9.81]
        z = wanted / np.linalg.norm(wanted)
        y = np.cross(z, [1.0, 0.0, 0.0])
        y /= np.linalg.norm(y)
        axes = Rotation.from_matrix(np.column_stack([np.cross(y, z), y, z]))
        error = (attitude.inv() * axes).as_rotvec()
        self._sums[1] += period * error
        force = np.array([0.0, 0.0, self._mass * (wanted @ attitude.apply([0.0, 0.0, 1.0]))])
        spin = 150.0 * error - 18.0 * turning + 300.0 * self._sums[1]
        moment = self._inertia @ spin + cross(self._centre, force)
        return np.asarray(self._mixer @ np.concatenate([force, moment]))


@dataclass
class FlightFaults:
    """Faults of a flight.

    Attributes
    ----------
    known : the drone in the model of the arm's controller; by default the true one.
    noise : of the IMU, as CHEAP.
    latency : of the IMU [s].
    commands : whether the arm's controller receives the rotor commands.
    load : payload that the last link picks up after half a second [kg].
    """

    known: DroneConfig | None = None
    noise: dict[str, float] | None = None
    latency: float = 0.0
    commands: bool = True
    load: float = 0.0


def make_estimator(
    mode: str, drone: DroneConfig, robot: Any
) -> BaseMotionEstimator | FreeBaseEstimator:
    mount = Mount.from_drone(drone)
    if mode != FREE:
        watch = OscillationWatch(CONFIG.column('effort_max'))
        return BaseMotionEstimator(drone.gravity_in_base, mode, mount, watch=watch)
    whole = WholeBodyDynamics(robot, ROTORS, carrier_parameters(drone))
    rotors = RotorWrench(drone, latency=LINK_DELAY)
    return FreeBaseEstimator(drone.gravity_in_base, rotors, whole, mount, AnswerCorrection())


def make_plant(
    drone: DroneConfig, robot: Robot, q: Array, thrust: Array | None
) -> ArmPlant | FlyingPlant:
    """Return the arm, under a drone that hovers with `thrust` (n,) [N] if given."""
    parameters = PlantParameters.nominal(CONFIG, robot).without_friction()
    plant = ArmPlant(robot, parameters, q)
    if thrust is not None:
        plant = FlyingPlant(robot, parameters, q, drone)
        plant.rotors = Rotors(drone, CYCLE, timeout=0.2)
        plant.rotors.command(thrust)
        plant.rotors.thrust[:] = thrust
        plant.let_go()
    plant._model.opt.timestep = CYCLE
    return plant


def noisy(
    force: Array, rate: Array, noise: dict[str, float], draws: Array, biases: Array
) -> tuple[Array, Array]:
    """Return an IMU's readings with noise and biases."""
    return (
        force + noise['force'] * draws[:3] + noise['force_bias'] * biases[:3],
        rate + noise['rate'] * draws[3:] + noise['rate_bias'] * biases[3:],
    )


def fly(
    drone: DroneConfig,
    kind: str,
    mode: str,
    seconds: float,
    flight: FlightFaults | None = None,
    make_law: Any = None,
    observer: Any = None,
    make_base: Any = make_estimator,
) -> Array:
    """Return the joints' errors (M, n) [rad] of a flight, one row per cycle.

    Mode 'fixed' attaches the arm to a fixed base.
    """
    flight = flight or FlightFaults()
    known = flight.known or drone
    robot = load_robot(gravity_in_base=drone.gravity_in_base)
    source = SwingingReference(kind)
    start = source.update(CENTRE, 0.0, CYCLE).q
    pilot = Pilot(drone, robot, start)
    plant = make_plant(drone, robot, start, None if mode == 'fixed' else pilot.hover)
    base = make_base('none' if mode == 'fixed' else mode, known, robot)
    dynamics = MovingBaseDynamics(robot, ROTORS, carrier_parameters(known))
    law = make_law(dynamics) if make_law else ComputedTorque(dynamics, 400.0, 40.0)
    loop = ControlLoop(
        JointLimits.from_config(CONFIG),
        source,
        law,
        observer(dynamics) if observer else None,
        base,
        0.5 * CONFIG.column('effort_max') if observer else 0.0,
    )
    random = np.random.default_rng(0)
    biases = random.normal(size=6)
    samples: list[tuple[float, ImuSample]] = []
    commands: list[tuple[float, Array]] = []
    effort = dynamics.gravity(start)
    errors = []
    for cycle in range(round(seconds / CYCLE)):
        now = cycle * CYCLE
        if cycle == round(0.5 / CYCLE):
            plant._model.body_mass[-1] += flight.load
        if isinstance(plant, FlyingPlant) and cycle % IMU_CYCLES == 0:
            attitude, rate, force = plant.imu
            if flight.noise:
                force, rate = noisy(force, rate, flight.noise, random.normal(size=6), biases)
            samples.append((now + flight.latency, ImuSample(now, attitude, rate, force)))
            thrust = pilot.control(plant)
            commands.append((now + LINK_DELAY, thrust))
            if flight.commands and isinstance(base, FreeBaseEstimator):
                base.rotors.offer(drone.rotor_names, thrust, now, now)
        while samples and samples[0][0] <= now + 1e-9:
            base.offer(samples.pop(0)[1], now)
        while commands and commands[0][0] <= now + 1e-9:
            plant.rotors.command(commands.pop(0)[1])
        q, dq = plant.position, plant.velocity
        answer = loop.update(ArmState(q, dq, effort), now)
        errors.append(source.update(q, now, CYCLE).q - q)
        plant.apply_effort(effort)  # a command acts from the next cycle on
        plant.step()
        if answer is not None:
            assert answer.tau is not None
            effort = answer.tau
        loop.observe()
    return np.array(errors)


def rms(errors: Array, since: float) -> float:
    """Return the root mean square from a time [s] on, over all joints [rad]."""
    return float(np.sqrt((errors[round(since / CYCLE) :] ** 2).mean()))
