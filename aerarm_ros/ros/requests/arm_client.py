"""What a person asks of the bridge, from another process."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence

from rclpy.client import Client
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_ros.ros.bridge.bridge_services import ACTIONS, STOPS
from aerarm_ros.ros.executors.spinning import spin_until, this_domain

BRIDGES = ('hardware_bridge', 'fake_hardware')
_DISCOVERY_TIME = 0.5  # [s]
_QUIET = 1.0  # [s] in which who waits need not be told what for


class ArmClientError(RuntimeError):
    """A node is absent, silent or refuses; the message says which and what to check."""


class ArmClient:
    """Calls the services of the bridge that is there and follows the arm's mode.

    Its methods spin the node themselves: no executor may hold it. The service clients are made
    at once: an answer to a client that the bridge has not discovered yet is lost.

    Parameters
    ----------
    node
        Owner of clients and subscription.
    bridges
        Node names the bridge may have.
    actions
        Those that will be called.
    on_wait
        Told what is waited for, if there is no bridge for a second.

    Attributes
    ----------
    mode
        Last `arm_mode`, '' before the first.
    """

    def __init__(
        self,
        node: Node,
        bridges: Sequence[str] = BRIDGES,
        actions: Collection[str] = ACTIONS,
        on_wait: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.mode = ''
        self._node = node
        self._on_wait = on_wait
        self._clients = {
            action: [node.create_client(Trigger, f'{bridge}/{action}') for bridge in bridges]
            for action in actions
        }
        topic = topics.ARM_MODE
        self._subscription = node.create_subscription(
            topic.type, topic.name, self._on_mode, topic.qos
        )

    def call(self, action: str, timeout: float = 10.0) -> str:
        """Call a service of the bridge and return what it says.

        With several bridges, what stops an arm goes to all of them, and nothing else to any.

        Parameters
        ----------
        action
            One of those given at the start.
        timeout
            Longest time to find the bridge, and again for its answer [s].

        Raises
        ------
        ArmClientError
            If there is no bridge, or it does not answer, or refuses.
        """
        clients = self._clients[action]

        def ready() -> list[Client]:
            return [client for client in clients if client.service_is_ready()]

        if not self._find(ready, timeout):
            names = ' or '.join(client.srv_name for client in clients)
            raise ArmClientError(f'no service {names}: is a bridge running in {this_domain()}?')
        found = ready()
        if len(found) > 1 and action not in STOPS:
            names = ' and '.join(client.srv_name for client in found)
            raise ArmClientError(f'there are {names}: stop one bridge, or name the one meant')
        replies = [self._ask(client, timeout) for client in found]
        if action in STOPS:
            # Who was found first is stopped first; another bridge may only just be discovered.
            spin_until(self._node, lambda: len(ready()) == len(clients), _DISCOVERY_TIME)
            replies += [self._ask(client, timeout) for client in ready() if client not in found]
        refusals = [reply.message for reply in replies if not reply.success]
        if refusals:
            raise ArmClientError(f'{action} refused: {"; ".join(refusals)}')
        return '; '.join(reply.message for reply in replies)

    def wait_for_mode(self, modes: Collection[str], timeout: float) -> None:
        """Wait until the arm is in one of `modes`.

        Raises
        ------
        ArmClientError
            If it is not within `timeout` [s].
        """
        deadline = time.monotonic() + timeout
        self._find(lambda: self.mode, timeout)
        left = deadline - time.monotonic()
        if not spin_until(self._node, lambda: self.mode in modes, left):
            seen = f'there is no arm_mode: is a bridge running in {this_domain()}?'
            if self.mode:
                seen = f"arm_mode is '{self.mode}': see the log of the bridge"
            raise ArmClientError(f'waited {timeout:g} s for {" or ".join(modes)}: {seen}')

    def _find(self, condition: Callable[[], object], timeout: float) -> bool:
        """Wait for what shows that a bridge is there, and say so after a second."""
        if spin_until(self._node, condition, min(timeout, _QUIET)):
            return True
        if timeout <= _QUIET:
            return False
        self._on_wait(f'a bridge in {this_domain()}')
        return spin_until(self._node, condition, timeout - _QUIET)

    def _ask(self, client: Client, timeout: float) -> Trigger.Response:
        future = client.call_async(Trigger.Request())
        if not spin_until(self._node, future.done, timeout):
            client.remove_pending_request(future)
            raise ArmClientError(
                f'{client.srv_name} gave no answer within {timeout:g} s: see arm_mode'
            )
        return future.result()

    def _on_mode(self, message: String) -> None:
        self.mode = message.data
