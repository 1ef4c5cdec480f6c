"""A service of the bridge, for a node whose executor runs in another thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence

from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.ros.bridge.bridge_services import STOPS
from aerarm_ros.ros.executors.spinning import this_domain

_POLL = 0.02  # [s]


class BridgeService:
    """Calls a service of the bridge that is there.

    With several bridges, what stops an arm goes to all of them, and nothing else to any.

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
        self._clients = {name: node.create_client(Trigger, f'{name}/{action}') for name in bridges}
        self._is_stop = action in STOPS
        self._timeout = timeout

    @property
    def is_found(self) -> bool:
        """Whether a bridge is there by now."""
        return bool(self._ready())

    def call(self) -> tuple[bool, str]:
        """Ask; blocks until every bridge that is asked has answered.

        Returns
        -------
        done
            Whether every bridge asked has confirmed, and there was one.
        text
            What the bridges said, or why none was asked.
        """
        found = self._find()
        if not found:
            names = ' or '.join(client.srv_name for client in self._clients.values())
            return False, f'no service {names}: is the bridge running in {this_domain()}?'
        if len(found) > 1 and not self._is_stop:
            return False, f'there are {" and ".join(found)}: stop one bridge, or name the one meant'
        answers = self._call_all(found)
        if self._is_stop:
            # Who was found first is stopped first; others may have been discovered meanwhile.
            answers |= self._call_all({n: c for n, c in self._ready().items() if n not in found})
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

    def _call_all(self, clients: Mapping[str, Client]) -> dict[str, tuple[bool, str]]:
        """Ask all at once, so that a silent bridge delays no other's stop."""
        waiting = {name: _Call(client) for name, client in clients.items()}
        deadline = time.monotonic() + self._timeout
        return {name: call.answer(deadline, self._timeout) for name, call in waiting.items()}


class _Call:
    """One request under way."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._answered = threading.Event()
        self._future = client.call_async(Trigger.Request())
        self._future.add_done_callback(lambda _: self._answered.set())

    def answer(self, deadline: float, timeout: float) -> tuple[bool, str]:
        """Return what the bridge says, waiting until `deadline` [s, monotonic]."""
        text = ''
        while not text and not self._answered.wait(_POLL):
            if time.monotonic() > deadline:
                text = f'no answer within {timeout:g} s'
            elif not self._client.service_is_ready():
                text = 'it has ended'
        if text and not self._answered.is_set():
            self._client.remove_pending_request(self._future)
            return False, text
        reply = self._future.result()
        return bool(reply.success), reply.message
