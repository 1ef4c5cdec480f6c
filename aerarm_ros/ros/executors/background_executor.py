"""Services, parameters and timers of a node, served beside a real-time loop."""

from __future__ import annotations

import contextlib
import sys
import threading
import traceback
from collections.abc import Callable

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from aerarm_ros.ros.executors.lean_executor import LeanExecutor

# A thread that wakes for its cycle gets the interpreter back after this long at most,
# instead of Python's 5 ms; shorter makes the two threads trade it for nothing.
SWITCH_INTERVAL = 50e-6
# Work that begins in the slack of a cycle may end there, and the cycle is not disturbed by a
# thread that wakes only to wait for the slack.
SWITCH_INTERVAL_IN_SLACK = 500e-6
WAIT = 5.0  # [s] each time it ends costs the loop beside it half a millisecond


class BackgroundExecutor:
    """Context that spins a node in a second thread.

    Enter it before `set_fifo`, which then puts the thread one priority below the loop.

    Parameters
    ----------
    node
        Subscriptions of a RawReader are not touched: they belong to their loop.
    before_work
        Called before each callback; blocks until a cycle of the loop is over, so that the
        callback has the interpreter for itself. If not given, callbacks run at any time.
    """

    def __init__(self, node: Node, before_work: Callable[[], None] | None = None) -> None:
        self._node = node
        self._context = node.context
        # Executor.wake() of rclpy only makes spin_once wait again; this ends it.
        self._end = node.create_guard_condition(lambda: None)
        self._executor = _executor(node, before_work)
        self._switch_interval = SWITCH_INTERVAL_IN_SLACK if before_work else SWITCH_INTERVAL
        self._stopped = False
        self._thread = threading.Thread(target=self._spin, name='ros', daemon=True)

    def __enter__(self) -> BackgroundExecutor:
        sys.setswitchinterval(self._switch_interval)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped = True
        self._end.trigger()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_guard_condition(self._end)

    def _spin(self) -> None:
        # Executor.spin() can miss a shutdown that comes while it prepares to wait, and then
        # waits for ever; this one looks again.
        with contextlib.suppress(KeyboardInterrupt):
            while not self._stopped:
                try:
                    self._executor.spin_once(timeout_sec=WAIT)
                except ExternalShutdownException:
                    return
                except Exception:
                    # A shutdown can take the context away in the middle of a call.
                    if not self._context.ok():
                        return
                    # A defect in one callback must not take the e-stop service with it.
                    traceback.print_exc()


def _executor(
    node: Node, before_work: Callable[[], None] | None
) -> LeanExecutor | SingleThreadedExecutor:
    if LeanExecutor.available():
        return LeanExecutor(node, before_work)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    return executor
