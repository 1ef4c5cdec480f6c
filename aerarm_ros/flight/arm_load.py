"""What the arm adds to its drone, in a form that may be fed forward."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.mass_properties import MassProperties
from aerarm_ros.model.cross_product import cross

Array = npt.NDArray[np.float64]


class ArmLoad(NamedTuple):
    """Mass properties of the arm and its wrenches on the drone, at one instant.

    Nothing in it is measured by the drone's IMU: posture and motion of the joints are all it
    depends on, so no loop is closed by feeding it forward. In the base frame's axes, moments about
    its origin, force before moment.

    Attributes
    ----------
    mass : float
        [kg]
    com : (3,) ndarray
        [m]
    inertia : (3, 3) ndarray
        About the centre of mass [kg m^2].
    weight : (6,) ndarray
        What a hovering drone carries: the weight along the thrust, however the drone leans. A
        drone with rotors in one plane accelerates along its thrust, and that is what the arm feels.
    motion : (6,) ndarray
        What the joints' own motion does, `-(M_bj ddq + c_b)` of `WholeBodyDynamics`.
    """

    mass: float
    com: Array
    inertia: Array
    weight: Array
    motion: Array

    def acceleration(self, drone: DroneConfig) -> Array:
        """Return the acceleration (6,) that rotors must add so that the arm's motion moves nothing.

        Of the arm's base origin [m/s^2], then angular [rad/s^2], in base axes: `motion` taken
        back, over the inertia of drone and arm in this posture.
        """
        body = MassProperties.of(drone, self.mass, self.com, self.inertia)
        rotation, mount = drone.mount.rotation, np.array(drone.mount.position)
        lever = rotation.T @ (mount - body.centre)  # from the centre of mass to the base
        inertia = rotation.T @ body.inertia @ rotation
        force, moment = -self.motion[:3], -self.motion[3:]
        spin = np.linalg.solve(inertia, moment + cross(lever, force))
        return np.concatenate([force / body.mass + cross(spin, lever), spin])


def at_drone_centre(acceleration: Array, drone: DroneConfig) -> Array:
    """Return an acceleration (6,) of the arm's base as that of the drone's centre of mass.

    In the drone's body axes; the body turns slowly enough that nothing but the angular
    acceleration counts between the two places.
    """
    rotation = drone.mount.rotation
    linear, spin = rotation @ acceleration[:3], rotation @ acceleration[3:]
    lever = np.array(drone.centre_of_mass) - drone.mount.position
    return np.concatenate([linear + cross(spin, lever), spin])
