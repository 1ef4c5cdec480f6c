"""Run the callbacks of a test's node, at a fraction of the cost of rclpy.spin_once.

rclpy.spin_once takes a millisecond per message, and a bridge sends thousands per second.
"""

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.task import Future

from aerarm_ros.ros.executors import LeanExecutor

_executors: dict[Node, LeanExecutor] = {}


def spin_once(node: Node, timeout_sec: float) -> None:
    """Wait up to a time [s] for ready callbacks, and run them."""
    executor = _executors.get(node)
    if executor is None:
        executor = _executors[node] = LeanExecutor(node)
    elif node.executor is not executor:  # rclpy's executor used the node meanwhile
        node.executor = executor
        executor.wake()
    executor.spin_once(timeout_sec)


def spin_until(node: Node, condition: Callable[[], object], timeout: float) -> bool:
    """Spin until a condition is true; return False after `timeout` [s]."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            return False
        spin_once(node, 0.05)
    return True


def answer_of(node: Node, ask: Callable[[], Future], timeout: float) -> Any:
    """Return the answer within a time [s] to a request that may be repeated.

    An answer is lost if the server has not yet discovered the client.
    """
    deadline = time.monotonic() + timeout
    futures: list[Future] = []
    while not any(future.done() for future in futures):
        assert time.monotonic() < deadline
        futures.append(ask())
        spin_until(node, futures[-1].done, 1.0)
    return next(future.result() for future in futures if future.done())


def release_nodes() -> None:
    """Release all nodes, which are about to be destroyed."""
    while _executors:
        _executors.popitem()[1].shutdown()
