"""What the joints carry and move, as far as the bridge knows the arm."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.gravity_load import largest_gravity_load
from aerarm_ros.model.inertia import point_mass

Array = npt.NDArray[np.float64]

_POSTURES = 500
# Of the torque beyond the largest load, this share is relied on for braking: the arm that was
# built is not the one that was drawn, and other joints' motion pulls at it. Joint 1 at full speed
# throws the arm outward with 4 Nm where joint 2 has passed 45 degrees.
_RELIABLE_SHARE = 0.5

# A damped arm falls at this share of the velocity limits at most, and is slowed to it within a time
# [s] that is short beside the fall from upright to a limit.
_FALLING_SHARE = 0.4
_DAMPING_TIME = 0.2


class JointLoads:
    """Loads and inertias of n joints, with half the rated payload: the error is then the smallest.

    Parameters
    ----------
    config
        Drives, limits and the rated payload.
    robot
        The arm as drawn.

    Attributes
    ----------
    load_max
        (n,) largest torque of gravity with the rated payload, however the base turns [Nm].
    inertia_max
        (n,) largest inertia with the rated payload [kg m^2].
    deceleration
        (n,) that can be relied on with any payload up to the rated one [rad/s^2]: the
        configuration's acceleration limit, or what the drive's torque leaves beyond the load.

    damping_min
        (n,) damping with which a stretched-out arm that is let go, the rated payload in its hand,
        falls at 0.4 of the velocity limit at most and comes to its speed in 0.2 s [Nms/rad].

    Raises
    ------
    ValueError
        If configuration and robot are not of one arm, or a drive cannot hold the arm.
    """

    def __init__(self, config: ArmConfig, robot: Robot) -> None:
        if config.joint_names != robot.joint_names:
            raise ValueError(
                f'the configuration has joints {config.joint_names}, the URDF {robot.joint_names}: '
                'give both for the same arm'
            )
        inertia = config.column('reflected_inertia')
        mass, *centre = config.rated_payload
        payload = point_mass(mass, centre)
        self._dynamics = Dynamics(robot, inertia)
        self._dynamics.carry(0.5 * payload)
        loaded = np.array(robot.inertial_parameters)
        loaded[-1] += payload
        whole = robot.with_inertial_parameters(loaded)
        self.load_max = largest_gravity_load(whole)
        self.inertia_max = _largest_inertia(whole, inertia)
        effort_max = config.column('effort_max')
        self._velocity_max = config.column('velocity_max')
        for joint, load in zip(config.joints, self.load_max.tolist(), strict=True):
            if joint.effort_max <= load:
                raise ValueError(
                    f'joint {joint.name}: effort_max = {joint.effort_max:g} Nm does not hold the '
                    f'arm stretched out with its rated payload, {load:.2f} Nm: check effort_max, '
                    'rated_payload and the URDF'
                )
        spare = _RELIABLE_SHARE * (effort_max - self.load_max) / self.inertia_max
        self.deceleration: Array = np.minimum(config.column('acceleration_max'), spare)

    @property
    def damping_min(self) -> Array:
        """Least damping of each joint (n,) [Nms/rad]; see the class."""
        falling = self.load_max / (_FALLING_SHARE * self._velocity_max)
        least: Array = np.maximum(falling, self.inertia_max / _DAMPING_TIME)
        return least

    def at(self, q: Array, dq: Array, effort: Array) -> tuple[list[float], list[float]]:
        """Return loads [Nm] and inertias [kg m^2], a joint each.

        The load is what the arm's weight, its speed and the acceleration of the other joints
        take of the torque.

        Parameters
        ----------
        q, dq, effort
            (n,) positions [rad], velocities [rad/s] and the torques that act [Nm].
        """
        acceleration = self._dynamics.forward(q, dq, effort)
        inertias = self._dynamics.inertia_matrix(q).diagonal()
        return (effort - inertias * acceleration).tolist(), inertias.tolist()


def _largest_inertia(robot: Robot, rotor_inertia: Array) -> Array:
    dynamics = Dynamics(robot, rotor_inertia)
    random = np.random.default_rng(0)
    postures = random.uniform(*robot.posture_range, (_POSTURES, robot.n))
    inertias = [dynamics.inertia_matrix(q).diagonal() for q in postures]
    largest: Array = np.max(inertias, axis=0)
    return largest
