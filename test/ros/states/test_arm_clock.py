"""The arm's time in a node, while the system clock is set."""

import time

import pytest
from quick_spinning import spin_once
from rclpy.node import Node
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_ros.ros.states import arm_clock
from aerarm_ros.ros.states.arm_clock import ArmClock

SET = 2 * 10**9  # [ns]
SPREAD = 0.4e9  # [ns] a busy host's, far from a step


class SystemTime:
    """`time`, with a system clock that can be set."""

    monotonic_ns = staticmethod(time.monotonic_ns)

    def __init__(self) -> None:
        self.ahead = 0

    def time_ns(self) -> int:
        return time.time_ns() + self.ahead


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> SystemTime:
    system = SystemTime()
    monkeypatch.setattr(arm_clock, 'time', system)
    return system


@pytest.mark.parametrize('step', [SET, -SET])
def test_the_time_is_that_of_the_stamps_while_there_are_states(
    ros_node: Node, system: SystemTime, step: int
) -> None:
    clock = ArmClock(ros_node)
    topic = topics.JOINT_STATES
    states = ros_node.create_publisher(topic.type, topic.name, topic.offered)
    assert clock.now_ns() == pytest.approx(time.time_ns(), abs=SPREAD)
    system.ahead = step  # no state tells of another time
    assert clock.now_ns() == pytest.approx(time.time_ns() + step, abs=SPREAD)
    deadline = time.monotonic() + 60.0
    while not abs(clock.now_ns() - time.time_ns()) < SPREAD:
        assert time.monotonic() < deadline
        state = JointState(name=['joint1'], position=[0.0])
        state.header.stamp.sec, state.header.stamp.nanosec = divmod(time.time_ns(), 10**9)
        states.publish(state)
        spin_once(ros_node, 0.01)
    system.ahead = -step
    assert clock.now_ns() == pytest.approx(time.time_ns(), abs=SPREAD)
    clock.destroy()


def test_a_past_time_is_converted_and_that_of_a_clock_that_was_set_is_now(
    system: SystemTime,
) -> None:
    published = system.time_ns() - 5 * 10**8
    age = time.monotonic_ns() - arm_clock.monotonic_ns(published)
    assert age == pytest.approx(5e8, abs=SPREAD)
    for step in (SET, -SET):
        system.ahead = step
        assert arm_clock.monotonic_ns(published) == pytest.approx(time.monotonic_ns(), abs=SPREAD)
