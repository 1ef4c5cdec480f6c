"""Times of the bridge's reports: in the cycle's slack, once per second and at every new mode."""

import time
from collections.abc import Callable
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.boards.kept_zeros import ZeroFile
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.gate.command_intake import CommandPublishers
from aerarm_ros.realtime.periodic_loop import PeriodicLoop, SteadyClock
from aerarm_ros.ros.bridge.bridge_diagnostics import BridgeDiagnostics, BridgeTiming
from aerarm_ros.ros.bridge.hardware_bridge import World
from aerarm_ros.ros.graph import DuplicatePublisherWatch, PublisherWatch

PERIOD = 1e-3
PIECES = 20  # cycles in which a report is complete


class Listener:
    """A bridge's diagnostics and who receives them, both on one node."""

    def __init__(self, node: Node) -> None:
        self.messages: list[DiagnosticArray] = []
        self.stamps = SteadyClock()
        self.diagnostics = BridgeDiagnostics(node, time.time_ns)
        topic = topics.DIAGNOSTICS
        node.create_subscription(topic.type, topic.name, self.messages.append, topic.qos)
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        config = load_arm_config().with_encoders('absolute')
        self.cycle = BridgeCycle(config, make_emulated_transport(config, load_robot()))
        publishers = CommandPublishers()
        self.watch = PublisherWatch(node, topics.JOINT_COMMAND, publishers.look)
        timing = BridgeTiming(PeriodicLoop(PERIOD), self.stamps)
        self.rivals = DuplicatePublisherWatch(node, topics.JOINT_STATES)
        self.watched = SimpleNamespace(
            config=config,
            cycle=self.cycle,
            timing=timing,
            command_publishers=publishers,
            publisher_watch=self.watch,
            duplicates=self.rivals,
            zero_file=ZeroFile(None, config),
            record=SimpleNamespace(problem=''),
            world=World(),
        )

    def wait_for(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end
            self._executor.spin_once(timeout_sec=0.05)

    def step(self, start: float, cycles: int) -> None:
        for index in range(cycles):
            self.diagnostics.step(start + index * PERIOD)

    def arm(self, index: int = -1) -> DiagnosticStatus:
        return self.messages[index].status[0]


@pytest.fixture
def listener(ros_node: Node) -> Listener:
    return Listener(ros_node)


def test_an_active_bridge_reports_once_a_second_and_only_from_its_cycle(listener: Listener) -> None:
    listener.wait_for(lambda: bool(listener.messages))
    assert listener.arm().name == '/test: arm'
    assert (listener.arm().level, listener.arm().message) == (DiagnosticStatus.STALE, 'not active')
    listener.diagnostics.watch(listener.watched)
    before = len(listener.messages)
    for second in range(2):
        listener.step(100.0 + second, 1000)
        listener.wait_for(lambda: len(listener.messages) > before)  # noqa: B023
        assert len(listener.messages) == before + 1
        before += 1
    names = [status.name for status in listener.messages[-1].status]
    assert names == ['/test: arm', '/test: motors', '/test: timing']
    assert listener.arm().level == DiagnosticStatus.ERROR  # no board was asked yet
    timing = listener.messages[-1].status[2]
    assert timing.level == DiagnosticStatus.OK
    listener.stamps.behind = -2.0  # the system clock was set back
    listener.step(102.0, 1000)
    listener.wait_for(lambda: len(listener.messages) > before)
    timing = listener.messages[-1].status[2]
    assert timing.level == DiagnosticStatus.WARN
    assert '2000 ms ahead of the system clock' in timing.message
    before += 1
    listener.diagnostics.unwatch()
    listener.wait_for(lambda: len(listener.messages) > before)
    assert listener.arm().message == 'not active'


def test_a_new_mode_is_reported_within_some_cycles(listener: Listener) -> None:
    listener.diagnostics.watch(listener.watched)
    listener.step(100.0, PIECES)
    listener.wait_for(lambda: any(m.status[0].message != 'not active' for m in listener.messages))
    listener.cycle.e_stop('test')
    listener.cycle.update(100.02)
    before = len(listener.messages)
    listener.diagnostics.publish_soon()
    listener.step(100.03, PIECES)
    listener.wait_for(lambda: len(listener.messages) > before)
    assert listener.arm().level == DiagnosticStatus.ERROR
    assert 'emergency stop: test' in listener.arm().message
    # Publishers that disturb the arm are warnings.
    listener.cycle.clear_fault()
    listener.watch.problems = ('joint_command of /other is not received: it is another type',)
    listener.rivals.problem = 'joint_states has 2 publishers'
    for now in range(20):
        listener.cycle.update(100.1 + now * PERIOD)
    listener.step(102.0, PIECES)
    listener.wait_for(lambda: any('not received' in m.status[0].message for m in listener.messages))
    assert '2 publishers' in listener.arm().message
    assert listener.arm().level == DiagnosticStatus.WARN
