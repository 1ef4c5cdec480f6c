"""Drone whose arm follows its motion exactly, a fast model for tuning flight controllers."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from flying.arm_swing import HANGING
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.rotor_wrench import carrier_parameters, wrench_per_thrust
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmFeedForward, ArmLoadModel, MassProperties
from aerarm_ros.flight.flight_control import FlightControl
from aerarm_ros.flight.flight_state import FlightState, FlightTarget, yaw_of
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import JointMotion, JointReference

CYCLE = 4e-3  # [s] of the flight controller
STEPS = 2  # physics steps per cycle
AHEAD = 0.06  # [s] preview time of the arm's motion
SETTLED = 0.5  # [s] after which errors are evaluated
LOST = 2.0  # [m]
# noise of position [m], velocity [m/s], rate [rad/s], force [m/s^2]
NOISE = (0.002, 0.01, 0.01, 0.3)


def _powers(turn: np.ndarray) -> np.ndarray:
    """Return the vector of 1, the components of a vector (3,), and their products."""
    x, y, z = turn
    return np.array([1.0, x, y, z, x * x, y * y, z * z, y * z, z * x, x * y])


_TURNS = np.vstack([np.zeros(3), np.eye(3), -np.eye(3), 1.0 - np.eye(3)])
_POWERS = np.array([_powers(turn) for turn in _TURNS])


class FlightErrors(NamedTuple):
    """Position and tilt errors of a flight, RMS and maximum [mm], [deg].

    `heading_max` is the largest rotation about the vertical [deg].
    """

    position: float
    position_max: float
    tilt: float
    tilt_max: float
    heading_max: float


class RigidFlight:
    """Drone and arm as one chain with prescribed joint motion, and rotors with a lag.

    Parameters
    ----------
    drone : DroneConfig
        Configuration of the drone.
    motion : JointMotion
        Motion of the arm.
    latency : int
        Delay of the controller's measurements in cycles.
    seed : int
        Seed of the noise.
    carried : (10,) array_like, optional
        Inertial parameters of a payload that the flight controller does not know.

    Attributes
    ----------
    flown : float
        Fraction of the last flight completed before the drone was lost.
    """

    def __init__(
        self,
        drone: DroneConfig,
        motion: JointMotion,
        latency: int = 2,
        seed: int = 0,
        carried: npt.ArrayLike = (0.0,) * 10,
    ) -> None:
        self.drone, self._latency = drone, latency
        self._robot = load_robot(gravity_in_base=drone.gravity_in_base)
        self._whole = WholeBodyDynamics(self._robot, carrier=carrier_parameters(drone))
        self._whole.carry(carried)
        self._loads = ArmLoadModel(self._robot)
        self._seed = seed
        self._step = CYCLE / STEPS
        times = np.arange(0.0, motion.duration + 2 * AHEAD, self._step)
        rows = [JointReference(*row) for row in zip(*motion.evaluate(times), strict=True)]
        self._told = [self._loads.evaluate(reference) for reference in rows[::STEPS]]
        self._answers = [self._whole.response(row.q)[0] for row in rows]
        self._forces = [self._forces_by_turn(row) for row in rows]
        self._count = round(motion.duration / CYCLE)
        self.body = MassProperties.of(drone, *self._loads.dynamics.composite_inertia(HANGING))

    def _forces_by_turn(self, reference: JointReference) -> np.ndarray:
        """Return forces (6, 10) by powers of the base's angular velocity."""
        forces = [self._whole.forces(*reference, turn)[:6] for turn in _TURNS]
        return np.linalg.solve(_POWERS, np.array(forces)).T

    def fly(self, control: FlightControl, arm: ArmFeedForward | None) -> FlightErrors | None:
        """Return the errors of a flight with a controller, None if the drone is lost."""
        drone, random = self.drone, np.random.default_rng(self._seed)
        mount, to_base = np.array(drone.mount.position), drone.mount.rotation
        matrix, imu = wrench_per_thrust(drone), np.array(drone.imu.position)
        gain = 1.0 - np.exp(-self._step / drone.column('time_constant'))
        low, high = drone.column('thrust_min'), drone.column('thrust_max')
        target = FlightTarget(np.zeros(3), 0.0)
        rotation, rate = np.eye(3), np.zeros(3)
        place, velocity = mount.copy(), np.zeros(3)  # of the arm's base
        thrust = np.linalg.pinv(drone.allocation) @ _hover(self.body)
        felt = np.array([0.0, 0.0, GRAVITY])
        states: list[FlightState] = []
        errors = []
        for cycle in range(self._count):
            noise = random.normal(size=(4, 3)) * np.array(NOISE)[:, np.newaxis]
            position = place - rotation @ mount
            speed = velocity - rotation @ np.cross(rate, mount)
            states.append(
                FlightState(
                    position + noise[0], speed + noise[1], rotation, rate + noise[2],
                    felt + noise[3],
                )
            )  # fmt: skip
            now = cycle * CYCLE
            if arm is not None:
                for ahead in (cycle + round(AHEAD / CYCLE),) if cycle else range(16):
                    told, stamp = self._told[ahead], ahead * CYCLE
                    arm.offer_inertia(stamp, told.mass, told.com, told.inertia)
                    arm.offer_motion(stamp, told.motion)
            state = states[max(0, cycle - self._latency)]
            wanted = control.update(state, target, CYCLE, None if arm is None else arm.at(now))
            wanted = np.clip(wanted, low, high)
            for step in range(STEPS):
                thrust = thrust + gain * (wanted - thrust)
                number = cycle * STEPS + step
                forces = self._forces[number] @ _powers(to_base.T @ rate)
                answer = self._answers[number] @ (matrix @ thrust - forces)
                force, spin = to_base @ answer[:3], to_base @ answer[3:]
                velocity = velocity + self._step * (rotation @ force - [0.0, 0.0, GRAVITY])
                rate = rate + self._step * spin
                place = place + self._step * velocity
                rotation = rotation @ Rotation.from_rotvec(self._step * rate).as_matrix()
            lever = imu - mount
            felt = force + np.cross(spin, lever) + np.cross(rate, np.cross(rate, lever))
            self.flown = (cycle + 1) / self._count
            if np.abs(position).max() > LOST:
                return None
            if now > SETTLED:
                tilt = np.degrees(np.arccos(min(1.0, rotation[2, 2])))
                heading = np.degrees(abs(yaw_of(rotation)))
                errors.append((1e3 * float(np.linalg.norm(position)), float(tilt), heading))
        rows = np.array(errors)
        rms, largest = np.sqrt((rows**2).mean(axis=0)), rows.max(axis=0)
        return FlightErrors(rms[0], largest[0], rms[1], largest[1], largest[2])


def _hover(body: MassProperties) -> np.ndarray:
    """Return the wrench (6,) that holds drone and arm level."""
    force = np.array([0.0, 0.0, body.mass * GRAVITY])
    return np.concatenate([force, np.cross(body.centre, force)])
