"""Wait for an arm at rest, and play a planned motion."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.topics import Topic
from aerarm_ros.excitation.player import ExcitationPlayer
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.hardware.bridge_modes import COMMANDABLE, to_switch_on
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.ros.diagnostics import WaitingNotice
from aerarm_ros.ros.graph import DuplicatePublisherCheck, SilencePatience
from aerarm_ros.ros.process.process_end import ProgressLine
from aerarm_ros.ros.states.arm_clock import monotonic_ns
from aerarm_ros.ros.states.state_stream import StateStream

_DAMPED = 'damping'


class DampingAccount:
    """Count how often and for how long a bridge damped the arm during a motion.

    A bridge damps the arm if commands come too late, and follows the next command. The motion then
    continues, but differs from the plan. Times are on the monotonic clock.
    """

    def __init__(self) -> None:
        self._modes: list[tuple[int, str]] = []
        self._begin = self._end = 0

    def note(self, mode: str, now_ns: int) -> None:
        """Store a mode of the bridge and its reception time [ns]; callable from any thread."""
        self._modes.append((now_ns, mode))

    def begin(self, now_ns: int) -> None:
        """Store the start of the motion [ns]."""
        self._begin = self._end = now_ns

    def end(self, now_ns: int) -> None:
        """Store the end of the motion [ns]."""
        self._end = now_ns

    @property
    def damped(self) -> tuple[int, float]:
        """Number and total duration [s] of the bridge's damping during the motion."""
        times, total = 0, 0
        modes = sorted(self._modes)
        ends = [when for when, _ in modes[1:]] + [self._end]
        before = ''
        for (start, mode), stop in zip(modes, ends, strict=True):
            overlap = min(stop, self._end) - max(start, self._begin)
            if mode == _DAMPED and overlap > 0:
                total += overlap
                times += before != _DAMPED
            before = mode
        return times, 1e-9 * total

    @property
    def share(self) -> float:
        """Fraction of the motion's time during which the arm was damped, 0 to 1."""
        duration = 1e-9 * (self._end - self._begin)
        return self.damped[1] / duration if duration > 0.0 else 0.0

    @property
    def text(self) -> str:
        """Number and duration of damping as text, or an empty text."""
        times, seconds = self.damped
        if not times:
            return ''
        often = 'once' if times == 1 else f'{times} times'
        share = f'{self.share:.1%} of the motion'
        return f'the bridge damped the arm {often}, for {seconds:.2f} s ({share})'


# In this mode the bridge holds the arm, and no controller commands it.
MOVABLE = 'ready'
# Recovery hints for modes in which the arm follows no command.
_ADVICE = {
    'inactive': "activate the bridge: 'ros2 lifecycle set /NAME activate'",
    'disconnected': 'the boards do not respond: check the log of the bridge',
    'aligning': 'the motors will be aligned in a few seconds',
    'homing': 'the joints will reach their index pulses in a few seconds',
    'unhomed': f'run {to_switch_on("unhomed")} (the arm moves)',
    'commissioning': "the arm is being commissioned: wait, then 'arm home'",
    'running': 'another node commands the arm: stop that node',
    'damping': "run 'arm hold', which holds the arm in place",
}
# [s] in which all nodes of the domain have announced themselves (config/fastdds.xml).
_DISCOVERY_TIME = 0.5
_DEPTH = 100  # queue length in messages
_LISTENERS = {
    topics.JOINT_COMMAND.name: 'check that the bridge runs, and the recorder if used',
    topics.JOINT_STATES.name: 'check that the recorder runs',
}
_ENABLE = "run 'arm enable' (the arm moves)"


def _all_of(topic: Topic) -> QoSProfile:
    return QoSProfile(
        depth=_DEPTH, reliability=topic.qos.reliability, durability=topic.qos.durability
    )


class StartConditions:
    """Follow arm_mode and recorder_status, and report missing conditions.

    The callbacks need an executor that spins the node.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    commands
        Publisher of joint_command.
    subscribers
        Required number of subscribers of joint_command and joint_states.
    recorder
        Whether the recorder must have discovered both topics.
    on_mode
        Called with each arm_mode and its reception time [ns, monotonic].

    Attributes
    ----------
    mode
        Last arm_mode, '' before the first.
    """

    def __init__(
        self,
        node: Node,
        commands: Publisher,
        subscribers: int,
        recorder: bool,
        on_mode: Callable[[str, int], None],
    ) -> None:
        self.mode = ''
        self._discovered = time.monotonic() + _DISCOVERY_TIME
        self._node = node
        self._commands = commands
        self._subscribers = subscribers
        self._recorder = recorder
        self._recorded: set[str] = set()
        self._store_mode = on_mode
        self._sources = DuplicatePublisherCheck(node, topics.JOINT_STATES)
        for topic, callback in (
            (topics.ARM_MODE, self._on_mode),
            (topics.RECORDER_STATUS, self._on_recorder_status),
        ):
            # Every mode counts, however fast they change.
            node.create_subscription(topic.type, topic.name, callback, _all_of(topic))

    def missing(self) -> list[str]:
        """Return the missing conditions, one phrase each.

        Raises
        ------
        ExcitationError
            If the arm is in fault, which waiting cannot repair.
        """
        if self.mode == 'fault':
            raise ExcitationError(
                "arm_mode is fault: check the log of the bridge, then run 'arm clear_fault'"
            )
        if not self.mode:
            return ['no arm_mode received: check that a bridge runs in this ROS domain']
        missing = list(filter(None, [self._sources.problem()]))
        if time.monotonic() < self._discovered:
            missing.append('the node searches for other bridges')
        if self.mode != MOVABLE:
            missing.append(f"arm_mode is '{self.mode}': {_ADVICE.get(self.mode, _ENABLE)}")
        matched = {
            topics.JOINT_COMMAND.name: self._commands.get_subscription_count(),
            topics.JOINT_STATES.name: self._node.count_subscribers(topics.JOINT_STATES.name),
        }
        for name, count in matched.items():
            if count < self._subscribers:
                missing.append(
                    f'{name} has {count} of {self._subscribers} subscribers ({_LISTENERS[name]})'
                )
        resolve = self._node.resolve_topic_name
        unrecorded = [name for name in matched if resolve(name) not in self._recorded]
        if self._recorder and unrecorded:
            missing.append(
                f"{' and '.join(unrecorded)} not being recorded: run 'recorder' in this ROS domain"
            )
        return missing

    def _on_mode(self, message: String, info: Mapping[str, int]) -> None:
        self.mode = message.data
        self._store_mode(message.data, monotonic_ns(info['received_timestamp']))

    def _on_recorder_status(self, message: String) -> None:
        try:
            status = json.loads(message.data)
            recording = status['state'] == 'recording'
            self._recorded = set(status['matched']) if recording else set()
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            self._node.get_logger().warning(f'recorder_status is invalid: {error}')


# [rad/s] A slower joint counts as resting; the noise of the velocity filter is smaller.
RESTING = 0.1
_LOOKS = 20  # largest number of states until the motion starts

Listener = Callable[[int, ArmState, bytes], None]


class MotionPlayback:
    """Publish one command for every joint state of a motion.

    The callbacks need an executor that spins the node.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions.
    joint_names
        Joint names in the order of all arrays.
    subscribers, recorder
        Further start conditions, see `StartConditions`.
    on_rejection
        Called with the reason of each state that cannot be used.

    Attributes
    ----------
    stop_asked
        Whether a stop was requested.
    states
        The stream of joint states.
    damping
        Number and duration of the bridge's damping during the motion.
    latency_ns
        Time from the publication of the last answered state to its finished command [ns].
    """

    def __init__(
        self,
        node: Node,
        joint_names: tuple[str, ...],
        subscribers: int = 1,
        recorder: bool = False,
        on_rejection: Callable[[str], None] | None = None,
    ) -> None:
        self.stop_asked = False
        self._node = node
        self._name = node.get_name()
        self._logger = node.get_logger()
        self._codec = JointStateCdr(joint_names)
        command = topics.JOINT_COMMAND
        self._commands = node.create_publisher(command.type, command.name, command.offered)
        self.damping = DampingAccount()
        self._conditions = StartConditions(
            node, self._commands, subscribers, recorder, self.damping.note
        )
        self._rejection = ''
        self._answered_ns: int | None = None
        self._seen_ns: int | None = None
        self._looks = _LOOKS
        self._has_begun = False
        self.latency_ns = 0
        self._on_rejection = on_rejection
        self._patience = SilencePatience(node, node.resolve_topic_name(topics.JOINT_STATES.name))
        self.states = StateStream(node, joint_names, self._reject, imu=False)

    def wait_for_arm(self, timeout: float) -> NDArray[np.float64] | None:
        """Return the posture (n,) [rad] once the arm is ready and at rest; None after a stop.

        Raises
        ------
        ExcitationError
            If the conditions are not met within `timeout` [s]; the message states what is missing.
        """
        begin = time.monotonic()
        notice = WaitingNotice(begin)
        state: ArmState | None = None
        while not self.stop_asked:
            missing = self._conditions.missing() or _missing_rest(state)
            now = time.monotonic()
            text = notice.update(missing, now)
            if text:
                self._logger.info(text)
            if not missing and state is not None:
                return state.q
            if now - begin > timeout:
                reasons = [*missing, self._rejection] if self._rejection else missing
                raise ExcitationError(f'waited {timeout:g} s, but {"; ".join(reasons)}')
            self.states.wait(0.1)
            newest = self.states.newest_state()
            state = state if newest is None else newest[1]
        return None

    def play(self, player: ExcitationPlayer, silence: float, listener: Listener) -> None:
        """Answer every state until the motion has ended or was stopped.

        Parameters
        ----------
        player
            Player of the motion.
        silence
            Longest time without a joint state [s]. For an emulated arm the limit is longer, because
            the arm's time pauses when the host is busy.
        listener
            Called with stamp [ns], state and the serialized command that answers the state.

        Raises
        ------
        ExcitationError
            If the states stop arriving, the arm is stopped, or does not follow.
        """
        progress = ProgressLine(self._name)
        received = time.monotonic()
        self.damping.begin(time.monotonic_ns())
        try:
            while not player.done:
                self.states.wait(silence)
                newest = self.states.newest_state()
                if newest is None:
                    self._check_silence(received, silence, player.stage)
                    continue
                received = time.monotonic()
                if self.stop_asked:
                    player.stop()
                self._check_mode(player.stage)
                if self.states.answers.again():
                    continue
                if self._has_begun or self._is_in_touch(newest[0], silence):
                    self._answer(player, *newest, listener)
                if progress.due(newest[0], player.stage):
                    progress.show(_progress_text(player))
        except ExcitationError as error:
            if not self.stop_asked:
                raise
            # A stop of all nodes also ends the bridge, which waits for no other node.
            self._logger.info(f'stopped, but the arm may still move: {error}')
        finally:
            self.damping.end(time.monotonic_ns())
            progress.close()
        if player.fault is not None:
            raise ExcitationError(player.fault)

    def ask_stop(self) -> None:
        """Request that the arm comes to rest; callable from a signal handler."""
        self.stop_asked = True

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self.states.destroy()

    def _answer(
        self, player: ExcitationPlayer, stamp_ns: int, state: ArmState, listener: Listener
    ) -> None:
        self._answered_ns = stamp_ns
        moves = self._has_begun
        command = player.update(stamp_ns, state.q) if moves else player.hold(state.q)
        payload = self._codec.pack(stamp_ns, *command)
        self.latency_ns = self.states.latency_ns()
        self.states.answers.publish(self._commands, payload)
        if moves:
            listener(stamp_ns, state, payload)

    def _check_mode(self, stage: str) -> None:
        # A pause of this process makes the bridge damp the arm until the next command. The
        # tracking error shows the effect of the pause on the motion.
        if self._conditions.mode not in COMMANDABLE:
            raise ExcitationError(
                f"arm_mode became '{self._conditions.mode}' in the {stage}: check the log of the "
                'bridge, or the page of view'
            )

    def _is_in_touch(self, stamp_ns: int, silence: float) -> bool:
        """Return whether to answer a state before the motion; start the motion if it is recent.

        If the motion started before states and answers arrive in time, a jump of the stamps would
        end it. On a busy host the newest state after planning may be seconds old, and a first
        publication may be one second late (docs/decisions.md, 69). The player therefore commands
        the arm to stay until a state arrives shortly after an answered one.
        """
        before_ns, self._seen_ns = self._seen_ns, stamp_ns
        self._looks -= stamp_ns != before_ns
        is_recent = before_ns is not None and 0 <= stamp_ns - before_ns <= round(1e9 * silence)
        is_answered = before_ns is not None and self._answered_ns == before_ns
        # If stamps jump all the time, the code that reads the states reports it.
        self._has_begun = (is_recent and is_answered) or self._looks <= 0
        # States before the motion do not count as unanswered.
        self.states.begin_count()
        return self._has_begun or is_recent

    def _check_silence(self, received: float, silence: float, stage: str) -> None:
        silent_for = time.monotonic() - received
        if silent_for <= silence:
            return
        timeout = self._patience.limit(silence)
        if silent_for > timeout:
            why = self._rejection or (
                'check that the bridge runs and that the computer is not overloaded; '
                'state_timeout lengthens the wait'
            )
            raise ExcitationError(f'no joint state for {timeout:g} s in the {stage}, {why}')

    def _reject(self, reason: str) -> None:
        self._rejection = reason
        if self._on_rejection is not None:
            self._on_rejection(reason)


def _missing_rest(state: ArmState | None) -> list[str]:
    if state is None:
        return ['no joint_states received: check that the bridge runs in this domain']
    if np.abs(state.dq).max() >= RESTING:
        return [f'the arm moves (a joint speed exceeds {RESTING} rad/s): wait until the arm rests']
    return []


def _progress_text(player: ExcitationPlayer) -> str:
    return (
        f'{player.path_time:5.1f} of {player.motion.duration:.1f} s  {player.stage:<10} '
        f'largest error {player.largest_error.max():.3f} rad'
    )
