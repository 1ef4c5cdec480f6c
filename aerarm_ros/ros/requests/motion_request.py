"""Clients that publish a goal for the joints or the tool, and wait for the end of the motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
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
from aerarm_ros.ros.graph import endpoint_name
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
_COUNT, _REASON = 'rejected inputs', 'last rejection'  # keys in a controller's status
_MODE = 'arm mode'
_REACTIONS = 'reactions to contact'


class RejectionWatch:
    """Detect from /diagnostics whether a controller rejects an input or stops at a contact.

    Parameters
    ----------
    node
        Owner of the subscription; no executor may contain it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._values: dict[str, dict[str, str]] = {}  # newest values of each status
        self._before = self._values.copy()  # at the call of `begin`
        topics.DIAGNOSTICS.subscription(node, self._on_diagnostics)

    def begin(self, timeout: float) -> None:
        """Wait for the controllers' diagnostics, and store their counts of rejections and contacts.

        Parameters
        ----------
        timeout
            Longest time for a new controller to receive the arm's mode [s]. Without the mode, the
            controller rejects every input.
        """
        if spin_until(self._node, lambda: list(self._modes()), _REPORT):
            spin_until(self._node, lambda: any(self._modes()), timeout)
        self._before = self._values.copy()

    def reason(self) -> str:
        """Return why a controller rejected an input after the call of `begin`, '' if none did."""
        known = self._values.keys() & self._before.keys()
        return self._news(known, _COUNT, _REASON)

    def touch(self) -> str:
        """Return how a contact ended a motion after the call of `begin`, '' if none did."""
        return self._news(self._values, _REACTIONS, 'last motion')

    def _news(self, names: Iterable[str], count: str, text: str) -> str:
        """Return the value `text` of the first status whose `count` has increased, or ''."""
        for name in names:
            values, before = self._values[name], self._before.get(name, {})
            if int(values.get(count, 0)) > int(before.get(count, 0)):
                return values.get(text, '')
        return ''

    def _modes(self) -> Iterator[str]:
        """Yield the arm's mode that each controller reports."""
        return (values[_MODE] for values in self._values.values() if _MODE in values)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._values[status.name] = {pair.key: pair.value for pair in status.values}


_REACTION = 'contact_reaction'  # parameter of the controllers
_LISTENER = 'recorder'  # subscribes to everything but moves nothing
_SEARCH = 10.0  # [s] for discovery on a busy machine


class _MotionRequest:
    """Publish a goal, and detect whether a controller rejects it.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions; no executor may contain it.
    """

    _TOPIC: Topic

    def __init__(self, node: Node) -> None:
        self._node = node
        self._mode = ''
        self._rejections = RejectionWatch(node)
        self._publisher = self._TOPIC.publisher(node)
        topics.ARM_MODE.subscription(node, self._on_mode)

    def _on_mode(self, message: String) -> None:
        self._mode = message.data

    def _require_held(self) -> None:
        """Raise ArmClientError if the arm's mode permits no motion."""
        if self._mode not in HELD:
            raise ArmClientError(
                f'the arm cannot move in the arm_mode {self._mode}: run '
                f'{to_switch_on(self._mode)} first'
            )

    def _find_controller(
        self,
        is_there: Callable[[], bool],
        quiet: float,
        timeout: float,
        on_wait: Callable[[], None],
        missing: str,
    ) -> None:
        """Wait for a controller and a mode that permits motion, or raise ArmClientError.

        After `quiet` [s] the method calls `on_wait`.
        """
        if not spin_until(self._node, is_there, min(timeout, quiet)):
            on_wait()
            if not spin_until(self._node, is_there, timeout):
                raise ArmClientError(missing)
        self._require_held()

    def _wait(self, ended: Callable[[], bool], timeout: float) -> bool:
        """Return whether the motion ended in time, or raise ArmClientError if it was rejected."""
        in_time = spin_until(self._node, lambda: ended() or self._rejections.reason(), timeout)
        if self._rejections.reason():
            raise ArmClientError(rejection(self._rejections.reason()))
        return bool(in_time)


class SetPointRequest(_MotionRequest):
    """Move the joints: publish a set point, and wait until the arm has reached it.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions; no executor may contain it.
    """

    _TOPIC = topics.SET_POINT

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self._state: JointState | None = None
        topics.JOINT_STATES.subscription(node, self._on_state)

    def go(
        self,
        posture: Sequence[float],
        tolerance: float,
        timeout: float,
        on_wait: Callable[[str], None] = lambda _: None,
        reaction: str = '',
    ) -> str:
        """Move the arm to a posture, wait until it arrives, and return the result.

        Parameters
        ----------
        posture
            Joint angles in the order of `joint_states` [rad].
        tolerance
            Largest error of each joint at the goal [rad].
        timeout
            Longest time to find a controller once the arm is found, and again for the motion [s].
        on_wait
            Called with a description of the missing node.
        reaction
            Value of the controllers' parameter `contact_reaction` during this motion; unchanged
            if empty.

        Raises
        ------
        ArmClientError
            If no bridge or controller runs, the posture has the wrong number of joints, or a
            controller rejects or does not reach the posture.
        """
        names = self._find_arm(timeout, on_wait)
        if len(posture) != len(names):
            raise ArmClientError(
                f'the arm needs {len(names)} joint positions [rad], for {", ".join(names)}'
            )
        with ExitStack() as stack:
            for controller in self._controllers() if reaction else []:
                request = ParameterRequest(self._node, controller, timeout)
                stack.enter_context(request.during(_REACTION, reaction))
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

    def _find_arm(self, timeout: float, on_wait: Callable[[str], None]) -> list[str]:
        """Wait until a bridge and a controller run, and return the joint names."""

        def is_there() -> bool:
            return self._state is not None and bool(self._mode)

        what = ''
        if not spin_until(self._node, is_there, 1.0):
            on_wait(f'joint_states and arm_mode in {this_domain()}')
        if not spin_until(self._node, is_there, max(timeout, _SEARCH)):
            what = 'no joint_states received'
        elif not spin_until(self._node, self._has_subscriber, timeout):
            what = 'no controller subscribes to set_point'
        if what:
            raise ArmClientError(
                f'{what}: check that a bridge and computed_torque or gravity_compensation run in '
                f'{this_domain()}'
            )
        self._require_held()
        assert self._state is not None
        return list(self._state.name)

    def _controllers(self) -> list[str]:
        """Return the names of the controllers that subscribe to the set point."""
        listeners = self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
        names = [endpoint_name(listener) for listener in listeners]
        return [name for name in names if name.rpartition('/')[2] != _LISTENER]

    def _has_subscriber(self) -> bool:
        """Return whether a controller has subscribed and all subscribers are connected."""
        listeners = self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
        names = [endpoint_name(listener) for listener in listeners]
        if not all(names) or not self._controllers():
            return False
        return bool(self._publisher.get_subscription_count() >= len(listeners))

    def _on_state(self, message: JointState) -> None:
        self._state = message


BASE, WORLD = 'base', 'world'
_BASE_LINK = 'base_link'


class ToolRequest(_MotionRequest):
    """Move the tool: publish a target pose, and wait until the tool has reached it.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions; no executor may contain it.
    """

    _TOPIC = topics.TOOL_TRAJECTORY

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self._pose: PoseStamped | None = None
        topics.TOOL_POSE.subscription(node, self._on_pose)

    def go(
        self,
        place: Sequence[float],
        tolerance: float,
        timeout: float,
        on_wait: Callable[[str], None] = lambda _: None,
        frame: str = BASE,
    ) -> str:
        """Move the tool to a position, wait until it arrives, and return the result.

        Parameters
        ----------
        place
            Position of the tool (3,) in `frame` [m].
        tolerance
            Largest error at the target [m].
        timeout
            Longest time to find a controller, and again for the motion [s].
        on_wait
            Called with a description of the missing node.
        frame
            BASE, the arm's base, or WORLD, the frame of the drone's odometry.

        Raises
        ------
        ArmClientError
            If no Cartesian controller runs, the controller is not active, or the position is
            rejected or not reached.
        """
        self._find(timeout, on_wait, 'world_control' if frame == WORLD else 'kinematic_control')
        assert self._pose is not None
        self._require_frame(frame, self._pose.header.frame_id)
        self._rejections.begin(timeout)
        message = PoseStamped(header=self._pose.header)
        p = message.pose.position
        p.x, p.y, p.z = (float(x) for x in place)
        if frame == BASE:  # In the world frame, a zero quaternion leaves the orientation free.
            message.pose.orientation.w = 1.0
        else:
            message.pose.orientation.w = 0.0
        self._publisher.publish(message)

        def distance() -> float:
            assert self._pose is not None
            p = self._pose.pose.position
            return float(np.linalg.norm(np.array([p.x, p.y, p.z]) - np.asarray(place)))

        if not self._wait(lambda: distance() <= tolerance, timeout):
            raise ArmClientError(
                f'the tool is still {distance():.3f} m away from its goal after {timeout:g} s, '
                f'and arm_mode is {self._mode}: check the log of the controller'
            )
        return 'the tool has reached its goal'

    def _require_frame(self, wanted: str, given: str) -> None:
        if wanted == WORLD and given.endswith(_BASE_LINK):
            raise ArmClientError(
                f'the active controller expects tool targets in the frame {given}: start '
                'world_control, or remove --frame world'
            )
        if wanted == BASE and not given.endswith(_BASE_LINK):
            raise ArmClientError(
                f'the active controller expects tool targets in the frame {given}: give the '
                'position in that frame, with --frame world'
            )

    def _find(self, timeout: float, on_wait: Callable[[str], None], controller: str) -> None:
        """Wait until a controller publishes the tool's pose and subscribes to target poses."""

        def is_there() -> bool:
            has_pose = self._pose is not None and bool(self._mode)
            return has_pose and self._publisher.get_subscription_count() > 0

        what = f'a controller that moves the tool, such as {controller}, in {this_domain()}'
        missing = f'no controller publishes the pose of the tool: start a bridge and {what}'
        self._find_controller(is_there, 1.0, timeout, lambda: on_wait(what), missing)

    def _on_pose(self, message: PoseStamped) -> None:
        self._pose = message


_NO_CONTACT, _CONTACT = 'none', 'contact'  # values of world_control's `Phase`
_FORCE_TOLERANCE = 0.5  # [N] with which the estimated force counts as reached


class PressRequest(_MotionRequest):
    """Press the tool on a wall: publish a force, and wait until `world_control` measures it.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions; no executor may contain it.
    """

    _TOPIC = topics.TOOL_FORCE

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self._reports = 0
        self._phase, self._force, self._text = '', 0.0, ''
        topics.DIAGNOSTICS.subscription(node, self._on_diagnostics)

    def press(
        self,
        force: Sequence[float],
        timeout: float,
        on_wait: Callable[[str], None] = lambda _: None,
    ) -> str:
        """Publish a force (3,) on the wall in the world frame [N], and return the result.

        Parameters
        ----------
        timeout
            Longest time to find `world_control`, and again for approach and rise of the force [s].
        on_wait
            Called with a description of the missing node.

        Raises
        ------
        ArmClientError
            If `world_control` does not run, rejects the force, or does not reach the force.
        """
        self._find(timeout, on_wait)
        message = WrenchStamped()
        f = message.wrench.force
        f.x, f.y, f.z = (float(x) for x in force)
        self._rejections.begin(timeout)
        before, wanted = self._reports, float(np.linalg.norm(force))
        self._publisher.publish(message)

        def ended() -> bool:
            if self._reports < before + 2:
                return False  # the first report may be older than the force
            reached = abs(self._force - wanted) <= _FORCE_TOLERANCE
            return self._phase == _NO_CONTACT or self._phase == _CONTACT and reached

        in_time = self._wait(ended, timeout)
        if wanted == 0.0 and self._phase == _NO_CONTACT:
            return 'the contact has ended'
        if self._phase == _NO_CONTACT:
            raise ArmClientError(self._text)
        if not in_time:
            raise ArmClientError(
                f'the estimated force is {self._force:.1f} N after {timeout:g} s, in the phase '
                f"'{self._phase}': check the wall. To end the motion, run 'arm press 0 0 0'"
            )
        return f'the tool presses with {self._force:.1f} N'

    def _find(self, timeout: float, on_wait: Callable[[str], None]) -> None:
        """Wait until `world_control` subscribes to forces and publishes diagnostics."""

        def is_there() -> bool:
            return bool(self._publisher.get_subscription_count() and self._reports and self._mode)

        missing = (
            'no controller accepts a tool force: start a bridge, and start world_control with an '
            f'observer_gain above 0, in {this_domain()}'
        )
        what = f'world_control in {this_domain()}'
        self._find_controller(is_there, _REPORT, timeout, lambda: on_wait(what), missing)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if TOOL_FORCE_PHASE in values:
                self._reports += 1
                self._phase, self._text = values[TOOL_FORCE_PHASE], status.message
                self._force = float(values[TOOL_FORCE])
