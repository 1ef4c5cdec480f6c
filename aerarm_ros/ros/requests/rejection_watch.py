"""Whether a controller rejects what it is sent, and why."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.ros.executors.spinning import spin_until

_REPORT = 3.0  # [s] within which every controller has reported on /diagnostics
_COUNT, _REASON = 'rejected inputs', 'last rejection'  # of a controller's status
_MODE = 'arm mode'


class RejectionWatch:
    """Follows the counts of rejected inputs on /diagnostics.

    Parameters
    ----------
    node
        Owner of the subscription; no executor may hold it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._counts: dict[str, tuple[int, str]] = {}
        self._before: dict[str, tuple[int, str]] = {}
        self._modes: dict[str, str] = {}  # of the arm, as each controller has heard it
        topic = topics.DIAGNOSTICS
        node.create_subscription(topic.type, topic.name, self._on_diagnostics, topic.qos)

    def begin(self, timeout: float) -> None:
        """Learn what was rejected before; spins the node until controllers have reported.

        Parameters
        ----------
        timeout
            Longest time for a controller that has just started to hear the arm's mode, before
            which it rejects everything [s].
        """
        if spin_until(self._node, lambda: self._modes, _REPORT):
            spin_until(self._node, lambda: any(self._modes.values()), timeout)
        self._before = dict(self._counts)

    def reason(self) -> str:
        """Return why something was rejected since `begin`, '' if nothing was."""
        before = self._before
        later = self._counts.items()
        return next((why for name, (n, why) in later if n > before.get(name, (n, ''))[0]), '')

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if _COUNT in values:
                self._counts[status.name] = int(values[_COUNT]), values[_REASON]
            if _MODE in values:
                self._modes[status.name] = values[_MODE]
