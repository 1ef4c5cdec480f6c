"""A stop of every bridge, for a node whose executor runs in another thread."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rclpy.node import Node

from aerarm_ros.ros.executors.spinning import this_domain
from aerarm_ros.ros.requests.bridge_finder import BridgeFinder
from aerarm_ros.ros.requests.stop_request import StopRequest

_POLL = 0.02  # [s]


class StopService:
    """Stops the arm of every bridge, known beforehand or not.

    Parameters
    ----------
    node
        Owner of the clients; an executor must spin it in another thread.
    action
        A key of `bridge_services.STOPS`.
    bridges
        Node names of bridges that are expected, relative or absolute.
    timeout
        Longest time to find bridges, and again for the answer of each [s].
    """

    def __init__(
        self, node: Node, action: str, bridges: Sequence[str], timeout: float = 1.0
    ) -> None:
        self._node = node
        self._action = action
        self._finder = BridgeFinder(node, action, bridges)
        self._timeout = timeout

    def look(self) -> None:
        """Make clients of the bridges that are there by now, so that a call need not."""
        self._finder.find()

    def call(self) -> tuple[bool, str]:
        """Ask; blocks until every bridge that is asked has answered.

        Returns
        -------
        done
            Whether every bridge there is has confirmed, and there was one.
        text
            What the bridges said, in the order of their names, or that there is none.
        """
        request = StopRequest(self._node, self._finder, self._timeout)
        while not request.poll():
            time.sleep(_POLL)
        if not request.answers:
            return False, f'no bridge offers {self._action}: is one running in {this_domain()}?'
        text = '; '.join(f'{name}: {reply}' for name, (_, reply) in sorted(request.answers.items()))
        return all(done for done, _ in request.answers.values()), text
