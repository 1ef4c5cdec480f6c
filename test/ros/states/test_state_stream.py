"""A node with a queue receives every state, however late, with the IMU samples of that time."""

import time

import pytest
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState

from aerarm_msgs_py import topics
from aerarm_ros.ros.states.state_stream import Answers, StateStream

PATIENCE = 60.0  # [s] of the host, which may be busy
NAMES = ('a', 'b')
STATES, BETWEEN = 40, 4  # an IMU sample after every fourth state


def publish_all(node: Node, stream: StateStream) -> None:
    """Publish states and IMU samples in turn, without a reader."""
    states = node.create_publisher(
        topics.JOINT_STATES.type, topics.JOINT_STATES.name, topics.JOINT_STATES.offered
    )
    imu = node.create_publisher(topics.IMU.type, topics.IMU.name, topics.IMU.offered)
    deadline = time.monotonic() + PATIENCE
    while not (states.get_subscription_count() and imu.get_subscription_count()):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    for number in range(1, STATES + 1):
        message = JointState(name=NAMES, position=[float(number), 0.0], velocity=[0.0, 0.0])
        message.header.stamp.sec = number
        states.publish(message)
        time.sleep(1e-3)  # what is received at one instant has no order
        if number % BETWEEN == 0:
            sample = Imu()
            sample.header.stamp.sec = number
            imu.publish(sample)
            time.sleep(1e-3)


def test_without_imu_subscription_imu_messages_do_not_wake_the_loop(ros_node: Node) -> None:
    stream = StateStream(ros_node, NAMES, pytest.fail, imu=False)
    names = [subscription.topic_name for subscription in ros_node.subscriptions]
    assert topics.JOINT_STATES.name in ' '.join(names)
    assert topics.IMU.name not in ' '.join(names)
    assert stream.imu_samples() == []
    stream.destroy()


@pytest.mark.parametrize('depth', [1, 100])
def test_none_is_left_out_if_they_may_wait(ros_node: Node, depth: int) -> None:
    stream = StateStream(ros_node, NAMES, pytest.fail, depth=depth)
    publish_all(ros_node, stream)
    heard, felt = [], []
    deadline = time.monotonic() + PATIENCE
    while not heard or heard[-1] < STATES:
        assert time.monotonic() < deadline
        stream.wait(0.1)
        newest = stream.newest_state()
        samples = stream.imu_samples()
        if newest is not None:
            heard.append(round(newest[1].q[0]))
            felt += [(round(sample.stamp), heard[-1], lead >= 0) for sample, lead in samples]
    stream.destroy()
    if depth == 1:
        assert heard[-1] == STATES
        assert len(heard) < STATES
        return
    assert heard == list(range(1, STATES + 1))
    # Each with the first state after it; the last is still to come.
    wanted = range(BETWEEN, STATES, BETWEEN)
    assert felt == [(number, number + 1, True) for number in wanted]


class Wire:
    """A publisher whose messages are kept."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def publish(self, message: bytes) -> None:
        self.sent.append(message)


def test_a_re_sent_state_has_the_same_answer_until_it_is_withdrawn() -> None:
    wire, answers = Wire(), Answers()
    assert not answers.begin(b'a')
    assert not answers.again()
    answers.publish(wire, b'1')
    assert answers.begin(b'a')
    assert answers.again()
    assert wire.sent == [b'1', b'1']
    # An unanswered state must be processed, even if it is re-sent.
    assert [answers.begin(b'b'), answers.begin(b'b')] == [False, True]
    assert not answers.again()
    answers.publish(wire, b'2')
    assert answers.are_kept
    answers.withdraw()
    assert not answers.are_kept
    assert answers.begin(b'b')
    assert not answers.again()
    assert wire.sent == [b'1', b'1', b'2']
    assert (answers.count, answers.state) == (3, b'b')


def test_a_node_that_need_not_answer_processes_no_state_twice() -> None:
    answers = Answers(needed=False)
    answers.publish(Wire(), b'1')
    answers.withdraw()
    answers.begin(b'a')
    answers.begin(b'a')
    assert answers.again()
