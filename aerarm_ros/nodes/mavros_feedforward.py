"""Add the acceleration that compensates the arm's motion to the set points for MAVROS.

The node subscribes to `setpoint_raw/local` and publishes on /mavros/setpoint_raw/local at 100 Hz;
it needs mavros_msgs. The node does not compensate the arm's weight, because the autopilot's hover
thrust includes this weight.
"""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Imu

from aerarm_ros.autopilot.ardupilot import LoopMotion, LoopOffset
from aerarm_ros.autopilot.mavlink_autopilot import ARDUPILOT, PX4
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.ros.flight.set_point_node import (
    FIRMWARE_PARAMETERS,
    SetPointNode,
    ardupilot_loop,
    ardupilot_moment_unit,
    set_point_parameters,
)
from aerarm_ros.ros.process.node_main import run_node

NAME = 'mavros_feedforward'
PARAMETERS = set_point_parameters(
    'setpoint_raw/local', '/mavros/setpoint_raw/local', '/mavros/imu/data', *FIRMWARE_PARAMETERS
)

# Frames of mavros_msgs/PositionTarget, and bits of type_mask in the order x, y, z.
_FRAMES = {
    PX4: {1: 'FRAME_LOCAL_NED'},
    ARDUPILOT: {1: 'FRAME_LOCAL_NED', 7: 'FRAME_LOCAL_OFFSET_NED'},
}
_POSITION, _VELOCITY, _ACCELERATION = (np.array([1, 2, 4]) * 8**i for i in range(3))
_IS_FORCE = 512
_ZERO, _ALL = np.zeros(3), np.full(3, True)


class MavrosFeedforward(SetPointNode):
    """Feedforward node that publishes set points for MAVROS, in the axes of ROS (ENU, FLU)."""

    def __init__(self) -> None:
        advice = 'run sudo apt install ros-jazzy-mavros-msgs, or use the node px4_feedforward'
        self._last_ns = 0
        super().__init__(NAME, PARAMETERS, 'mavros_msgs', advice)
        self._offset = LoopOffset(ardupilot_loop(self.values))

    def message_types(self) -> tuple[Any, Any]:
        """Return the message types of MAVROS's set point and of the IMU."""
        from mavros_msgs.msg import PositionTarget

        return PositionTarget, Imu

    def attitude(self, message: Any) -> NDArray[np.float64]:
        """Return the attitude quaternion of an Imu message."""
        q = message.orientation
        return np.array([q.x, q.y, q.z, q.w])

    def with_acceleration(
        self, set_point: Any, acceleration: NDArray[np.float64], now_ns: int
    ) -> Any:
        """Return a PositionTarget with the acceleration added, or raise RejectedInputError."""
        if self.values.firmware == PX4:
            return add_acceleration(set_point, acceleration, now_ns)
        dt, self._last_ns = 1e-9 * max(now_ns - self._last_ns, 0), now_ns
        return add_to_loop(set_point, acceleration, self._offset.update(acceleration, dt), now_ns)

    def moment_unit(self, drone: DroneConfig) -> float:
        """Return the roll moment [Nm] at the autopilot's normalized torque 1, or 0 if unknown."""
        if self.values.firmware == PX4:
            return super().moment_unit(drone)
        return ardupilot_moment_unit(drone, self.node.get_logger().warning)


def add_to_loop(
    set_point: Any, acceleration: NDArray[np.float64], moved: LoopMotion, now_ns: int
) -> Any:
    """Add an acceleration (3,) [m/s^2], east-north-up, to a PositionTarget for ArduCopter.

    A set point with a position is moved by the offset for which ArduCopter's position loop commands
    the acceleration. Otherwise the function adds the acceleration itself. Raises RejectedInputError
    as `add_acceleration` does.
    """
    has_position = not set_point.type_mask & _POSITION.sum()
    push = moved.acceleration if has_position else acceleration
    added = add_acceleration(set_point, push, now_ns, ARDUPILOT)
    if has_position:
        _fill(added.position, _ALL, moved.offset)
        _fill(added.velocity, _ALL, moved.speed)
    return added


def add_acceleration(
    set_point: Any, acceleration: NDArray[np.float64], now_ns: int, firmware: str = PX4
) -> Any:
    """Return a PositionTarget to which an acceleration (3,) [m/s^2], east-north-up, is added.

    An axis without position, velocity and acceleration gets no acceleration. ArduCopter ignores a
    whole vector if one of its axes is ignored. ArduCopter also rejects position and acceleration
    without velocity, and restarts its GUIDED mode. So for ArduCopter the ignored axes become 0,
    including the velocity if a position is given.

    Raises
    ------
    RejectedInputError
        If the autopilot does not accept set points in that frame, or the set point is a force.
    """
    frames = _FRAMES[firmware]
    if set_point.coordinate_frame not in frames:
        raise RejectedInputError(
            f'set point rejected, because its coordinate_frame is {set_point.coordinate_frame}: '
            f'for {firmware}, set {" or ".join(frames.values())}'
        )
    if set_point.type_mask & _IS_FORCE:
        raise RejectedInputError(
            'set point rejected, because it contains a force: send an acceleration instead'
        )
    added = copy.deepcopy(set_point)
    position, velocity, wanted = (
        (set_point.type_mask & bits) == 0 for bits in (_POSITION, _VELOCITY, _ACCELERATION)
    )
    takes = position | velocity | wanted
    if firmware == ARDUPILOT:
        takes = np.full(3, position.all() or velocity.all() or wanted.all())
        if takes[0] and not velocity.all() and position.all():
            _fill(added.velocity, velocity)
            added.type_mask &= ~int(_VELOCITY.sum())
    _fill(added.acceleration_or_force, wanted, acceleration * takes)
    added.type_mask &= ~int(_ACCELERATION[takes].sum())
    added.header.stamp.sec, added.header.stamp.nanosec = divmod(now_ns, 10**9)
    return added


def _fill(vector: Any, given: NDArray[np.bool_], added: NDArray[np.float64] = _ZERO) -> None:
    """Add an array to a Vector3 message; message axes that are not `given` count as 0."""
    values = np.where(given, [vector.x, vector.y, vector.z], 0.0) + added
    vector.x, vector.y, vector.z = values.tolist()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, MavrosFeedforward, args, PARAMETERS, __doc__)
