"""A person's emergency stop, through the bridge's service."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import Trigger

_POLL = 0.02  # [s]


class EmergencyStop:
    """Calls `e_stop` of every bridge that is there.

    Parameters
    ----------
    node
        Owner of the clients; an executor must spin it in another thread.
    bridges
        Node names of the bridges, relative or absolute.
    timeout
        Longest time to find a bridge, and again for its answer [s].
    """

    def __init__(self, node: Node, bridges: Sequence[str], timeout: float = 1.0) -> None:
        self._clients = {name: node.create_client(Trigger, f'{name}/e_stop') for name in bridges}
        self._timeout = timeout

    def press(self) -> tuple[bool, str]:
        """Stop the arm; blocks until the bridges have answered.

        Returns
        -------
        stopped
            Whether every bridge found has confirmed, and there was one.
        text
            What the bridges said, or why nothing was stopped.
        """
        found = self._find()
        if not found:
            names = ' or '.join(client.srv_name for client in self._clients.values())
            return False, f'no service {names}: is the bridge running in this ROS domain?'
        answers = {name: self._call(client) for name, client in found.items()}
        # Who was found first is stopped first; others may have been discovered meanwhile.
        late = {n: client for n, client in self._ready().items() if n not in found}
        answers |= {name: self._call(client) for name, client in late.items()}
        text = '; '.join(f'{name}: {reply}' for name, (_, reply) in answers.items())
        return all(done for done, _ in answers.values()), text

    def _find(self) -> dict[str, Client]:
        deadline = time.monotonic() + self._timeout
        while True:
            found = self._ready()
            if found or time.monotonic() > deadline:
                return found
            time.sleep(_POLL)

    def _ready(self) -> dict[str, Client]:
        return {n: client for n, client in self._clients.items() if client.service_is_ready()}

    def _call(self, client: Client) -> tuple[bool, str]:
        answered = threading.Event()
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(self._timeout):
            client.remove_pending_request(future)
            return False, f'no answer within {self._timeout:g} s'
        reply = future.result()
        return bool(reply.success), reply.message
