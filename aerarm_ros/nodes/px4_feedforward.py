"""Adds to PX4's set points the acceleration that the arm's motion takes.

`trajectory_setpoint` in, as it would go to /fmu/in/trajectory_setpoint, and out there, a hundred
times a second; px4_msgs has to be installed. The weight is left to PX4's estimate of the hover
thrust.
"""

import copy
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aerarm_ros.autopilot.px4 import ned
from aerarm_ros.control.base.base_motion import attitude_ned_frd_to_enu_flu
from aerarm_ros.ros.flight.set_point_node import SetPointNode, set_point_parameters
from aerarm_ros.ros.process.node_main import run_node

NAME = 'px4_feedforward'
PARAMETERS = set_point_parameters(
    'trajectory_setpoint', '/fmu/in/trajectory_setpoint', '/fmu/out/vehicle_attitude'
)


class Px4Feedforward(SetPointNode):
    """In PX4's frames: north-east-down, forward-right-down."""

    def __init__(self) -> None:
        advice = 'build it in the workspace and source it, or use MAVROS and mavros_feedforward'
        super().__init__(NAME, PARAMETERS, 'px4_msgs', advice)

    def message_types(self) -> tuple[Any, Any]:
        """Return PX4's."""
        from px4_msgs.msg import TrajectorySetpoint, VehicleAttitude

        return TrajectorySetpoint, VehicleAttitude

    def attitude(self, message: Any) -> NDArray[np.float64]:
        """Return the attitude of a VehicleAttitude in ROS's frames."""
        w, x, y, z = (float(value) for value in message.q)
        return attitude_ned_frd_to_enu_flu([x, y, z, w])

    def with_acceleration(
        self, set_point: Any, acceleration: NDArray[np.float64], now_ns: int
    ) -> Any:
        """Return a TrajectorySetpoint with an acceleration added."""
        return add_acceleration(set_point, acceleration, now_ns)


def add_acceleration(set_point: Any, acceleration: NDArray[np.float64], now_ns: int) -> Any:
    """Return a TrajectorySetpoint with an acceleration (3,), east-north-up, added [m/s^2].

    What it leaves open (NaN) stays so in everything else.
    """
    added = copy.copy(set_point)
    asked = np.nan_to_num(np.array(set_point.acceleration, dtype=float), nan=0.0)
    added.acceleration = (asked + ned(acceleration)).astype(np.float32)
    added.timestamp = now_ns // 1000
    return added


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, Px4Feedforward, args, PARAMETERS, __doc__)


if __name__ == '__main__':
    sys.exit(main())
