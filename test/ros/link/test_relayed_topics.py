"""Topics that ground_link relays."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.ros.link.relayed_topics import ALL_STATES, SILENT, STATES, DroneTopics, GroundTopics

if TYPE_CHECKING:
    from conftest import Pair


class Relay:
    """Both relays of a pair."""

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.drone = DroneTopics(pair.drone.relay, pair.drone.connection, 50.0, 10.0)
        self.ground = GroundTopics(pair.ground.relay, pair.ground.connection, lambda _: None)
        self.channels: Counter[int] = Counter()

    def step(self) -> bool:
        self.drone.update(self.pair.now)
        for received in self.pair.step()[1]:
            self.channels[received.channel] += 1
            self.ground.publish(received.channel, received.payload)
        return True

    def close(self) -> None:
        self.drone.destroy()
        self.ground.destroy()


def test_the_newest_states_arrive_together_in_single_precision(pair: Pair) -> None:
    relay = Relay(pair)
    came: dict[str, list[JointState]] = {}
    publishers = []
    for topic in STATES:
        came[topic.name] = []
        pair.ground.node.create_subscription(topic.type, topic.name, came[topic.name].append, 10)
        publishers.append(topic.publisher(pair.drone.node))

    def publish(joints: int) -> bool:
        for number, publisher in enumerate(publishers):
            names = [f'joint{k}' for k in range(joints)]
            position = [np.nan, *np.random.default_rng(number).normal(size=joints - 1)]
            publisher.publish(JointState(name=names, position=position))
        relay.step()
        return all(x and len(x[-1].name) == joints for x in came.values())

    pair.until(lambda: publish(4))
    assert set(relay.channels) == {ALL_STATES}
    for number, topic in enumerate(STATES):
        wanted = np.array([np.nan, *np.random.default_rng(number).normal(size=3)], np.float32)
        np.testing.assert_array_equal(came[topic.name][-1].position, wanted)
        assert not len(came[topic.name][-1].velocity)
    # The states of many joints do not fit into one datagram together.
    pair.until(lambda: publish(120))
    assert set(relay.channels) == {ALL_STATES, *range(len(STATES))}
    assert pair.drone.connection.dropped == 0
    relay.close()


def test_a_state_that_is_too_large_is_dropped_and_the_others_arrive(pair: Pair) -> None:
    relay = Relay(pair)
    came: list[JointState] = []
    small, large = topics.JOINT_STATES, topics.MOTOR_STATES
    pair.ground.node.create_subscription(small.type, small.name, came.append, 10)
    publishers = [topic.publisher(pair.drone.node) for topic in (small, large)]
    effort = np.random.default_rng(1).normal(size=8200).tolist()

    def publish() -> bool:
        publishers[0].publish(JointState(name=['a'], position=[1.0]))
        publishers[1].publish(JointState(name=['a'], effort=effort))
        relay.step()
        return bool(came) and pair.drone.connection.dropped > 0

    pair.until(publish)
    relay.close()


def test_a_missing_bridge_is_reported(pair: Pair) -> None:
    relay = Relay(pair)
    assert 'joint_states: start the bridge' in relay.drone.problem(pair.now)
    publisher = topics.JOINT_STATES.publisher(pair.drone.node)

    def publish() -> bool:
        publisher.publish(JointState(name=['joint1'], position=[0.0]))
        return relay.step()

    pair.until(lambda: publish() and relay.drone.problem(pair.now) == '')
    pair.now += SILENT + 1.0
    assert 'joint_states for 3 s: check the bridge' in relay.drone.problem(pair.now)
    relay.close()


def test_a_flood_of_messages_does_not_keep_the_relay_from_other_work(pair: Pair) -> None:
    relay = Relay(pair)
    taken: Counter[int] = Counter()
    payload = serialize_message(String(data='ready'))

    def take(index: int = 0) -> tuple[bytes, dict[str, object]]:
        taken[index] += 1
        assert taken[index] < 10_000
        return payload, {}

    relay.drone._events.take = take
    relay.drone.update(pair.now)
    assert taken[0] == 100
    relay.close()


def test_after_a_cut_the_ground_receives_only_the_newest_diagnostics_of_each_name(
    pair: Pair,
) -> None:
    relay = Relay(pair)
    topic = topics.DIAGNOSTICS
    publisher = topic.publisher(pair.drone.node)
    came: list[tuple[str, str]] = []

    def note(message: DiagnosticArray) -> None:
        came.extend((status.name, status.message) for status in message.status)

    pair.ground.node.create_subscription(topic.type, topic.name, note, topic.qos)

    def publish(name: str, text: str) -> None:
        publisher.publish(DiagnosticArray(status=[DiagnosticStatus(name=name, message=text)]))
        relay.step()

    pair.until(lambda: publish('a', 'before') or came)
    for text in ('1', '2', '3'):  # each arrives while the link is up
        publish('b', text)
    pair.until(lambda: relay.step() and ('b', '3') in came)
    assert [text for name, text in came if name == 'b'] == ['1', '2', '3']
    pair.loss = 1.0
    pair.now += 2.0
    for number in range(30):
        publish('a', f'old {number}')
        publish('b', f'old {number}')
    publish('a', 'new')
    for _ in range(20):
        relay.step()
    came.clear()
    pair.loss = 0.0
    pair.until(lambda: relay.step() and ('a', 'new') in came)
    assert sorted(came) == [('a', 'new'), ('b', 'old 29')]
    relay.close()


def test_a_latched_message_that_a_full_backlog_dropped_arrives_after_the_cut(pair: Pair) -> None:
    relay = Relay(pair)
    topic = topics.ROBOT_DESCRIPTION
    publisher = topic.publisher(pair.drone.node)
    came: list[str] = []
    pair.ground.node.create_subscription(
        topic.type, topic.name, lambda message: came.append(message.data), topic.qos
    )
    pair.until(lambda: relay.step() and publisher.get_subscription_count())
    publisher.publish(String(data='old'))
    pair.until(lambda: relay.step() and came)
    peers = pair.drone.connection.peers
    pair.loss = 1.0
    pair.now += 2.0
    publisher.publish(String(data='new'))
    for _ in range(20):
        relay.step()
    for number in range(3000):  # more than the backlog
        status = DiagnosticStatus(name=str(number))
        message = DiagnosticArray(status=[status])
        relay.drone._send_diagnostics(serialize_message(message), is_up=False)
    assert pair.drone.connection.dropped > 0
    pair.loss = 0.0
    pair.until(lambda: relay.step() and 'new' in came)
    assert pair.drone.connection.peers == peers  # the link did not restart
    relay.close()
