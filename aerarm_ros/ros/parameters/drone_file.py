"""The parameter that names the drone, and the drone it describes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.robot import Robot
from aerarm_ros.ros.parameters.parameter import Parameter

DRONE_FILE = Parameter(
    'drone_file', '', 'YAML file of the drone that carries the arm, or a packaged one by its name '
    'from any folder, as config/drone.yaml; none if empty', group='Which arm'
)  # fmt: skip


def load_drone(values: SimpleNamespace, config: ArmConfig, robot: Robot) -> DroneConfig | None:
    """Return the drone that the value of `DRONE_FILE` names, None if that is empty.

    Raises
    ------
    ValueError
        If the file cannot be read or used, or the drone cannot lift this arm; the message says
        what to check.
    """
    if not values.drone_file:
        return None
    drone = load_drone_config(values.drone_file)
    mass, centre, _ = MovingBaseDynamics(robot).composite_inertia(np.array(config.rest_position))
    drone.check_carries(mass, centre)
    return drone
