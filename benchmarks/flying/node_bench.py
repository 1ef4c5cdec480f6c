"""Nodes that a benchmark starts as processes, in a ROS domain that no concurrent run uses."""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClientError

PATIENCE = 300.0  # [s] of the host, which may be busy
FAILURES = ValueError, TimeoutError, ArmClientError
"""Errors of a single case, which do not end the benchmark."""


def reason(error: BaseException) -> str:
    """Return the message of an error as one line."""
    return ' '.join(str(error).split())[:160]


@contextmanager
def ros_node(number: int | None = None) -> Iterator[Node]:
    """Start ROS in the domain of a number, by default of this process, and provide a node."""
    os.environ['ROS_DOMAIN_ID'] = str(1 + (os.getpid() if number is None else number) % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init(args=[])
    node = rclpy.create_node('bench')
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


class NodeBench:
    """Processes of one case, which end with the stack, and their diagnostics.

    Attributes
    ----------
    processes : dict
        Processes by executable name.
    """

    def __init__(self, stack: ExitStack, node: Node, folder: Path) -> None:
        self.node, self.folder, self._stack = node, folder, stack
        self.processes: dict[str, NodeProcess] = {}
        self._said: dict[str, str] = {}
        self.listen(topics.DIAGNOSTICS, self._on_diagnostics)

    def start(
        self,
        name: str,
        values: dict,
        arguments: tuple[str, ...] = (),
        process: type[NodeProcess] = NodeProcess,
    ) -> NodeProcess:
        """Start a node as a process."""
        log = self.folder / f'{name}.log'
        started = self._stack.enter_context(process(name, arguments, values, log=log))
        self.processes[name] = started
        return started

    def publisher_of(self, topic: topics.Topic):
        """Return a publisher of the topic."""
        return self.node.create_publisher(topic.type, topic.name, topic.qos)

    def listen(self, topic: topics.Topic, act: Callable[..., None]) -> None:
        """Call a function with each message of the topic."""
        self.node.create_subscription(topic.type, topic.name, act, topic.qos)

    def wait(self, what: str, condition: Callable[[], object], patience: float = PATIENCE) -> None:
        """Wait for a condition; raise TimeoutError or, if a process has ended, ValueError."""

        def is_over() -> bool:
            return bool(condition()) or any(p.returncode for p in self.processes.values())

        is_reached = spin_until(self.node, is_over, patience)
        for process in self.processes.values():
            if process.returncode:
                raise ValueError(process.tail(1))
        if not is_reached:
            raise TimeoutError(f'{what} is not ready after {patience:g} s')

    def said(self, name: str) -> str:
        """Return the newest diagnostics of a node as text; '' if there are none."""
        return self._said.get(name, '')

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._said[status.name.rpartition(': ')[2]] = status.message
