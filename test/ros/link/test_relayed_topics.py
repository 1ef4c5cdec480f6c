"""Topics that ground_link relays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.topics import Topic
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

    def until(self, condition) -> None:
        self.pair.until(lambda: self.step() and condition())

    def listen(self, topic: Topic, note) -> Publisher:
        """Call `note` with each message on the ground; return a publisher on the drone."""
        self.pair.ground.node.create_subscription(topic.type, topic.name, note, topic.qos)
        return topic.publisher(self.pair.drone.node)

    def cut(self) -> None:
        self.pair.loss = 1.0
        self.pair.now += 2.0


@pytest.fixture
def relay(pair: Pair) -> Iterator[Relay]:
    relay = Relay(pair)
    yield relay
    relay.drone.destroy()
    relay.ground.destroy()


def test_the_newest_states_arrive_together_in_single_precision(relay: Relay) -> None:
    came: dict[str, list[JointState]] = {topic.name: [] for topic in STATES}
    publishers = [relay.listen(topic, came[topic.name].append) for topic in STATES]
    connection = relay.pair.drone.connection

    def publish(joints: int) -> bool:
        for number, publisher in enumerate(publishers):
            names = [f'joint{k}' for k in range(joints)]
            position = [np.nan, *np.random.default_rng(number).normal(size=joints - 1)]
            publisher.publish(JointState(name=names, position=position))
        relay.step()
        return all(x and len(x[-1].name) == joints for x in came.values())

    relay.pair.until(lambda: publish(4))
    assert set(relay.channels) == {ALL_STATES}
    for number, topic in enumerate(STATES):
        wanted = np.array([np.nan, *np.random.default_rng(number).normal(size=3)], np.float32)
        np.testing.assert_array_equal(came[topic.name][-1].position, wanted)
        assert not len(came[topic.name][-1].velocity)
    # The states of many joints do not fit into one datagram together.
    relay.pair.until(lambda: publish(120))
    assert set(relay.channels) == {ALL_STATES, *range(len(STATES))}
    assert connection.dropped == 0
    # A state that is too large is dropped, and the others arrive.
    effort = np.random.default_rng(1).normal(size=8200).tolist()

    def publish_large() -> bool:
        publishers[0].publish(JointState(name=['a'], position=[1.0]))
        publishers[1].publish(JointState(name=['a'], effort=effort))
        relay.step()
        return len(came[STATES[0].name][-1].name) == 1 and connection.dropped > 0

    relay.pair.until(publish_large)


def test_a_missing_bridge_is_reported(relay: Relay) -> None:
    pair = relay.pair
    assert 'joint_states: start the bridge' in relay.drone.problem(pair.now)
    publisher = topics.JOINT_STATES.publisher(pair.drone.node)

    def publish() -> bool:
        publisher.publish(JointState(name=['joint1'], position=[0.0]))
        return relay.step()

    pair.until(lambda: publish() and relay.drone.problem(pair.now) == '')
    pair.now += SILENT + 1.0
    assert 'joint_states for 3 s: check the bridge' in relay.drone.problem(pair.now)


def test_a_flood_of_messages_does_not_keep_the_relay_from_other_work(relay: Relay) -> None:
    taken: Counter[int] = Counter()
    payload = serialize_message(String(data='ready'))

    def take(index: int = 0) -> tuple[bytes, dict[str, object]]:
        taken[index] += 1
        assert taken[index] < 10_000
        return payload, {}

    relay.drone._events.take = take
    relay.drone.update(relay.pair.now)
    assert taken[0] == 100


def test_after_a_cut_only_the_newest_diagnostics_of_each_name_arrive(relay: Relay) -> None:
    came: list[tuple[str, str]] = []
    publisher = relay.listen(
        topics.DIAGNOSTICS, lambda message: came.extend((s.name, s.message) for s in message.status)
    )

    def publish(name: str, text: str) -> None:
        publisher.publish(DiagnosticArray(status=[DiagnosticStatus(name=name, message=text)]))
        relay.step()

    relay.pair.until(lambda: publish('a', 'before') or came)
    for text in ('1', '2', '3'):  # each arrives while the link is up
        publish('b', text)
    relay.until(lambda: ('b', '3') in came)
    assert [text for name, text in came if name == 'b'] == ['1', '2', '3']
    relay.cut()
    for number in range(30):
        publish('a', f'old {number}')
        publish('b', f'old {number}')
    publish('a', 'new')
    for _ in range(20):
        relay.step()
    came.clear()
    relay.pair.loss = 0.0
    relay.until(lambda: ('a', 'new') in came)
    assert sorted(came) == [('a', 'new'), ('b', 'old 29')]


def test_a_latched_message_that_a_full_backlog_dropped_arrives_after_the_cut(relay: Relay) -> None:
    came: list[str] = []
    connection = relay.pair.drone.connection
    publisher = relay.listen(topics.ROBOT_DESCRIPTION, lambda message: came.append(message.data))
    relay.until(publisher.get_subscription_count)
    publisher.publish(String(data='old'))
    relay.until(lambda: came)
    peers = connection.peers
    relay.cut()
    publisher.publish(String(data='new'))
    for _ in range(20):
        relay.step()
    for number in range(3000):  # more than the backlog
        message = DiagnosticArray(status=[DiagnosticStatus(name=str(number))])
        relay.drone._send_diagnostics(serialize_message(message), is_up=False)
    assert connection.dropped > 0
    relay.pair.loss = 0.0
    relay.until(lambda: 'new' in came)
    assert connection.peers == peers  # the link did not restart
