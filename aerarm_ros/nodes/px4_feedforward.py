"""Add the acceleration that compensates the arm's motion to the set points for PX4.

The node subscribes to `trajectory_setpoint` and publishes on /fmu/in/trajectory_setpoint at 100
Hz; it needs px4_msgs. The node does not compensate the arm's weight, because PX4's estimate of the
hover thrust includes this weight. PX4 leaves offboard mode if messages on
/fmu/in/offboard_control_mode stop, but does not monitor set points. So this node also publishes on
/fmu/in/offboard_control_mode while set points arrive. No other node should publish on that topic.
"""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aerarm_ros.autopilot.px4 import ned, vehicle_attitude
from aerarm_ros.ros.flight.set_point_node import SetPointNode, set_point_parameters
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.process.node_main import run_node

NAME = 'px4_feedforward'
PARAMETERS = set_point_parameters(
    'trajectory_setpoint',
    '/fmu/in/trajectory_setpoint',
    '/fmu/out/vehicle_attitude',
    Parameter('offboard_mode_topic', '/fmu/in/offboard_control_mode', 'topic on '
              'which the node publishes OffboardControlMode with each set point; empty: none'),
)  # fmt: skip


class Px4Feedforward(SetPointNode):
    """Feedforward node that publishes set points for PX4, in PX4's axes (NED, FRD)."""

    def __init__(self) -> None:
        advice = (
            'build px4_msgs in the workspace and source the workspace, or use MAVROS and '
            'mavros_feedforward'
        )
        super().__init__(NAME, PARAMETERS, 'px4_msgs', advice)
        self._offboard_mode: Any = None
        if topic := self.values.offboard_mode_topic:
            from px4_msgs.msg import OffboardControlMode

            self._offboard_mode = self.node.create_publisher(OffboardControlMode, topic, 1)

    def message_types(self) -> tuple[Any, Any]:
        """Return the message types of PX4's set point and attitude."""
        from px4_msgs.msg import TrajectorySetpoint, VehicleAttitude

        return TrajectorySetpoint, VehicleAttitude

    attitude = staticmethod(vehicle_attitude)

    def publish(self, set_point: Any, now_ns: int) -> None:
        """Publish the OffboardControlMode message that PX4 monitors, then the set point."""
        if self._offboard_mode is not None:
            mode = self._offboard_mode.msg_type()
            mode.timestamp = now_ns // 1000
            setattr(mode, controlled_quantity(set_point), True)
            self._offboard_mode.publish(mode)
        super().publish(set_point, now_ns)

    def with_acceleration(
        self, set_point: Any, acceleration: NDArray[np.float64], now_ns: int
    ) -> Any:
        """Return the TrajectorySetpoint with an added acceleration."""
        return add_acceleration(set_point, acceleration, now_ns)


def add_acceleration(set_point: Any, acceleration: NDArray[np.float64], now_ns: int) -> Any:
    """Return a TrajectorySetpoint to which an acceleration (3,) [m/s^2], in ENU axes, is added.

    An axis without set point (position, velocity and acceleration NaN) gets no acceleration,
    because PX4 would follow an acceleration alone.
    """
    added = copy.copy(set_point)
    wanted = np.array(set_point.acceleration, dtype=float)
    is_open = np.isnan([set_point.position, set_point.velocity, wanted]).all(axis=0)
    wanted = np.nan_to_num(wanted, nan=0.0) + ned(acceleration)
    added.acceleration = np.where(is_open, np.nan, wanted).astype(np.float32)
    added.timestamp = now_ns // 1000
    return added


def controlled_quantity(set_point: Any) -> str:
    """Return the quantity that a set point controls: the name of a field of OffboardControlMode."""
    names = ('position', 'velocity', 'acceleration')
    given = (name for name in names if not np.isnan(getattr(set_point, name)).all())
    return next(given, 'acceleration')


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, Px4Feedforward, args, PARAMETERS, __doc__)
