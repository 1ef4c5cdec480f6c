"""Wait until the arm is ready and at rest, and play a planned motion."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.excitation.player import ExcitationPlayer
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.hardware.bridge_modes import COMMANDABLE, NOT_ACTIVE, to_switch_on
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.ros.diagnostics import WaitingNotice
from aerarm_ros.ros.graph import DuplicatePublisherCheck, SilencePatience
from aerarm_ros.ros.process.process_end import ProgressLine
from aerarm_ros.ros.states.arm_clock import monotonic_ns
from aerarm_ros.ros.states.state_stream import StateStream

_DAMPED = 'damping'


class DampingAccount:
    """Count how often and for how long the bridge damped the arm during a motion.

    If commands arrive too late, the bridge damps the arm until the next command. The motion then
    continues, but it deviates from the plan.

    Attributes
    ----------
    begin_ns, end_ns
        Begin and end of the motion on the monotonic clock [ns].
    """

    def __init__(self) -> None:
        self._modes: list[tuple[int, str]] = []
        self.begin_ns = self.end_ns = 0

    def note(self, mode: str, now_ns: int) -> None:
        """Store a mode of the arm and its reception time [ns]; callable from any thread."""
        if not self._modes or mode != self._modes[-1][1]:
            self._modes.append((now_ns, mode))

    @property
    def damped(self) -> tuple[int, float]:
        """Number and total duration [s] of the intervals in which the bridge damped the arm."""
        modes = sorted(self._modes)
        ends = [when for when, _ in modes[1:]] + [self.end_ns]
        durations = [
            min(stop, self.end_ns) - max(start, self.begin_ns)
            for (start, mode), stop in zip(modes, ends, strict=True)
            if mode == _DAMPED
        ]
        inside = [duration for duration in durations if duration > 0]
        return len(inside), 1e-9 * sum(inside)

    @property
    def share(self) -> float:
        """Fraction of the motion's duration in which the bridge damped the arm (0 to 1)."""
        duration = 1e-9 * (self.end_ns - self.begin_ns)
        return self.damped[1] / duration if duration > 0.0 else 0.0

    @property
    def text(self) -> str:
        """Sentence on how often and how long the bridge damped the arm; '' without damping."""
        times, seconds = self.damped
        if not times:
            return ''
        often = 'once' if times == 1 else f'{times} times'
        share = f'{self.share:.1%} of the motion'
        return f'the bridge damped the arm {often}, for {seconds:.2f} s ({share})'


# In this mode the bridge holds the arm, and no other node commands the arm.
MOVABLE = 'ready'
# Recovery hints for modes in which a motion cannot start.
_ADVICE = {
    'inactive': NOT_ACTIVE,
    'disconnected': 'the boards do not respond, so check the log of the bridge',
    'aligning': 'wait a few seconds until the motors are aligned',
    'homing': 'wait a few seconds until the joints have reached their index pulses',
    'unhomed': f'run {to_switch_on("unhomed")} (the arm moves)',
    'commissioning': "wait for the end of 'arm commission', then run 'arm home'",
    'running': 'stop the node that commands the arm',
    'damping': "run 'arm hold', which holds the arm in place",
}
# [s] in which all nodes of the domain have announced themselves (config/fastdds.xml).
_DISCOVERY_TIME = 0.5
_DEPTH = 100  # queue length in messages: every mode counts, however fast they change
_ENABLE = "run 'arm enable' (the arm moves)"


class StartConditions:
    """Check the conditions for the start of a motion, from `arm_mode` and `recorder_status`.

    An executor must spin the node, so that the messages arrive.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    commands
        Publisher of joint_command.
    recorder
        Whether a recorder must record joint_command and joint_states.
    on_mode
        Called with each arm_mode and its reception time [ns, monotonic].

    Attributes
    ----------
    mode
        Last arm_mode, '' before the first.
    """

    def __init__(
        self, node: Node, commands: Publisher, recorder: bool, on_mode: Callable[[str, int], None]
    ) -> None:
        self.mode = ''
        self._discovered = time.monotonic() + _DISCOVERY_TIME
        self._node = node
        self._commands = commands
        self._recorder = recorder
        self._recorded: set[str] = set()
        self._store_mode = on_mode
        self._sources = DuplicatePublisherCheck(node, topics.JOINT_STATES)
        topic = topics.ARM_MODE.queued(_DEPTH)
        node.create_subscription(topic.type, topic.name, self._on_mode, topic.qos)
        topics.RECORDER_STATUS.subscription(node, self._on_recorder_status)

    def missing(self) -> list[str]:
        """Return one phrase for each start condition that is not met.

        Raises
        ------
        ExcitationError
            If the arm is in mode `fault`, because a fault does not end by waiting.
        """
        if self.mode == 'fault':
            raise ExcitationError(
                "arm_mode is fault: check the log of the bridge, then run 'arm clear_fault'"
            )
        if not self.mode:
            return ['no arm_mode received: check that a bridge runs in this ROS domain']
        missing = list(filter(None, [self._sources.problem()]))
        if time.monotonic() < self._discovered:
            missing.append('the search for other bridges has not finished')
        if self.mode != MOVABLE:
            missing.append(f"arm_mode is '{self.mode}': {_ADVICE.get(self.mode, _ENABLE)}")
        if not self._commands.get_subscription_count():
            missing.append('no node subscribes to joint_command: check that the bridge runs')
        unrecorded = [
            topic.name
            for topic in (topics.JOINT_COMMAND, topics.JOINT_STATES)
            if self._node.resolve_topic_name(topic.name) not in self._recorded
        ]
        if self._recorder and unrecorded:
            missing.append(
                f"no recorder records {' and '.join(unrecorded)}: run 'recorder' in this ROS domain"
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
            self._node.get_logger().warning(
                f'ignored an invalid message on recorder_status ({error}): check its publisher'
            )


# [rad/s] A slower joint counts as resting. The noise of the velocity filter is smaller.
RESTING = 0.1
_START_STATES = 20  # after this number of joint states the motion starts in any case

Listener = Callable[[int, ArmState, bytes], None]


class MotionPlayback:
    """Publish one command per joint state during a motion.

    An executor must spin the node, so that the messages arrive.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions.
    joint_names
        Joint names in the order of all arrays.
    recorder
        Whether a recorder must record the motion.
    on_rejection
        Called with the reason for which a joint state cannot be used.

    Attributes
    ----------
    stop_asked
        Whether a stop was requested.
    states
        The stream of joint states.
    damping
        How often and how long the bridge damped the arm during the motion.
    latency_ns
        Time from the publication of the last joint state until its command was computed [ns].
    """

    def __init__(
        self,
        node: Node,
        joint_names: tuple[str, ...],
        recorder: bool = False,
        on_rejection: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.stop_asked = False
        self._node = node
        self._name = node.get_name()
        self._logger = node.get_logger()
        self._codec = JointStateCdr(joint_names)
        self._commands = topics.JOINT_COMMAND.publisher(node)
        self.damping = DampingAccount()
        self._conditions = StartConditions(node, self._commands, recorder, self.damping.note)
        self._rejection = ''
        self._answered_ns: int | None = None
        self._seen_ns: int | None = None
        self._states_left = _START_STATES
        self._has_begun = False
        self.latency_ns = 0
        self._on_rejection = on_rejection
        self._patience = SilencePatience(node, node.resolve_topic_name(topics.JOINT_STATES.name))
        self.states = StateStream(node, joint_names, self._reject, imu=False)

    def wait_for_arm(self, timeout: float) -> NDArray[np.float64] | None:
        """Wait until the arm is ready and at rest; return its joint positions (n,) [rad].

        The result is None if a stop was requested.

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
                raise ExcitationError(
                    f'the motion could not start within {timeout:g} s: {"; ".join(reasons)}'
                )
            self.states.wait(0.1)
            newest = self.states.newest_state()
            state = state if newest is None else newest[1]
        return None

    def play(self, player: ExcitationPlayer, silence: float, listener: Listener) -> None:
        """Answer every joint state with a command until the motion has ended or was stopped.

        Parameters
        ----------
        player
            Player of the motion.
        silence
            Longest time without a joint state [s]. For an emulated arm the limit is longer, because
            the arm's time pauses while the computer is busy.
        listener
            Called with the stamp [ns] of each joint state, the joint state and the serialized
            command.

        Raises
        ------
        ExcitationError
            If joint states stop arriving, the arm is stopped, or the arm does not follow.
        """
        progress = ProgressLine(self._name)
        received = time.monotonic()
        self.damping.begin_ns = self.damping.end_ns = time.monotonic_ns()
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
            # A signal that stops all nodes also ends the bridge, which does not wait for them.
            self._logger.info(f'the node stopped, but the arm may still move: {error}')
        finally:
            self.damping.end_ns = time.monotonic_ns()
            progress.close()
        if player.fault is not None:
            raise ExcitationError(player.fault)

    def ask_stop(self) -> None:
        """Request a stop of the motion; callable from a signal handler."""
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
        # During a pause of this process the bridge damps the arm until the next command. The
        # tracking error shows how much the motion deviates then.
        if self._conditions.mode not in COMMANDABLE:
            raise ExcitationError(
                f'the motion ended in the {stage}, because arm_mode changed to '
                f"'{self._conditions.mode}': check the log of the bridge, or the page of view"
            )

    def _is_in_touch(self, stamp_ns: int, silence: float) -> bool:
        """Return whether this joint state needs a command; decide whether the motion starts now.

        The motion starts when a joint state arrives shortly after an answered one. Before the
        motion, the player commands the arm to stay. If the motion started earlier, a jump of the
        stamps would end it. On a busy host the newest joint state after planning may be seconds
        old, and a first publication may be one second late (docs/decisions.md, 69).
        """
        before_ns, self._seen_ns = self._seen_ns, stamp_ns
        self._states_left -= stamp_ns != before_ns
        is_recent = before_ns is not None and 0 <= stamp_ns - before_ns <= round(1e9 * silence)
        is_answered = before_ns is not None and self._answered_ns == before_ns
        # If the stamps keep jumping, the player reports the jumps.
        self._has_begun = (is_recent and is_answered) or self._states_left <= 0
        # Lost joint states before the motion are not counted.
        self.states.begin_count()
        return self._has_begun or is_recent

    def _check_silence(self, received: float, silence: float, stage: str) -> None:
        silent_for = time.monotonic() - received
        if silent_for <= silence:
            return
        timeout = self._patience.limit(silence)
        if silent_for > timeout:
            why = self._rejection or (
                'check that the bridge runs and that the computer is not overloaded, or increase '
                'state_timeout'
            )
            raise ExcitationError(f'no joint state arrived for {timeout:g} s in the {stage}: {why}')

    def _reject(self, reason: str) -> None:
        self._rejection = reason
        self._on_rejection(reason)


def _missing_rest(state: ArmState | None) -> list[str]:
    if state is None:
        return ['no joint_states received: check that a bridge runs in this ROS domain']
    if np.abs(state.dq).max() >= RESTING:
        return [f'the arm moves (a joint is faster than {RESTING} rad/s): wait until the arm rests']
    return []


def _progress_text(player: ExcitationPlayer) -> str:
    return (
        f'{player.path_time:5.1f} of {player.motion.duration:.1f} s  {player.stage:<10} '
        f'largest tracking error {player.largest_error.max():.3f} rad'
    )
