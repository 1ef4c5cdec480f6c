"""Runs the callbacks of a test's node, at a fraction of what rclpy.spin_once costs.

That is a millisecond of the processor for each message, and a bridge sends thousands a second.
"""

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.task import Future

from aerarm_ros.ros.executors import LeanExecutor

_executors: dict[Node, LeanExecutor] = {}


def spin_once(node: Node, timeout_sec: float) -> None:
    """Wait up to a time [s] for something to do, and do what there is."""
    executor = _executors.get(node)
    if executor is None:
        executor = _executors[node] = LeanExecutor(node)
    elif node.executor is not executor:  # rclpy's has had it meanwhile
        node.executor = executor
        executor.wake()
    executor.spin_once(timeout_sec)


def spin_until(node: Node, condition: Callable[[], object], timeout: float) -> bool:
    """Spin until a condition is true; False after `timeout` [s]."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            return False
        spin_once(node, 0.05)
    return True


def answer_of(node: Node, ask: Callable[[], Future], timeout: float) -> Any:
    """Return what is answered within a time [s] to a request that may be made twice.

    An answer to a client that the server has not discovered yet is lost.
    """
    deadline = time.monotonic() + timeout
    futures: list[Future] = []
    while not any(future.done() for future in futures):
        assert time.monotonic() < deadline
        futures.append(ask())
        spin_until(node, futures[-1].done, 1.0)
    return next(future.result() for future in futures if future.done())


def release_nodes() -> None:
    """Let all nodes go, which are about to be destroyed."""
    while _executors:
        _executors.popitem()[1].shutdown()
