"""A motion of an arm that sends each state after the answer to the previous one."""

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.excitation.feasibility import StopLimits
from aerarm_ros.excitation.player import ExcitationPlayer, PlayState, VelocityLaw
from aerarm_ros.excitation.settings import ExcitationError, MotionLimits
from aerarm_ros.excitation.trajectory import (
    FourierTrajectory,
    MotionSequence,
    RampedExcitation,
    Stage,
)
from aerarm_ros.hardware.bridge_modes import COMMANDABLE
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.playback.motion_playback import DampingAccount, MotionPlayback

LIMIT = 60.0  # [s] of the host, which may be busy
NAMES = ('joint1', 'joint2')
ANSWERED = 20  # states
STEPS_MISSED = 1000 * (1 + round(LIMIT))


class LockstepArm:
    """Publish a bridge's topics, and wait for each answer."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('bridge')
        self.number = 0
        self._states = self._publisher(topics.JOINT_STATES)
        self._modes = self._publisher(topics.ARM_MODE)
        self._commands = RawReader(self.node, topics.JOINT_COMMAND)
        self._modes.publish(String(data='ready'))

    def is_heard(self) -> bool:
        return bool(self._states.get_subscription_count() and self._commands.publishers())

    def tell(self, steps: int = 1) -> None:
        """Publish the next state of an arm at rest, or the last one again."""
        self.number += steps
        state = JointState(name=NAMES, position=[0.0, 0.0], velocity=[0.0, 0.0])
        state.header.stamp.sec, millisecond = 10 + self.number // 1000, self.number % 1000
        state.header.stamp.nanosec = 1_000_000 * millisecond
        self._states.publish(state)

    def is_answered(self) -> bool:
        return self._commands.wait(0.05) and self._commands.take_newest() is not None

    def _publisher(self, topic):
        return self.node.create_publisher(topic.type, topic.name, topic.offered)


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.001)


def end(playing: threading.Thread, arm: LockstepArm) -> None:
    """Publish states until no node answers."""
    while playing.is_alive():
        arm.tell()
        until(lambda: arm.is_answered() or not playing.is_alive())
    playing.join()


@pytest.fixture
def player() -> ExcitationPlayer:
    still = FourierTrajectory(0.1, np.zeros(2), np.zeros((2, 1)), np.zeros((2, 1)))
    motion = MotionSequence([Stage('excitation', RampedExcitation(still, 1, 1.0))])
    one = np.ones(2)
    limits = MotionLimits(NAMES, -one, one, one, one, one, one)
    return ExcitationPlayer(motion, VelocityLaw(0.0), StopLimits(limits, None))


def test_states_before_the_motion_do_not_count_as_unanswered(
    ros_node: Node, player: ExcitationPlayer
) -> None:
    arm, playback = LockstepArm(), MotionPlayback(ros_node, NAMES)
    until(arm.is_heard)
    arm.tell()
    until(lambda: playback.states.wait(0.05) and playback.states.newest_state())
    for _ in range(10):  # while the motion is planned
        arm.tell()
    with BackgroundExecutor(ros_node):
        until(lambda: playback._conditions.mode in COMMANDABLE)
        playing = threading.Thread(
            target=playback.play, args=(player, LIMIT, lambda *_: None), daemon=True
        )
        playing.start()
        until(lambda: arm.tell(0) or arm.is_answered())  # as one whose world stands
        assert playback.states.lost == 0
        for _ in range(ANSWERED):
            arm.tell()
            until(arm.is_answered)
        assert playback.states.lost == 0
        playback.ask_stop()
        end(playing, arm)
    assert player.state is PlayState.STOPPED
    playback.destroy()


@pytest.mark.parametrize('held_up', ['state', 'answer'])
def test_a_motion_does_not_begin_while_states_or_answers_are_delayed(
    ros_node: Node, player: ExcitationPlayer, held_up: str
) -> None:
    arm, playback = LockstepArm(), MotionPlayback(ros_node, NAMES)
    until(arm.is_heard)
    answered: list[int] = []
    with BackgroundExecutor(ros_node):
        until(lambda: playback._conditions.mode in COMMANDABLE)
        arm.tell()
        until(lambda: playback.states.wait(0.05))
        playing = threading.Thread(
            target=playback.play,
            args=(player, LIMIT, lambda stamp_ns, *_: answered.append(stamp_ns)),
            daemon=True,
        )
        playing.start()
        until(lambda: playback._seen_ns is not None)  # that one is taken, and nothing follows
        if held_up == 'answer':
            arm.tell()
            until(lambda: arm.tell(0) or arm.is_answered())
        arm.tell(STEPS_MISSED)
        begun = arm.number + 1
        until(lambda: arm.tell() or arm.is_answered())
        playback.ask_stop()
        end(playing, arm)
    assert player.state is PlayState.STOPPED
    assert answered[0] >= 10_000_000_000 + 1_000_000 * begun
    playback.destroy()


def test_repeatedly_jumping_stamps_are_reported(ros_node: Node, player: ExcitationPlayer) -> None:
    arm, playback = LockstepArm(), MotionPlayback(ros_node, NAMES)
    until(arm.is_heard)
    problems: list[str] = []

    def play() -> None:
        try:
            playback.play(player, LIMIT, lambda *_: None)
        except ExcitationError as error:
            problems.append(str(error))

    with BackgroundExecutor(ros_node):
        until(lambda: playback._conditions.mode in COMMANDABLE)
        playing = threading.Thread(target=play, daemon=True)
        playing.start()
        until(lambda: arm.tell(STEPS_MISSED) or not playing.is_alive())
        playing.join()
    assert 'joint state stamps jump by' in problems[0]
    playback.destroy()


SECOND = 10**9


def account(*modes: tuple[float, str], begin: float = 0.0, end: float = 10.0) -> DampingAccount:
    account = DampingAccount()
    for when, mode in modes:
        account.note(mode, round(when * SECOND))
    account.begin_ns, account.end_ns = round(begin * SECOND), round(end * SECOND)
    return account


def test_each_time_is_counted_with_its_length() -> None:
    shaken = account(
        (0, 'running'), (2, 'damping'), (2.5, 'running'), (4, 'damping'), (5, 'running')
    )
    assert shaken.damped == (2, pytest.approx(1.5))
    assert shaken.share == pytest.approx(0.15)
    assert shaken.text == 'the bridge damped the arm 2 times, for 1.50 s (15.0% of the motion)'


def test_only_the_motion_counts() -> None:
    outside = account((0, 'damping'), (1, 'running'), (9, 'damping'), begin=1.0, end=9.0)
    assert outside.damped == (0, 0.0)
    across = account((0, 'damping'), (2, 'running'), (8, 'damping'), begin=1.0, end=9.0)
    assert across.damped == (2, pytest.approx(2.0))
