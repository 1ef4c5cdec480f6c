"""The drone that a node flies or advises, with its arm."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.mass_properties import MassProperties
from aerarm_ros.ros.parameters.arm_files import load_arm
from aerarm_ros.ros.parameters.drone_file import load_drone


def load_flown_drone(values: SimpleNamespace) -> tuple[ArmConfig, DroneConfig, MassProperties]:
    """Return the arm, the drone, and both as one body with the arm at rest.

    Parameters
    ----------
    values
        Of `ARM_FILES` and `DRONE_FILE`.

    Raises
    ------
    ValueError
        If no drone is named, or a file can't be used.
    """
    config, robot = load_arm(values)
    drone = load_drone(values, config, robot)
    if drone is None:
        raise ValueError('parameter drone_file is empty: name the drone, as config/drone.yaml')
    arm = MovingBaseDynamics(robot).composite_inertia(np.array(config.rest_position))
    return config, drone, MassProperties.of(drone, *arm)
