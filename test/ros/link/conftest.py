"""Drone and ground as nodes of two ROS domains in one process."""

import time
from collections.abc import Callable, Iterator
from random import Random

import pytest
import rclpy
from own_domain import own_domain
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from aerarm_ros.link.connection import Connection, Received


class Side:
    """One computer: a node for the relay, one for the test, and an end of the connection."""

    def __init__(self, role: str, other: str) -> None:
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=int(own_domain()['ROS_DOMAIN_ID']))
        self.relay, self.node = (
            rclpy.create_node(
                name, context=self.context, start_parameter_services=False, enable_rosout=False
            )
            for name in ('ground_link', 'test')
        )
        self.connection = Connection(bytes(range(32)), role, other, 1e6)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)

    def spin(self) -> None:
        """Run callbacks of the test's node that are due."""
        for _ in range(20):
            self._executor.spin_once(timeout_sec=0.0)

    def close(self) -> None:
        """Destroy the nodes."""
        self._executor.shutdown()
        for node in (self.relay, self.node):
            node.destroy_node()
        rclpy.shutdown(context=self.context)


class Pair:
    """Drone and ground, connected by datagrams that the test passes.

    Attributes
    ----------
    loss
        Share of lost datagrams.
    """

    def __init__(self) -> None:
        self.drone, self.ground = Side('drone', 'ground'), Side('ground', 'drone')
        self.now = 100.0
        self.loss = 0.0
        self._random = Random(0)

    def step(self) -> tuple[list[Received], list[Received]]:
        """Pass a datagram each way, 20 ms later; return what drone and ground received."""
        self.now += 0.02
        came = []
        for sender, receiver in ((self.ground, self.drone), (self.drone, self.ground)):
            now_ns = int(1e9 * self.now)
            datagram = sender.connection.datagram(self.now, now_ns, now_ns)
            came.append(self._pass(datagram, sender, receiver))
        for side in (self.drone, self.ground):
            side.spin()
        return came[0], came[1]

    def _pass(self, datagram: bytes, sender: Side, receiver: Side) -> list[Received]:
        """Pass a datagram, and the answer of a handshake."""
        if self._random.random() < self.loss:
            return []
        now_ns = int(1e9 * self.now)
        received = receiver.connection.receive(datagram, self.now, now_ns, now_ns)
        answer = receiver.connection.answer
        if answer is not None:
            self._pass(answer, receiver, sender)
        return received

    def until(self, step: Callable[[], object], timeout: float = 60.0) -> None:
        """Repeat `step` until it returns something true."""
        deadline = time.monotonic() + timeout
        while not step():
            assert time.monotonic() < deadline
            time.sleep(0.002)


@pytest.fixture
def pair() -> Iterator[Pair]:
    """Return a connected pair."""
    pair = Pair()
    pair.until(lambda: pair.step() and pair.ground.connection.is_joined)
    yield pair
    pair.drone.close()
    pair.ground.close()
