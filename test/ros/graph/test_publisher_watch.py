import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack

import pytest
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py.topics import Topic
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.graph import PublisherWatch

RELIABLE = QoSProfile(depth=1)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
TOPIC = Topic('watched', JointState, RELIABLE)

Leave = Callable[[], None]
MakePublisher = Callable[..., Leave]


class WatchedTopic:
    """A watch that is polled, as by a loop, until something is seen."""

    def __init__(self, node: Node) -> None:
        self.names: list[str] = []
        self.looks = 0
        self.watch = PublisherWatch(node, TOPIC, self._on_names)

    def wait_for(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end, (self.names, self.watch.problems)
            self.watch.poll()
            time.sleep(1e-4)

    def _on_names(self, names: Mapping[bytes, str]) -> None:
        self.names = sorted(names.values())
        self.looks += 1


@pytest.fixture
def watched(ros_node: Node) -> Iterator[WatchedTopic]:
    with BackgroundExecutor(ros_node):
        yield WatchedTopic(ros_node)


@pytest.fixture
def make_publisher(ros_node: Node) -> Iterator[MakePublisher]:
    """Return a function that starts a publisher as another process would, and one that ends it."""
    with ExitStack() as stack:

        def make(name: str, message: type = JointState, qos: QoSProfile = RELIABLE) -> Leave:
            context = rclpy.Context()
            rclpy.init(args=[], context=context)
            node = rclpy.create_node(name, namespace='somewhere', context=context)
            node.create_publisher(message, f'/{TOPIC.name}', qos)

            def leave() -> None:
                node.destroy_node()
                context.try_shutdown()

            stack.callback(leave)
            return leave

        yield make


def test_publishers_that_come_and_go_are_named_without_needless_reads(
    watched: WatchedTopic, make_publisher: MakePublisher
) -> None:
    leave = make_publisher('first')
    watched.wait_for(lambda: watched.names == ['/somewhere/first'])
    looks = watched.looks
    for _ in range(5000):
        watched.watch.poll()
    make_publisher('second')
    watched.wait_for(lambda: len(watched.names) == 2)
    assert watched.looks <= looks + 2  # a name may be unknown at first
    watched.wait_for(lambda: watched.names == ['/somewhere/first', '/somewhere/second'])
    # Between two polls: the number of publishers stays what it was.
    leave()
    make_publisher('third')

    def asked() -> bool:
        watched.watch.look_soon()
        return watched.names == ['/somewhere/second', '/somewhere/third']

    watched.wait_for(asked)


def test_unreceived_publishers_are_reported_with_the_reason(
    watched: WatchedTopic, make_publisher: MakePublisher
) -> None:
    make_publisher('heard')
    leave = make_publisher('weak', qos=BEST_EFFORT)
    make_publisher('strange', String)
    watched.wait_for(
        lambda: (
            watched.names == ['/somewhere/heard']
            and ['/somewhere/' in text for text in watched.watch.problems] == [True, True]
        )
    )
    strange, unreliable = sorted(watched.watch.problems)
    assert '/somewhere/strange is not received: its type is std_msgs/msg/String' in strange
    assert '/somewhere/weak is not received: its quality of service' in unreliable
    assert 'eliab' in unreliable
    leave()
    watched.wait_for(lambda: len(watched.watch.problems) == 1)
