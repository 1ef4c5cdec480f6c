"""Topics that ground_link relays."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.ros.link.relayed_topics import (
    DOWN,
    LAYOUTS,
    SILENT,
    DroneTopics,
    GroundTopics,
    topic_rates,
)

if TYPE_CHECKING:
    from conftest import Pair

ORDER = ['joint1', 'joint2', 'joint3']


class Relay:
    """Both relays of a pair, and what the ground publishes."""

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.drone = DroneTopics(
            pair.drone.relay, pair.drone.connection, topic_rates(50.0, 10.0, [])
        )
        self.ground = GroundTopics(pair.ground.relay, pair.ground.connection, lambda _: None)
        self.channels: Counter[int] = Counter()
        self.came: dict[str, list[JointState]] = {'': [], '/minimum': [], '/maximum': []}
        command = topics.JOINT_COMMAND
        for suffix, came in self.came.items():
            pair.ground.node.create_subscription(
                command.type, command.name + suffix, came.append, 1000
            )

    def publishers(self, count: int) -> list[Publisher]:
        """Return publishers of joint_command on the drone that the relay receives."""
        node, command = self.pair.drone.node, topics.JOINT_COMMAND
        made = [node.create_publisher(command.type, command.name, 100) for _ in range(count)]
        self.pair.until(lambda: all(p.get_subscription_count() for p in made))
        return made

    def step(self) -> bool:
        self.drone.update(self.pair.now)
        for received in self.pair.step()[1]:
            self.channels[received.channel] += 1
            if received.channel == LAYOUTS:
                self.ground.take_layout(received.payload)
            else:
                self.ground.publish(received.channel, received.payload)
        return True

    def close(self) -> None:
        self.drone.destroy()
        self.ground.destroy()


def angles(message: JointState) -> dict[str, float]:
    return dict(zip(message.name, message.position, strict=True))


def test_publishers_with_different_joint_orders_share_no_window(pair: Pair) -> None:
    relay = Relay(pair)
    publishers = relay.publishers(2)
    values = {'joint1': 1.0, 'joint2': 2.0, 'joint3': 3.0}
    names = ORDER, ORDER[::-1]

    def publish() -> bool:
        for publisher, order in zip(publishers, names, strict=True):
            for _ in range(5):
                publisher.publish(JointState(name=order, position=[values[name] for name in order]))
        relay.step()
        came = relay.came['/maximum']
        return all(sum(list(m.name) == order for m in came) > 5 for order in names)

    pair.until(publish)
    for came in relay.came.values():
        assert all(angles(message) == values for message in came)
    assert relay.channels[LAYOUTS] == 2  # not one per change
    relay.close()


def test_velocities_are_never_published_as_positions(pair: Pair) -> None:
    relay = Relay(pair)
    (publisher,) = relay.publishers(1)
    pair.loss = 0.5  # a window may arrive before the text of its layout
    fields = [{'position': [1.0, 1.0, 1.0]}, {'velocity': [9.0, 9.0, 9.0]}]
    count = 0

    def publish() -> bool:
        nonlocal count
        count += 1
        publisher.publish(JointState(name=ORDER, **fields[count % 2]))
        relay.step()
        came = relay.came['']
        counts = [sum(len(getattr(m, name)) > 0 for m in came) for name in ('position', 'velocity')]
        return min(counts) > 5

    pair.until(publish)
    for came in relay.came.values():
        assert all(set(m.position) <= {1.0} and set(m.velocity) <= {9.0} for m in came)
    relay.close()


def test_more_layouts_than_windows_are_all_right(pair: Pair) -> None:
    relay = Relay(pair)
    (publisher,) = relay.publishers(1)
    seen: set[str] = set()
    count = 0

    def publish() -> bool:
        nonlocal count
        count += 1
        number = count % 12
        publisher.publish(JointState(name=[f'part{number}'], position=[float(number)]))
        relay.step()
        seen.update(*(m.name for m in relay.came['']))
        return len(seen) == 12

    pair.until(publish)
    for came in relay.came.values():
        assert all(m.name[0] == f'part{m.position[0]:.0f}' for m in came)
    relay.close()


def test_an_unknown_number_is_unknown_on_the_ground(pair: Pair) -> None:
    relay = Relay(pair)
    (publisher,) = relay.publishers(1)
    came = relay.came['/maximum']

    def publish(number: float) -> None:
        for effort in (1.0, number, 2.0):
            publisher.publish(JointState(name=['joint1'], effort=[effort]))
        relay.step()

    pair.until(lambda: publish(np.nan) or any(np.isnan(m.effort[0]) for m in came))
    pair.until(lambda: publish(1.5) or came[-1].effort[0] == 2.0)
    assert all(np.isfinite(m.effort[0]) for m in relay.came[''][-1:])
    relay.close()


def test_a_silent_stream_is_named_with_its_age(pair: Pair) -> None:
    relay = Relay(pair)
    assert 'joint_states: start the bridge' in relay.drone.problem(pair.now)
    node = pair.drone.node
    steady = topics.JOINT_STATES, topics.IMU
    made = {t.name: node.create_publisher(t.type, t.name, 10) for t in steady}
    pair.until(lambda: all(p.get_subscription_count() for p in made.values()))

    def publish(*streams: topics.Topic) -> bool:
        for topic in streams:
            message = topic.type()
            if topic is topics.JOINT_STATES:
                message = JointState(name=ORDER, position=[0.0] * 3)
            made[topic.name].publish(message)
        return relay.step()

    pair.until(lambda: publish(*steady) and relay.drone.problem(pair.now) == '')
    pair.now += SILENT
    assert 'no message on the drone on joint_states for 2 s, imu for 2 s' in relay.drone.problem(
        pair.now
    )
    pair.until(lambda: publish(topics.IMU) and 'imu' not in relay.drone.problem(pair.now))
    assert 'joint_states for' in relay.drone.problem(pair.now)
    # A stream that ended with its publisher is not missed, but the bridge is.
    for publisher in made.values():
        node.destroy_publisher(publisher)
    pair.now += 60.0
    pair.until(lambda: 'imu' not in relay.drone.problem(pair.now))
    assert 'joint_states for 6' in relay.drone.problem(pair.now)
    relay.close()


def test_a_flood_of_messages_does_not_keep_the_relay_from_other_work(pair: Pair) -> None:
    relay = Relay(pair)
    taken: Counter[int] = Counter()
    payload = serialize_message(JointState(name=ORDER, position=[0.0] * 3))

    def take(index: int = 0) -> tuple[bytes, dict[str, object]]:
        taken[index] += 1
        assert taken[index] < 10_000
        return payload, {}

    relay.drone._reader.take = take
    relay.drone.update(pair.now)
    assert taken[0] == 100
    relay.close()


def test_after_a_cut_the_ground_receives_only_the_newest_diagnostics_of_each_name(
    pair: Pair,
) -> None:
    relay = Relay(pair)
    topic = topics.DIAGNOSTICS
    publisher = pair.drone.node.create_publisher(topic.type, topic.name, topic.offered)
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
    publisher = pair.drone.node.create_publisher(topic.type, topic.name, topic.offered)
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
        relay.drone._send_diagnostics(
            DOWN.index(topics.DIAGNOSTICS),
            serialize_message(DiagnosticArray(status=[status])),
            is_up=False,
        )
    assert pair.drone.connection.dropped > 0
    pair.loss = 0.0
    pair.until(lambda: relay.step() and 'new' in came)
    assert pair.drone.connection.peers == peers  # the link did not restart
    relay.close()
