"""What a person asks of the bridge, from another process."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence

import rclpy
from rclpy.client import Client
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics

BRIDGES = ('hardware_bridge', 'fake_hardware')
ACTIONS = ('enable', 'disable', 'clear_fault', 'home', 'e_stop')
_SPIN = 0.05  # [s]


class ArmClientError(RuntimeError):
    """The bridge is absent, silent or refuses; the message says which and what to check."""


class ArmClient:
    """Calls the services of the bridge that is there and follows the arm's mode.

    Its methods spin the node themselves: no executor may hold it.

    Parameters
    ----------
    node
        Owner of clients and subscription.
    bridges
        Node names the bridge may have.

    Attributes
    ----------
    mode
        Last `arm_mode`, '' before the first.
    """

    def __init__(self, node: Node, bridges: Sequence[str] = BRIDGES) -> None:
        self.mode = ''
        self._node = node
        self._bridges = tuple(bridges)
        topic = topics.ARM_MODE
        self._subscription = node.create_subscription(
            topic.type, topic.name, self._on_mode, topic.qos
        )

    def call(self, action: str, timeout: float = 10.0) -> str:
        """Call a service of the bridge and return what it says.

        Parameters
        ----------
        action
            One of `ACTIONS`.
        timeout
            Longest time to find the bridge, and again for its answer [s].

        Raises
        ------
        ArmClientError
            If there is no bridge, or it does not answer, or refuses.
        """
        clients = [
            self._node.create_client(Trigger, f'{bridge}/{action}') for bridge in self._bridges
        ]
        try:
            return self._call(clients, action, timeout)
        finally:
            for client in clients:
                self._node.destroy_client(client)

    def wait_for_mode(self, modes: Collection[str], timeout: float) -> None:
        """Wait until the arm is in one of `modes`.

        Raises
        ------
        ArmClientError
            If it is not within `timeout` [s].
        """
        if not self._spin_until(lambda: self.mode in modes, timeout):
            seen = f"arm_mode is '{self.mode}'" if self.mode else 'there is no arm_mode'
            raise ArmClientError(
                f'waited {timeout:g} s for {" or ".join(modes)}: {seen}: see /diagnostics'
            )

    def _call(self, clients: Sequence[Client], action: str, timeout: float) -> str:
        def ready() -> list[Client]:
            return [client for client in clients if client.service_is_ready()]

        if not self._spin_until(ready, timeout):
            names = ' or '.join(client.srv_name for client in clients)
            raise ArmClientError(f'no service {names}: is a bridge running in this ROS domain?')
        client = ready()[0]
        future = client.call_async(Trigger.Request())
        if not self._spin_until(future.done, timeout):
            raise ArmClientError(f'{client.srv_name} gave no answer within {timeout:g} s')
        reply = future.result()
        if not reply.success:
            raise ArmClientError(f'{action} refused: {reply.message}')
        return str(reply.message)

    def _spin_until(self, condition: Callable[[], object], timeout: float) -> bool:
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                return False
            rclpy.spin_once(self._node, timeout_sec=_SPIN)
        return True

    def _on_mode(self, message: String) -> None:
        self.mode = message.data
