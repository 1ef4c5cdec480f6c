"""Topics of the node `world_control`: targets, tool pose, remaining reach, planned contact."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import PoseStamped, Quaternion, Twist, WrenchStamped
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout
from trajectory_msgs.msg import MultiDOFJointTrajectory

from aerarm_msgs_py import topics
from aerarm_ros.control.base.base_motion import rotation_matrix
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.model.inertia import cross
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.controllers.state_node import Attendant
from aerarm_ros.ros.controllers.tool_topics import pose_message
from aerarm_ros.ros.executors import create_steady_timer
from aerarm_ros.ros.messages import quaternion as quaternion_of
from aerarm_ros.ros.messages import seconds, vector, wrench, wrench_message
from aerarm_ros.ros.states.state_stream import base_header
from aerarm_ros.world.base_pose import BasePose
from aerarm_ros.world.reach import DIRECTIONS, ArmReach, DroneRequest, ReachMargin
from aerarm_ros.world.tool_force import Phase
from aerarm_ros.world.world_reference import WorldPath, WorldToolReference

if TYPE_CHECKING:
    from aerarm_ros.ros.controllers.controller_node import ControllerNode

_POSE_PERIOD_NS = 20_000_000
_REACH_PERIOD = 0.2  # [s]
_RECENT = 15  # last computed reaches, 3 s: under a swaying drone a warning would toggle
_CONTACT_PERIOD_NS = 2_000_000
_CONTACT_ENDS = 0.1  # [s] for which the end of a contact is published
_POINTS_MAX = 500  # the loop's thread processes them between two states
_ANY = 0.1  # A shorter quaternion means that no orientation is requested.


class WorldTopics(Attendant):
    """Pass targets to a `WorldToolReference`, and publish the tool's pose and the arm's reach.

    The executor's thread computes the reach at 5 Hz.

    Parameters
    ----------
    controller
        Owner of subscriptions, publishers and the timer.
    reference
        Receiver of the targets.
    values
        Parameters of `world_control`.

    Attributes
    ----------
    frame
        Frame of the odometry; empty before the first message.
    margin
        The last computed remaining reach of the arm, None while world control is not active.
    recent
        The reaches computed within the last 3 s.
    """

    def __init__(
        self, controller: ControllerNode, reference: WorldToolReference, values: SimpleNamespace
    ) -> None:
        self._controller, self._reference = controller, reference
        self._values = values
        arm = controller.arm
        self._base = arm.robot.base_link
        self._kinematics = Kinematics(arm.robot, values.frame)
        self._reach = ArmReach(Kinematics(arm.robot, values.frame), arm.limits)
        self.frame = ''
        self.margin: ReachMargin | None = None
        self.recent: deque[ReachMargin] = deque(maxlen=_RECENT)
        self._seen: tuple[Array, BasePose, Array, Array, float] | None = None
        self._posed_ns = 0
        self._poses = controller.advertise(topics.TOOL_POSE)
        self._reaches = controller.advertise(topics.ARM_REACH)
        label = 'reach: x y z -x -y -z [m], time [s]'
        size = len(DIRECTIONS) + 1
        self._layout = MultiArrayLayout(
            dim=[MultiArrayDimension(label=label, size=size, stride=size)]
        )
        self._request: DroneRequest | None = None
        self._restarts = True
        if values.request_drone:
            if arm.drone is None or not values.posture:
                raise ValueError(
                    'request_drone needs the drone and a posture in the middle of the reach: set '
                    'the parameters drone_file, and posture with joint 4 far from 0'
                )
            self._request = DroneRequest(
                Kinematics(arm.robot, values.frame), arm.drone, values.posture,
                values.request_speed, values.request_deadband,
            )  # fmt: skip
            self._requests = controller.advertise(topics.FLIGHT_SET_POINT)
        controller.take_references(topics.TOOL_TRAJECTORY, self._on_target)
        controller.take_references(topics.TOOL_MOTION, self._on_motion)
        self._pressed_ns, self._pressed_until = 0, -np.inf
        self._logged = Phase.NONE, ''
        self._contacts = controller.advertise(topics.PLANNED_CONTACT)
        controller.take_references(topics.TOOL_FORCE, self._on_force)
        create_steady_timer(controller.node, _REACH_PERIOD, self._publish_reach)

    # Targets, in the loop's thread.

    def _on_target(self, message: PoseStamped, now: float) -> None:
        rotation = _rotation('tool target', message.pose.orientation)
        position = vector(message.pose.position)
        place, rotation = self._in_world(
            'tool target', message.header.frame_id, position, rotation, now
        )
        self._reference.go_to(place, now, rotation)

    def _on_motion(self, message: MultiDOFJointTrajectory, now: float) -> None:
        points = message.points
        if not 2 <= len(points) <= _POINTS_MAX or any(len(p.transforms) != 1 for p in points):
            raise RejectedInputError(
                f'tool motion rejected: it must have 2 to {_POINTS_MAX} points, each with the '
                'pose of one body (the tool)'
            )
        self._require_odometry('tool motion', message.header.frame_id)
        path = WorldPath(
            [seconds(p.time_from_start) for p in points],
            [vector(p.transforms[0].translation) for p in points],
            _linear([p.velocities for p in points]),
            _linear([p.accelerations for p in points]),
            self._values.tool_velocity_max,
            self._values.tool_acceleration_max,
        )
        rotation = _rotation('tool motion', points[-1].transforms[0].rotation)
        self._reference.follow(path, seconds(message.header.stamp) or now, now, rotation)

    def _on_force(self, message: WrenchStamped, now: float) -> None:
        force, moment = np.split(wrench(message), 2)
        if np.any(moment != 0.0):
            raise RejectedInputError(
                'tool force rejected: the tool can press with a force but not with a moment: set '
                'the torque to zero'
            )
        self._require_odometry('tool force', message.header.frame_id)
        self._reference.push(force, now)

    def _require_odometry(self, what: str, frame: str) -> None:
        if frame not in ('', self.frame):
            raise RejectedInputError(
                f'{what} rejected, because its frame is {frame!r}: send it in the frame of the '
                f'odometry, {self.frame!r}'
            )

    def _in_world(
        self, what: str, frame: str, place: Array, rotation: Array | None, now: float
    ) -> tuple[Array, Array | None]:
        """Transform a position and orientation from the base frame to the present world frame."""
        if frame in ('', self.frame):
            return place, rotation
        if frame != self._base:
            known = f'{self.frame!r} or {self._base!r}' if self.frame else repr(self._base)
            raise RejectedInputError(
                f'{what} rejected, because no node publishes the base pose in frame {frame!r}: '
                f'send the {what} in frame {known}'
            )
        problem = self._reference.base.problem(now)
        if problem:
            self._reference.base.accept_next()
            raise RejectedInputError(
                f'{what} rejected, because the base pose in the world is unknown: {problem}'
            )
        pose = self._reference.base.pose(now)
        turned = None if rotation is None else pose.rotation @ rotation
        return pose.to_world(place), turned

    # Called by the control loop.

    def update(self) -> None:
        """Publish the tool's pose if one period has passed, and store the state for the reach."""
        stamp_ns, state = self._controller.stamp_ns, self._controller.state
        self._publish_contact(stamp_ns)
        self._log_contact()
        if state is None or 0 <= stamp_ns - self._posed_ns < _POSE_PERIOD_NS:
            return
        self._posed_ns = stamp_ns
        now = stamp_ns * 1e-9
        if self._reference.base.problem(now):
            self._seen = None
            return
        pose = self._reference.base.pose(now)
        transform = self._kinematics.transform(state.q)
        place = pose.to_world(transform[:3, 3])
        goal, reference = self._reference.goal, self._reference.reference
        held = place if reference is None else reference.p
        self._seen = np.array(state.q), pose, held, held if goal is None else goal, now
        header = base_header(stamp_ns, self.frame)
        self._poses.publish(pose_message(header, place, pose.rotation @ transform[:3, :3]))

    def _log_contact(self) -> None:
        """Log the begin and end of a contact, with the reason of the end."""
        pusher = self._reference.force
        if pusher is None or (pusher.phase, pusher.reason) == self._logged:
            return
        self._logged = pusher.phase, pusher.reason
        log = self._controller.node.get_logger()
        if pusher.reason:
            log.warning(f'the tool no longer presses: {pusher.reason}')
        else:
            log.info(f'tool force: {pusher.phase.value}')

    def _publish_contact(self, stamp_ns: int) -> None:
        """Publish the wrench of the planned contact until 0.1 s after the end of the contact."""
        pusher, now, state = self._reference.force, 1e-9 * stamp_ns, self._controller.state
        if pusher is None or state is None:
            return
        if pusher.is_active:
            self._pressed_until = now + _CONTACT_ENDS
        if now > self._pressed_until or 0 <= stamp_ns - self._pressed_ns < _CONTACT_PERIOD_NS:
            return
        self._pressed_ns = stamp_ns
        force = np.zeros(3)  # without the pose of the base, the direction is unknown
        if not self._reference.base.problem(now):
            force = self._reference.base.pose(now).rotation.T @ pusher.planned_on_tool(now)
        moment = cross(self._kinematics.position(state.q), force)
        header = base_header(stamp_ns, self._base)
        self._contacts.publish(wrench_message(header, np.concatenate([force, moment])))

    def give_up(self, reason: str) -> None:
        """Forget the stored reach and end the contact, because the arm is not controlled."""
        self._seen = self.margin = None
        self._restarts = True
        if self._reference.force is not None:
            self._reference.force.reset()

    # In the executor's thread.

    def _publish_reach(self) -> None:
        seen = self._seen
        if seen is None:
            self.margin = None
            self.recent.clear()
            return
        q, pose, held, goal, now = seen
        self.margin = margin = self._reach.margin(q, pose, held)
        self.recent.append(margin)
        data = [*margin.along.tolist(), margin.time]
        self._reaches.publish(Float64MultiArray(layout=self._layout, data=data))
        if self._request is not None:
            if self._restarts:  # reset in this thread, which alone uses the request
                self._restarts = False
                self._request.reset()
            place, turn = self._request.update(now, goal, pose)
            self._requests.publish(
                pose_message(base_header(round(now * 1e9), self.frame), place, turn)
            )


def _rotation(what: str, part: Quaternion) -> Array | None:
    """Return the rotation matrix of a quaternion; None if the quaternion is zero."""
    turn = quaternion_of(part)
    length = float(np.linalg.norm(turn))
    if not np.isfinite(length):
        raise RejectedInputError(
            f'{what} rejected: its orientation is NaN or infinite; check its publisher'
        )
    if length < _ANY:
        return None
    if not 0.9 < length < 1.1:
        raise RejectedInputError(
            f'{what} rejected, because its quaternion has length {length:.3g} instead of 1: send '
            'a unit quaternion, or zeros to permit any orientation'
        )
    return rotation_matrix(turn / length)


def _linear(twists: Sequence[Sequence[Twist]]) -> list[Array]:
    """Return the linear part of each point's twist, empty for a point without a twist."""
    return [vector(point[0].linear) if len(point) else np.empty(0) for point in twists]
