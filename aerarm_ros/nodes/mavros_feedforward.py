"""Adds to MAVROS's set points the acceleration that the arm's motion takes.

`setpoint_raw/local` in, as it would go to /mavros/setpoint_raw/local, and out there, a hundred
times a second; mavros_msgs has to be installed. The weight is left to the autopilot.
"""

import copy
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Imu

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.ros.flight.set_point_node import SetPointNode, set_point_parameters
from aerarm_ros.ros.process.node_main import run_node

NAME = 'mavros_feedforward'
PARAMETERS = set_point_parameters(
    'setpoint_raw/local', '/mavros/setpoint_raw/local', '/mavros/imu/data'
)

# Of mavros_msgs/PositionTarget.
_LOCAL_FRAMES = (1, 7)
_IGNORE_ACCELERATION = 64 + 128 + 256
_IS_FORCE = 512


class MavrosFeedforward(SetPointNode):
    """In ROS's frames; MAVROS turns them."""

    def __init__(self) -> None:
        advice = 'install it (apt: ros-jazzy-mavros-msgs), or use px4_feedforward'
        super().__init__(NAME, PARAMETERS, 'mavros_msgs', advice)

    def message_types(self) -> tuple[Any, Any]:
        """Return MAVROS's set point and the IMU's sample."""
        from mavros_msgs.msg import PositionTarget

        return PositionTarget, Imu

    def attitude(self, message: Any) -> NDArray[np.float64]:
        """Return the attitude of an Imu."""
        q = message.orientation
        return np.array([q.x, q.y, q.z, q.w])

    def with_acceleration(
        self, set_point: Any, acceleration: NDArray[np.float64], now_ns: int
    ) -> Any:
        """Return a PositionTarget with an acceleration added; raises RejectedInputError."""
        return add_acceleration(set_point, acceleration, now_ns)


def add_acceleration(set_point: Any, acceleration: NDArray[np.float64], now_ns: int) -> Any:
    """Return a PositionTarget with an acceleration (3,), east-north-up, added [m/s^2].

    Raises
    ------
    RejectedInputError
        If it is in the body's axes, or asks for a force.
    """
    if set_point.coordinate_frame not in _LOCAL_FRAMES:
        raise RejectedInputError(
            'set point rejected: only FRAME_LOCAL_NED and FRAME_LOCAL_OFFSET_NED accept an '
            'acceleration'
        )
    if set_point.type_mask & _IS_FORCE:
        raise RejectedInputError('set point rejected: it sets a force, not an acceleration')
    added = copy.deepcopy(set_point)
    wanted = added.acceleration_or_force
    if set_point.type_mask & _IGNORE_ACCELERATION:
        wanted.x = wanted.y = wanted.z = 0.0
    x, y, z = acceleration.tolist()
    wanted.x, wanted.y, wanted.z = wanted.x + x, wanted.y + y, wanted.z + z
    added.type_mask = set_point.type_mask & ~_IGNORE_ACCELERATION
    added.header.stamp.sec, added.header.stamp.nanosec = divmod(now_ns, 10**9)
    return added


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, MavrosFeedforward, args, PARAMETERS, __doc__)


if __name__ == '__main__':
    sys.exit(main())
