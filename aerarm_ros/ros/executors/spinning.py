"""Waiting for what a node's own callbacks bring."""

import os
import time
from collections.abc import Callable

import rclpy
from rclpy.node import Node

_SPIN = 0.05  # [s]


def spin_until(node: Node, condition: Callable[[], object], timeout: float) -> bool:
    """Spin a node that no executor holds until a condition is true; False after `timeout` [s]."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            return False
        rclpy.spin_once(node, timeout_sec=_SPIN)
    return True


def this_domain() -> str:
    """Return where a node looks for others, for messages about one that it did not find."""
    return f'this ROS domain (ROS_DOMAIN_ID={os.environ.get("ROS_DOMAIN_ID", "0")})'
