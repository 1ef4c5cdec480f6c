"""Clients that publish a goal for the joints or the tool, and wait for the end of the motion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack

import numpy as np
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_msgs_py.topics import Topic
from aerarm_ros.hardware.bridge_modes import HELD, to_switch_on
from aerarm_ros.motion.signals import JointMotion
from aerarm_ros.ros.diagnostics import TOOL_FORCE, TOOL_FORCE_PHASE, rejection
from aerarm_ros.ros.executors import spin_until, this_domain
from aerarm_ros.ros.graph import can_move, listeners
from aerarm_ros.ros.messages import fill, vector
from aerarm_ros.ros.requests.arm_client import ArmClientError
from aerarm_ros.ros.requests.parameter_request import ParameterRequest

POINT_PERIOD = 0.02
"""Time between two trajectory points [s], short enough for quintic interpolation."""

_SECOND = 1_000_000_000


def trajectory_message(
    motion: JointMotion, names: Sequence[str], start_ns: int = 0
) -> JointTrajectory:
    """Sample a joint motion, and return its positions, velocities and accelerations as a message.

    Parameters
    ----------
    motion
        Motion of n joints.
    names
        Names of the joints.
    start_ns
        Start time on the clock of the joint states [ns]; 0 to start at once.
    """
    times = np.append(np.arange(0.0, motion.duration - 1e-6, POINT_PERIOD), motion.duration)
    q, dq, ddq = motion.evaluate(times)
    message = JointTrajectory(joint_names=list(names))
    message.header.stamp = Time(**_split(start_ns))
    message.points = [
        JointTrajectoryPoint(
            positions=q[k].tolist(),
            velocities=dq[k].tolist(),
            accelerations=ddq[k].tolist(),
            time_from_start=Duration(**_split(round(when * _SECOND))),
        )
        for k, when in enumerate(times)
    ]
    return message


def _split(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, _SECOND)
    return {'sec': seconds, 'nanosec': rest}


_REPORT = 3.0  # [s] within which every controller has reported on /diagnostics
_MODE = 'arm mode'  # keys in a controller's status
_TEXT = 'message'  # key under which the watch stores the text of a status


class RejectionWatch:
    """Detect from /diagnostics whether a controller rejects an input or stops at a contact.

    Parameters
    ----------
    node
        Owner of the subscription; no executor may contain it.

    Attributes
    ----------
    values
        Newest values of each status, by the name of the status.
    reports
        Number of received statuses, by the name of the status.
    """

    def __init__(self, node: Node) -> None:
        self.values: dict[str, dict[str, str]] = {}
        self.reports: Counter[str] = Counter()
        self._node = node
        self._before = self.values.copy()  # at the call of `begin`
        topics.DIAGNOSTICS.subscription(node, self._on_diagnostics)

    def begin(self, timeout: float) -> None:
        """Wait for the controllers' diagnostics, and store their counts of rejections and contacts.

        Parameters
        ----------
        timeout
            Longest time for a new controller to receive the arm's mode [s]. Without the mode, the
            controller rejects every input.
        """

        def modes() -> list[str]:
            return [values[_MODE] for values in self.values.values() if _MODE in values]

        if spin_until(self._node, modes, _REPORT):
            spin_until(self._node, lambda: any(modes()), timeout)
        self._before = self.values.copy()

    def reason(self) -> str:
        """Return why a controller rejected an input after the call of `begin`, '' if none did."""
        known = self.values.keys() & self._before.keys()
        return self._news(known, 'rejected inputs', 'last rejection')

    def touch(self) -> str:
        """Return how a contact ended a motion after the call of `begin`, '' if none did."""
        return self._news(self.values, 'reactions to contact', 'last motion')

    def _news(self, names: Iterable[str], count: str, text: str) -> str:
        """Return the value `text` of the first status whose `count` has increased, or ''."""
        for name in names:
            values, before = self.values[name], self._before.get(name, {})
            if int(values.get(count, 0)) > int(before.get(count, 0)):
                return values.get(text, '')
        return ''

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            pairs = {pair.key: pair.value for pair in status.values}
            self.values[status.name] = {_TEXT: status.message, **pairs}
            self.reports[status.name] += 1


_SEARCH = 10.0  # [s] for discovery on a busy machine
_QUIET = 2.0  # [s] of waiting without a message to the user


class _MotionRequest:
    """Publish a goal, and detect whether a controller rejects it.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions; no executor may contain it.
    on_wait
        Called with a description of the missing node.
    """

    _TOPIC: Topic

    def __init__(self, node: Node, on_wait: Callable[[str], None] = lambda _: None) -> None:
        self._node = node
        self._on_wait = on_wait
        self._mode = ''
        self._rejections = RejectionWatch(node)
        self._publisher = self._TOPIC.publisher(node)
        topics.ARM_MODE.subscription(node, self._on_mode)

    def _on_mode(self, message: String) -> None:
        self._mode = message.data

    def _has_controller(self) -> bool:
        """Return whether a controller subscribes to the goal and all subscribers are connected."""
        names = listeners(self._node, self._publisher.topic_name)
        connected = self._publisher.get_subscription_count() >= len(names)
        return all(names) and connected and any(map(can_move, names))

    def _find(self, source: str, has_source: Callable[[], bool], who: str, timeout: float) -> None:
        """Wait for a bridge and the controller `who`, and raise ArmClientError if the arm is off.

        The controller subscribes to the goal, and the bridge or the controller publishes `source`.
        """

        def missing() -> str:
            if not (has_source() and self._mode):
                return f'no {source} received'
            return '' if self._has_controller() else f'no controller subscribes to {topic}'

        topic = self._TOPIC.name
        if not spin_until(self._node, lambda: not missing(), _QUIET):
            self._on_wait(f'a bridge and {who} in {this_domain()}: {missing()}')
            spin_until(self._node, lambda: not missing(), max(timeout, _SEARCH) - _QUIET)
        problem = missing()
        if problem:
            raise ArmClientError(f'{problem}: check that a bridge and {who} run in {this_domain()}')
        if self._mode not in HELD:
            raise ArmClientError(
                f'the arm cannot move in the arm_mode {self._mode}: run '
                f'{to_switch_on(self._mode)} first'
            )

    def _wait(self, ended: Callable[[], object], timeout: float) -> bool:
        """Return whether the motion ended in time, or raise ArmClientError if it was rejected."""
        in_time = spin_until(self._node, lambda: ended() or self._rejections.reason(), timeout)
        if self._rejections.reason():
            raise ArmClientError(rejection(self._rejections.reason()))
        return in_time


class SetPointRequest(_MotionRequest):
    """Move the joints: publish a set point, and wait until the arm has reached it."""

    _TOPIC = topics.SET_POINT

    def __init__(self, node: Node, on_wait: Callable[[str], None] = lambda _: None) -> None:
        super().__init__(node, on_wait)
        self._state: JointState | None = None
        topics.JOINT_STATES.subscription(node, self._on_state)

    def go(
        self, posture: Sequence[float], tolerance: float, timeout: float, reaction: str = ''
    ) -> str:
        """Move the arm to a posture, wait until it arrives, and return the result.

        Parameters
        ----------
        posture
            Joint angles in the order of `joint_states` [rad].
        tolerance
            Largest error of each joint at the goal [rad].
        timeout
            Longest time to find bridge and controller, and again for the motion [s].
        reaction
            Value of the controllers' parameter `contact_reaction` during this motion; unchanged
            if empty.

        Raises
        ------
        ArmClientError
            If no bridge or controller runs, the posture has the wrong number of joints, or a
            controller rejects or does not reach the posture.
        """
        who = 'computed_torque or gravity_compensation'
        self._find('joint_states', lambda: self._state is not None, who, timeout)
        assert self._state is not None
        names = list(self._state.name)
        if len(posture) != len(names):
            raise ArmClientError(
                f'the arm needs {len(names)} joint positions [rad], for {", ".join(names)}'
            )
        controllers = filter(can_move, listeners(self._node, self._publisher.topic_name))
        with ExitStack() as stack:
            for controller in controllers if reaction else ():
                request = ParameterRequest(self._node, controller, timeout)
                stack.enter_context(request.during('contact_reaction', reaction))
            self._move(names, posture, tolerance, timeout)
        return 'the arm has reached its goal'

    def _move(
        self, names: list[str], posture: Sequence[float], tolerance: float, timeout: float
    ) -> None:
        """Publish the set point, and wait until the arm reaches it, or raise ArmClientError."""
        self._rejections.begin(timeout)
        self._publisher.publish(JointState(name=names, position=list(posture)))

        def distance() -> NDArray[np.float64]:
            assert self._state is not None
            error: NDArray[np.float64] = np.abs(np.array(self._state.position) - posture)
            return error

        def ended() -> bool:
            return bool(np.all(distance() <= tolerance) or self._rejections.touch())

        in_time = self._wait(ended, timeout)
        if self._rejections.touch():
            raise ArmClientError(
                f'{self._rejections.touch()}: remove the object that touches the arm, then repeat '
                'the command'
            )
        if not in_time:
            far = np.argmax(distance())
            raise ArmClientError(
                f'the joint {names[far]} is still {distance()[far]:.3f} rad away from its goal '
                f'after {timeout:g} s, and arm_mode is {self._mode}: check the log of the '
                'controller'
            )

    def _on_state(self, message: JointState) -> None:
        self._state = message


BASE, WORLD = 'base', 'world'


class ToolRequest(_MotionRequest):
    """Move the tool: publish a target pose, and wait until the tool has reached it."""

    _TOPIC = topics.TOOL_TRAJECTORY

    def __init__(self, node: Node, on_wait: Callable[[str], None]) -> None:
        super().__init__(node, on_wait)
        self._pose: PoseStamped | None = None
        topics.TOOL_POSE.subscription(node, self._on_pose)

    def go(self, place: Sequence[float], tolerance: float, timeout: float, frame: str) -> str:
        """Move the tool to a position, wait until it arrives, and return the result.

        Parameters
        ----------
        place
            Position of the tool (3,) in `frame` [m].
        tolerance
            Largest error at the target [m].
        timeout
            Longest time to find a controller, and again for the motion [s].
        frame
            BASE, the arm's base, or WORLD, the frame of the drone's odometry.

        Raises
        ------
        ArmClientError
            If no Cartesian controller runs, the controller is not active, or the position is
            rejected or not reached.
        """
        who = 'world_control' if frame == WORLD else 'kinematic_control'
        self._find('tool_pose', lambda: self._pose is not None, who, timeout)
        assert self._pose is not None
        given = self._pose.header.frame_id
        if given.endswith('base_link') != (frame == BASE):
            advice = (
                'give the position in that frame, with --frame world'
                if frame == BASE
                else 'start world_control, or remove --frame world'
            )
            raise ArmClientError(
                f'the active controller expects tool targets in the frame {given}: {advice}'
            )
        self._rejections.begin(timeout)
        message = PoseStamped(header=self._pose.header)
        fill(message.pose.position, np.array(place))
        # In the world frame, a zero quaternion leaves the orientation free.
        message.pose.orientation.w = float(frame == BASE)
        self._publisher.publish(message)

        def distance() -> float:
            assert self._pose is not None
            return float(np.linalg.norm(vector(self._pose.pose.position) - place))

        if not self._wait(lambda: distance() <= tolerance, timeout):
            raise ArmClientError(
                f'the tool is still {distance():.3f} m away from its goal after {timeout:g} s, '
                f'and arm_mode is {self._mode}: check the log of the controller'
            )
        return 'the tool has reached its goal'

    def _on_pose(self, message: PoseStamped) -> None:
        self._pose = message


_NO_CONTACT, _CONTACT = 'none', 'contact'  # values of world_control's `Phase`
_FORCE_TOLERANCE = 0.5  # [N] with which the estimated force counts as reached


class PressRequest(_MotionRequest):
    """Press the tool on a wall: publish a force, and wait until `world_control` measures it."""

    _TOPIC = topics.TOOL_FORCE

    def press(self, force: Sequence[float], timeout: float) -> str:
        """Publish a force (3,) on the wall in the world frame [N], and return the result.

        Parameters
        ----------
        timeout
            Longest time to find `world_control`, and again for approach and rise of the force [s].

        Raises
        ------
        ArmClientError
            If `world_control` does not run, rejects the force, or does not reach the force.
        """
        who = 'world_control with an observer_gain above 0'
        self._find('tool force on /diagnostics', lambda: bool(self._source()), who, timeout)
        self._rejections.begin(timeout)
        name = self._source()
        message = WrenchStamped()
        fill(message.wrench.force, np.array(force))
        before, wanted = self._rejections.reports[name], float(np.linalg.norm(force))
        self._publisher.publish(message)

        def contact() -> tuple[str, float]:
            values = self._rejections.values[name]
            return values[TOOL_FORCE_PHASE], float(values[TOOL_FORCE])

        def ended() -> bool:
            if self._rejections.reports[name] < before + 2:
                return False  # the first report may be older than the force
            phase, measured = contact()
            reached = abs(measured - wanted) <= _FORCE_TOLERANCE
            return phase == _NO_CONTACT or phase == _CONTACT and reached

        in_time = self._wait(ended, timeout)
        phase, measured = contact()
        if wanted == 0.0 and phase == _NO_CONTACT:
            return 'the contact has ended'
        if phase == _NO_CONTACT:
            raise ArmClientError(self._rejections.values[name][_TEXT])
        if not in_time:
            raise ArmClientError(
                f'the estimated force is {measured:.1f} N after {timeout:g} s, in the phase '
                f"'{phase}': check the wall. To end the motion, run 'arm press 0 0 0'"
            )
        return f'the tool presses with {measured:.1f} N'

    def _source(self) -> str:
        """Return the name of the status with the tool force, '' before its first report."""
        values = self._rejections.values
        return next((name for name, pairs in values.items() if TOOL_FORCE_PHASE in pairs), '')
