"""Timers of nodes that go on when the system clock is set."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.timer import Timer


def create_steady_timer(
    node: Node, period: float, act: Callable[[], None], autostart: bool = True
) -> Timer:
    """Return a timer of a node on the monotonic clock.

    rclpy's default is the node's clock, which is the system clock: set back by 2 s, a timer of
    20 ms is silent for 2 s.

    Parameters
    ----------
    node
        Owner of the timer.
    period
        Between two calls [s].
    act
        Called by the node's executor.
    autostart
        Whether it runs now, and not from its first `reset` on.
    """
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period, act, clock=clock, autostart=autostart)
