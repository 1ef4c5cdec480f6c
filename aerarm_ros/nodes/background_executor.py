"""Services, parameters and timers of a node, served beside a real-time loop."""

from __future__ import annotations

import contextlib
import sys
import threading
import traceback

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

# A thread that wakes for its cycle gets the interpreter back after this long at most,
# instead of Python's 5 ms; shorter makes the two threads trade it for nothing.
SWITCH_INTERVAL = 50e-6
WAIT = 5.0  # [s] each time it ends costs the loop beside it half a millisecond


class BackgroundExecutor:
    """Context that spins a node in a second thread.

    Enter it before `set_fifo`, which then puts the thread one priority below the loop.

    Parameters
    ----------
    node
        Subscriptions of a RawReader are not touched: they belong to their loop.
    """

    def __init__(self, node: Node) -> None:
        self._context = node.context
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._stopped = False
        self._thread = threading.Thread(target=self._spin, name='ros', daemon=True)

    def __enter__(self) -> BackgroundExecutor:
        sys.setswitchinterval(SWITCH_INTERVAL)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped = True
        self._executor.wake()
        self._thread.join()
        self._executor.shutdown()

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
