"""A motion of an arm that sends each state after the answer to the previous one."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

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


@contextmanager
def played(
    arm: LockstepArm,
    playback: MotionPlayback,
    player: ExcitationPlayer,
    listener: Callable[..., object] = lambda *_: None,
) -> Iterator[tuple[threading.Thread, list[str]]]:
    """Play a motion in a thread, and end it; yields the thread and the texts of its errors."""
    problems: list[str] = []

    def play() -> None:
        try:
            playback.play(player, LIMIT, listener)
        except ExcitationError as error:
            problems.append(str(error))

    thread = threading.Thread(target=play, daemon=True)
    with BackgroundExecutor(playback._node):
        until(lambda: playback._conditions.mode in COMMANDABLE)
        thread.start()
        yield thread, problems
        playback.ask_stop()
        while thread.is_alive():
            arm.tell()
            until(lambda: arm.is_answered() or not thread.is_alive())
        thread.join()
    playback.destroy()


def heard_by(node: Node) -> tuple[LockstepArm, MotionPlayback]:
    arm, playback = LockstepArm(), MotionPlayback(node, NAMES)
    until(arm.is_heard)
    return arm, playback


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
    arm, playback = heard_by(ros_node)
    arm.tell()
    until(lambda: playback.states.wait(0.05) and playback.states.newest_state())
    for _ in range(10):  # while the motion is planned
        arm.tell()
    with played(arm, playback, player):
        until(lambda: arm.tell(0) or arm.is_answered())  # as one whose world stands
        assert playback.states.lost == 0
        for _ in range(ANSWERED):
            arm.tell()
            until(arm.is_answered)
        assert playback.states.lost == 0
    assert player.state is PlayState.STOPPED


@pytest.mark.parametrize('held_up', ['state', 'answer'])
def test_a_motion_does_not_begin_while_states_or_answers_are_delayed(
    ros_node: Node, player: ExcitationPlayer, held_up: str
) -> None:
    arm, playback = heard_by(ros_node)
    answered: list[int] = []
    arm.tell()
    until(lambda: playback.states.wait(0.05))
    with played(arm, playback, player, lambda stamp_ns, *_: answered.append(stamp_ns)):
        until(lambda: playback._seen_ns is not None)  # that one is taken, and nothing follows
        if held_up == 'answer':
            arm.tell()
            until(lambda: arm.tell(0) or arm.is_answered())
        arm.tell(STEPS_MISSED)
        begun = arm.number + 1
        until(lambda: arm.tell() or arm.is_answered())
    assert player.state is PlayState.STOPPED
    assert answered[0] >= 10_000_000_000 + 1_000_000 * begun


def test_repeatedly_jumping_stamps_are_reported(ros_node: Node, player: ExcitationPlayer) -> None:
    arm, playback = heard_by(ros_node)
    with played(arm, playback, player) as (thread, problems):
        until(lambda: arm.tell(STEPS_MISSED) or not thread.is_alive())
    assert 'joint state stamps jump by' in problems[0]


@pytest.mark.parametrize(
    ('modes', 'motion', 'damped'),
    [
        (((0, 'running'), (2, 'damping'), (2.5, 'running'), (4, 'damping'), (5, 'running')),
            (0.0, 10.0), (2, 1.5)),
        (((0, 'damping'), (1, 'running'), (9, 'damping')), (1.0, 9.0), (0, 0.0)),
        (((0, 'damping'), (2, 'running'), (8, 'damping')), (1.0, 9.0), (2, 2.0)),
    ],
    ids=['within', 'outside', 'across the ends'],
)  # fmt: skip
def test_damping_is_counted_during_the_motion(
    modes: tuple[tuple[float, str], ...], motion: tuple[float, float], damped: tuple[int, float]
) -> None:
    account = DampingAccount()
    for when, mode in modes:
        account.note(mode, round(when * 1e9))
    account.begin_ns, account.end_ns = (round(end * 1e9) for end in motion)
    times, seconds = damped
    assert account.damped == (times, pytest.approx(seconds))
    assert account.share == pytest.approx(seconds / (motion[1] - motion[0]))
    said = f'the bridge damped the arm {times} times, for {seconds:.2f} s ({account.share:.1%} of'
    assert account.text.startswith(said) if times else account.text == ''
