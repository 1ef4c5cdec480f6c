"""An arm that swings under its drone in the physics engine, and picks up a payload in flight."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from aerarm_ros.control.base.base_motion import ImuSample, rotation_matrix
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import MassProperties
from aerarm_ros.flight.flight_control import FlightControl
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.flying_plant import FlyingPlant

CYCLE = 1e-3
_IMU_CYCLES = 4  # 250 Hz, the rate of the drone's controller
_HANGING = np.array([0.0, np.pi / 2, 0.0, 0.0])
_SWING = np.array([0.5, 0.6, 0.6, 0.7])
_FREQUENCY = np.array([0.4, 0.5, 0.65, 0.8])  # [Hz]
_GROWN = 1.0  # [s]
_STIFF, _DAMPED = np.array([200.0, 200.0, 100.0, 100.0]), np.array([12.0, 12.0, 5.0, 5.0])
_COUNT = 2.0 * np.pi / 4096 / 27  # [rad] of an encoder, at the joint
_TORQUE_NOISE = 0.01  # [Nm]


@dataclass
class FlyingRun:
    """A flight.

    Attributes
    ----------
    load : mass [kg] and centre [m] of the payload.
    pick_up, put_down, end : times [s].
    silent : time after which the IMU sends no data [s].
    noise : of the IMU's force [m/s^2] and rate [rad/s].
    seed : of the noise.
    """

    load: tuple[float, float, float, float] = (0.2, 0.1, 0.01, -0.02)
    pick_up: float = 2.2
    put_down: float = 100.0
    end: float = 4.6
    silent: float = 100.0
    noise: tuple[float, float] = (0.1, 0.003)
    seed: int = 0

    def __post_init__(self) -> None:
        self.drone = load_drone_config()
        self.robot = load_robot(gravity_in_base=self.drone.gravity_in_base)
        self.truth = PlantParameters.nominal(load_arm_config(), self.robot)

    def states(
        self, offer: Callable[[ImuSample, float], None], epoch: float = 0.0
    ) -> Iterator[tuple[float, ArmState]]:
        """Offer every IMU sample at its arrival, and yield time and state of each cycle."""
        random, drone = np.random.default_rng(self.seed), self.drone
        plant = FlyingPlant(self.robot, self.truth, _HANGING, drone)
        arm = MovingBaseDynamics(self.robot)
        pilot = FlightControl(drone, MassProperties.of(drone, *arm.composite_inertia(_HANGING)))
        loaded = self.truth.carrying(self.load[0], self.load[1:], 0.03)
        for cycle in range(round(self.end / CYCLE)):
            now = CYCLE * cycle
            if cycle == round(self.pick_up / CYCLE):
                plant.grasp(loaded)
            elif cycle == round(self.put_down / CYCLE):
                plant.grasp(self.truth)
            if cycle % _IMU_CYCLES == 0:
                position, attitude, velocity, rate = plant.odometry
                rotation = rotation_matrix(attitude)
                state = FlightState(position, rotation @ velocity, rotation, rate)
                thrust = pilot.update(state, FlightTarget(np.zeros(3), 0.0), _IMU_CYCLES * CYCLE)
                plant.rotors.command(thrust)
                if now < self.silent:
                    turn, spin, force = plant.imu
                    force = force + self.noise[0] * random.normal(size=3)
                    spin = spin + self.noise[1] * random.normal(size=3)
                    offer(ImuSample(epoch + now, turn, spin, force), epoch + now)
            wanted, speed = _swing(now)
            q, dq = plant.position, plant.velocity
            effort = _STIFF * (wanted - q) + _DAMPED * (speed - dq) + arm.gravity(q)
            plant.apply_effort(effort)
            plant.advance(CYCLE)
            q = _COUNT * np.round(plant.position / _COUNT)
            tau = effort + _TORQUE_NOISE * random.normal(size=4)
            yield now + CYCLE, ArmState(q, plant.velocity, tau)


def _swing(time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the arm's q and dq, growing from rest."""
    s = min(1.0, time / _GROWN)
    grown, rate = s * s * (3.0 - 2.0 * s), 2.0 * np.pi * _FREQUENCY
    return (
        _HANGING + grown * _SWING * np.sin(rate * time),
        grown * _SWING * rate * np.cos(rate * time),
    )
