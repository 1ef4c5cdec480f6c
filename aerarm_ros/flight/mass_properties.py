"""What the rotors have to carry."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.model.inertia import joined

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass of drone and arm in one posture.

    Attributes
    ----------
    mass : float
        [kg]
    centre : (3,) ndarray
        Centre of mass in the body frame [m].
    inertia : (3, 3) ndarray
        About the centre of mass in body axes [kg m^2].
    """

    mass: float
    centre: Array
    inertia: Array

    @classmethod
    def of(
        cls, drone: DroneConfig, arm_mass: float, arm_centre: Array, arm_inertia: Array
    ) -> 'MassProperties':
        """Return those of a drone with an arm.

        Parameters
        ----------
        drone : DroneConfig
        arm_mass : float
            [kg]
        arm_centre : (3,) ndarray
            In the arm's base frame [m].
        arm_inertia : (3, 3) ndarray
            About that, in the base frame's axes [kg m^2].
        """
        rotation, mount = drone.mount.rotation, np.array(drone.mount.position)
        body = drone.mass, np.array(drone.centre_of_mass), drone.inertia_matrix
        arm = arm_mass, mount + rotation @ arm_centre, rotation @ arm_inertia @ rotation.T
        return cls(*joined(body, arm))
