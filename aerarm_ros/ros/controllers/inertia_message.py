"""A body as geometry_msgs/InertiaStamped."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import InertiaStamped
from std_msgs.msg import Header

from aerarm_ros.model.inertia import checked_body, parameters_of_body

Array = npt.NDArray[np.float64]


def inertia_message(header: Header, mass: float, centre: Array, inertia: Array) -> InertiaStamped:
    """Return the message of a body.

    Parameters
    ----------
    header : Header
        Its frame is that of centre and axes.
    mass : float
        [kg]
    centre : (3,) ndarray
        [m]
    inertia : (3, 3) ndarray
        About the centre [kg m^2].
    """
    message = InertiaStamped(header=header)
    body, tensor = message.inertia, inertia.tolist()
    body.m = float(mass)
    body.com.x, body.com.y, body.com.z = centre.tolist()
    body.ixx, body.ixy, body.ixz = tensor[0]
    body.iyy, body.iyz, body.izz = tensor[1][1], tensor[1][2], tensor[2][2]
    return message


def body_of_message(message: InertiaStamped) -> Array:
    """Return the inertial parameters (10,) of a message's body, in its frame; raises ValueError."""
    body = message.inertia
    centre = [body.com.x, body.com.y, body.com.z]
    tensor = [
        [body.ixx, body.ixy, body.ixz],
        [body.ixy, body.iyy, body.iyz],
        [body.ixz, body.iyz, body.izz],
    ]
    return checked_body('payload', parameters_of_body(body.m, centre, tensor))
