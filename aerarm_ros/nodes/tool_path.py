"""Publish the path that the tool has moved along as nav_msgs/Path, for RViz and Foxglove.

Usage: ros2 run aerarm_ros tool_path
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from numpy.typing import NDArray

from aerarm_msgs_py import topics
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES, load_arm
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.process_end import StopSignals
from aerarm_ros.ros.states.state_stream import StateSampler, base_header

NAME = 'tool_path'

PARAMETERS = ParameterTable(
    Parameter('frame', 'tool0', 'link whose path is published'),
    Parameter('rate', 10.0,
        'rate at which the node reads the tool position; it publishes the path if the tool has '
        'moved', 'Hz', 0.1, 50.0),
    Parameter('length', 500, 'largest number of points in the published path', '', 2, 10000),
    Parameter('distance', 0.002,
        'smallest distance between two points of the path', 'm', 1e-4, 1.0),
    *ARM_FILES,
)  # fmt: skip


class ToolPath:
    """Node that computes tool positions from joint states, and publishes them as a path.

    Attributes
    ----------
    status
        Exit status after `run`.

    Raises
    ------
    ValueError
        If a parameter or a file cannot be used.
    """

    def __init__(self) -> None:
        self.status = 0
        self._node = rclpy.create_node(NAME)
        values = PARAMETERS.declare(self._node)
        _, robot = load_arm(values)
        self._kinematics = Kinematics(robot, values.frame)
        self._base = robot.base_link
        self._distance = values.distance
        self._points: deque[NDArray[np.float64]] = deque(maxlen=values.length)
        self._publisher = topics.TOOL_PATH.publisher(self._node)
        self._states = StateSampler(self._node, robot.joint_names)
        self._loop = PeriodicLoop(1.0 / values.rate)

    def run(self) -> None:
        """Publish the path of the tool until the process receives a stop signal."""
        with StopSignals(self._loop.stop), BackgroundExecutor(self._node):
            self._loop.run(self._update)

    def close(self) -> None:
        """Destroy the node."""
        self._states.destroy()
        self._node.destroy_node()

    def _update(self, now_ns: int, index: int) -> None:
        state = self._states.newest()
        if state is None:
            return
        point = self._kinematics.position(state[0]).copy()
        if not self._points or np.linalg.norm(point - self._points[-1]) > self._distance:
            self._points.append(point)
            self._publisher.publish(self._message())

    def _message(self) -> Path:
        path = Path(header=base_header(self._states.stamp_ns, self._base))
        for point in self._points:
            pose = PoseStamped(header=path.header)
            p = pose.pose.position
            p.x, p.y, p.z = point.tolist()
            path.poses.append(pose)
        return path


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, ToolPath, args, PARAMETERS, __doc__)
