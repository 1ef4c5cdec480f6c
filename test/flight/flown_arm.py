"""A drone with its arm on the physics engine, and its flight controller."""

from collections.abc import Callable

import numpy as np

from aerarm_ros.control.base.base_motion import rotation_matrix
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmFeedForward, MassProperties
from aerarm_ros.flight.flight_control import FlightControl
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.flying_plant import FlyingPlant

Reference = Callable[[float], tuple[np.ndarray, np.ndarray]]

HANGING = np.array([0.0, np.pi / 2, 0.0, 0.0])
ROBOT = load_robot(gravity_in_base=[0.0, 0.0, 9.81])
ARM = MovingBaseDynamics(ROBOT)
PLANT = PlantParameters.nominal(load_arm_config(), ROBOT)
STIFF, DAMPED = np.array([200.0, 200.0, 100.0, 100.0]), np.array([12.0, 12.0, 5.0, 5.0])


def body(drone: DroneConfig) -> MassProperties:
    """Return the mass properties of drone and hanging arm."""
    return MassProperties.of(drone, *ARM.composite_inertia(HANGING))


class Flight:
    """Drone and arm in steps of 4 ms, under a controller with the model of a drone file."""

    def __init__(self, drone: DroneConfig, believed: DroneConfig | None = None) -> None:
        self.plant = FlyingPlant(ROBOT, PLANT, HANGING, drone)
        believed = drone if believed is None else believed
        self.body = body(believed)
        self.control = FlightControl(believed, self.body)
        self.target = FlightTarget(np.zeros(3), 0.0)
        self.arm: ArmFeedForward | None = None
        self.time = 0.0
        self.thrust = np.zeros(drone.n)

    @property
    def state(self) -> FlightState:
        position, attitude, velocity, rate = self.plant.odometry
        rotation = rotation_matrix(attitude)
        return FlightState(position, rotation @ velocity, rotation, rate)

    @property
    def tilt(self) -> float:
        return float(np.arccos(min(1.0, self.state.rotation[2, 2])))

    def step(self, reference: Reference | None = None) -> None:
        """Fly for 4 ms, with stiff springs that hold the arm or move it along q(t), dq(t)."""
        arm = None if self.arm is None else self.arm.at(self.time)
        self.thrust = self.control.update(self.state, self.target, 0.004, arm)
        self.plant.rotors.command(self.thrust)
        self.hold_arm(reference)

    def hold_arm(self, reference: Reference | None = None) -> None:
        plant = self.plant
        for _ in range(2):
            wanted, speed = (HANGING, 0.0) if reference is None else reference(self.time)
            spring = STIFF * (wanted - plant.position) + DAMPED * (speed - plant.velocity)
            plant.apply_effort(spring + ARM.gravity(plant.position))
            plant.advance(2e-3)
            self.time += 2e-3
