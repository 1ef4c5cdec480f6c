"""Conversion between fields of ROS messages and arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import InertiaStamped, WrenchStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from aerarm_ros.model.inertia import checked_body, parameters_of_body
from aerarm_ros.motion.signals import Array


def seconds(time: Any) -> float:
    """Return a Time or Duration of a message in seconds."""
    return float(time.sec + 1e-9 * time.nanosec)


def vector(part: Any) -> Array:
    """Return the fields x, y, z of a message as an array (3,)."""
    return np.array([part.x, part.y, part.z])


def quaternion(part: Any) -> Array:
    """Return the quaternion (x, y, z, w) of a message as an array (4,)."""
    return np.array([part.x, part.y, part.z, part.w])


def wrench(message: WrenchStamped) -> Array:
    """Return force [N] and moment [Nm] of a message as one array (6,)."""
    return np.concatenate([vector(message.wrench.force), vector(message.wrench.torque)])


def fill(part: Any, values: Array) -> None:
    """Copy a vector (3,) or a quaternion (4,) to the fields x, y, z and w of a message."""
    for name, value in zip('xyzw', values.tolist(), strict=False):
        setattr(part, name, value)


def wrench_message(header: Header, wrench: Array) -> WrenchStamped:
    """Return a message with force [N] and moment [Nm], given as one array (6,)."""
    message = WrenchStamped(header=header)
    fill(message.wrench.force, wrench[:3])
    fill(message.wrench.torque, wrench[3:])
    return message


def imu_message(header: Header, attitude: Array | None, rate: Array, force: Array) -> Imu:
    """Return a message with attitude (4,), angular velocity (3,) and specific force (3,).

    Without an attitude the message states that it contains none.
    """
    message = Imu(header=header)
    if attitude is None:
        message.orientation_covariance[0] = -1.0
    else:
        fill(message.orientation, attitude)
    fill(message.angular_velocity, rate)
    fill(message.linear_acceleration, force)
    return message


def odometry_message(
    header: Header, body: str, position: Array, attitude: Array, velocity: Array, rate: Array
) -> Odometry:
    """Return a message with pose and twist; the twist is in the axes of the frame `body`."""
    message = Odometry(header=header, child_frame_id=body)
    fill(message.pose.pose.position, position)
    fill(message.pose.pose.orientation, attitude)
    fill(message.twist.twist.linear, velocity)
    fill(message.twist.twist.angular, rate)
    return message


def inertia_message(header: Header, mass: float, centre: Array, inertia: Array) -> InertiaStamped:
    """Return a message with mass, centre of mass and inertia of a body.

    Parameters
    ----------
    header : Header
        Header with the frame of centre and axes.
    mass : float
        Mass of the body [kg].
    centre : (3,) ndarray
        Centre of mass [m].
    inertia : (3, 3) ndarray
        Inertia about the centre of mass [kg m^2].
    """
    message = InertiaStamped(header=header)
    body, tensor = message.inertia, inertia.tolist()
    body.m = float(mass)
    fill(body.com, centre)
    body.ixx, body.ixy, body.ixz = tensor[0]
    body.iyy, body.iyz, body.izz = tensor[1][1], tensor[1][2], tensor[2][2]
    return message


def inertia_tensor(message: InertiaStamped) -> Array:
    """Return the inertia (3, 3) [kg m^2] about the centre of mass of the body in a message."""
    i = message.inertia
    return np.array([[i.ixx, i.ixy, i.ixz], [i.ixy, i.iyy, i.iyz], [i.ixz, i.iyz, i.izz]])


def body_of_message(message: InertiaStamped) -> Array:
    """Return the inertial parameters (10,) of the body in a message; raises ValueError."""
    mass, centre = message.inertia.m, vector(message.inertia.com)
    body = parameters_of_body(mass, centre, inertia_tensor(message))
    return checked_body('payload', body)
