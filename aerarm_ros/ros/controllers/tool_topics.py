"""Base class of controllers for target positions of the tool."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Header

from aerarm_msgs_py import topics
from aerarm_ros.control.base.base_motion import quaternion
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.references.target_follower import TargetFollower
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.controllers.controller_node import ControllerNode
from aerarm_ros.ros.controllers.controller_parameters import ControlledArm
from aerarm_ros.ros.executors import create_steady_timer
from aerarm_ros.ros.messages import fill, vector
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.states.state_stream import base_header

TARGET_PARAMETERS = (
    Parameter('frame', 'tool0', 'link that the controller moves to the Cartesian targets'),
    Parameter('tool_velocity_max', 0.8,
        "largest velocity of the tool's reference", 'm/s', 1e-3, 10.0),
    Parameter('tool_acceleration_max', 4.0,
        "largest acceleration of the tool's reference", 'm/s^2', 1e-2, 100.0),
)  # fmt: skip


def make_target_follower(values: SimpleNamespace, arm: ControlledArm) -> TargetFollower:
    """Create the target follower, which rejects targets beyond the length of the arm."""
    return TargetFollower(
        Kinematics(arm.robot, values.frame),
        velocity_max=values.tool_velocity_max,
        acceleration_max=values.tool_acceleration_max,
        reach=_stretched_length(arm, values.frame),
    )


def _stretched_length(arm: ControlledArm, frame: str) -> float:
    """Return the length of the stretched arm [m], from the base to the given frame."""
    model, frame = arm.robot.model, arm.robot.full_name(frame)
    offsets = [model.jointPlacements[index].translation for index in range(1, model.njoints)]
    offsets.append(model.frames[model.getFrameId(frame)].placement.translation)
    return float(sum(np.linalg.norm(offset) for offset in offsets))


_POSE_PERIOD = 0.02  # [s]


class ToolController(ControllerNode):
    """Base class of controllers that move the tool to targets in the base frame.

    The node receives targets on `tool_trajectory`, and publishes `tool_pose`.
    """

    follower: TargetFollower

    def make_follower(self) -> TargetFollower:
        """Return the follower of tool targets."""
        return make_target_follower(self.values, self.arm)

    def subscribe(self) -> None:
        """Subscribe to tool targets, and start to publish the tool's pose."""
        self._base = self.arm.robot.base_link
        # A separate instance for the executor's thread, because `Kinematics` has working memory.
        self._kinematics = Kinematics(self.arm.robot, self.values.frame)
        self._poses = self.advertise(topics.TOOL_POSE)
        self.take_references(topics.TOOL_TRAJECTORY, self._on_target)
        create_steady_timer(self.node, _POSE_PERIOD, self._publish_pose)

    def _on_target(self, message: PoseStamped, now: float) -> None:
        frame = message.header.frame_id
        if frame not in ('', self._base):
            raise RejectedInputError(
                f'tool target rejected, because its frame is {frame!r}: send the target in the '
                f'frame {self._base!r}'
            )
        self.follower.set_target(vector(message.pose.position), now)

    def _publish_pose(self) -> None:
        if self.state is None:
            return
        transform = self._kinematics.transform(self.state.q)
        header = base_header(self.stamp_ns, self._base)
        self._poses.publish(pose_message(header, transform[:3, 3], transform[:3, :3]))


def pose_message(header: Header, place: Array, rotation: Array) -> PoseStamped:
    """Return a pose message with position `place` (3,) [m] and rotation matrix (3, 3)."""
    message = PoseStamped(header=header)
    fill(message.pose.position, place)
    fill(message.pose.orientation, quaternion(rotation))
    return message
