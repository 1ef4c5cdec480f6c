"""A drone as its arm's base sees it: in the axes of the base frame, about its origin."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.model.inertia import parameters_of_body

Array = npt.NDArray[np.float64]


def wrench_per_thrust(drone: DroneConfig) -> Array:
    """Return the wrench (6, m) of a drone's m rotors on the base, per N of thrust."""
    rotation = drone.mount.rotation.T
    force, moment = drone.allocation[:3], drone.allocation[3:]
    about_base = moment - np.cross(drone.mount.position, force, axisb=0, axisc=0)
    return np.vstack([rotation @ force, rotation @ about_base])


def carrier_parameters(drone: DroneConfig) -> Array:
    """Return a drone's inertial parameters (3.3), (10,), as `WholeBodyDynamics` wants them."""
    rotation = drone.mount.rotation.T
    centre = rotation @ (np.array(drone.centre_of_mass) - drone.mount.position)
    return parameters_of_body(drone.mass, centre, rotation @ drone.inertia_matrix @ rotation.T)
