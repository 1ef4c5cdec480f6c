"""A service of the bridge, for a node whose executor runs in another thread."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.ros.executors.spinning import this_domain
from aerarm_ros.ros.requests.bridge_finder import same_name_problem
from aerarm_ros.ros.requests.service_call import ServiceCall

_POLL = 0.02  # [s]


class BridgeService:
    """Calls a service of the bridge that is there.

    With several bridges none is asked; what stops an arm is for a `StopService`.

    Parameters
    ----------
    node
        Owner of the clients; an executor must spin it in another thread.
    action
        Name of the service, a key of `bridge_services.ACTIONS` or of the emulated bridge's.
    bridges
        Node names of the bridges, relative or absolute.
    timeout
        Longest time to find a bridge, and again for its answer [s].
    """

    def __init__(
        self, node: Node, action: str, bridges: Sequence[str], timeout: float = 1.0
    ) -> None:
        self._node = node
        self._clients = {name: node.create_client(Trigger, f'{name}/{action}') for name in bridges}
        self._timeout = timeout

    @property
    def found(self) -> str:
        """Node name of a bridge that is there by now, or ''."""
        return next(iter(self._ready()), '')

    def call(self) -> tuple[bool, str]:
        """Ask; blocks until the bridge has answered.

        Returns
        -------
        done
            Whether the bridge asked has confirmed, and there was one.
        text
            What the bridge said, or why none was asked.
        """
        found = self._find()
        if not found:
            names = ' or '.join(client.srv_name for client in self._clients.values())
            return False, f'no service {names}: is the bridge running in {this_domain()}?'
        if len(found) > 1:
            return False, f'there are {" and ".join(found)}: stop one bridge, or name the one meant'
        ((name, client),) = found.items()
        problem = same_name_problem(self._node, client)
        if problem:
            return False, problem
        call = ServiceCall(client, self._timeout, waits=False)
        while (answer := call.poll()) is None:
            time.sleep(_POLL)
        return answer.accepted, f'{name}: {answer.message}'

    def _find(self) -> dict[str, Client]:
        deadline = time.monotonic() + self._timeout
        while True:
            found = self._ready()
            if found or time.monotonic() > deadline:
                return found
            time.sleep(_POLL)

    def _ready(self) -> dict[str, Client]:
        return {n: client for n, client in self._clients.items() if client.service_is_ready()}
