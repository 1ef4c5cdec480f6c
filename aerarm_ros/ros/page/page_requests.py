"""What the page's buttons ask of the bridge."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from aerarm_ros.ros.bridge.bridge_services import ACTIONS, STOPS
from aerarm_ros.ros.requests.bridge_service import BridgeService
from aerarm_ros.ros.requests.stop_service import StopService

PUT_BACK = 'put_back'
_FAULT = 'fault '
_TIMEOUT = 3.0  # [s] to find a parameter's node, and again for its answer


class PageRequests:
    """Calls the bridge's services, and mends an emulated board as `arm fault` does.

    Parameters
    ----------
    node
        An executor must spin it in another thread.
    bridges
        Node names of the bridges.
    """

    def __init__(self, node: Node, bridges: Sequence[str]) -> None:
        self._node = node
        self._bridges = bridges
        self._stops = {action: StopService(node, action, bridges) for action in STOPS}
        self._services = {
            action: BridgeService(node, action, bridges)
            for action in (*ACTIONS, PUT_BACK)
            if action not in STOPS
        }
        self._lock = threading.Lock()
        self._parameters: dict[str, AsyncParameterClient] = {}

    @property
    def emulated(self) -> str:
        """Node name of a bridge with emulated boards that is there, or ''."""
        return self._services[PUT_BACK].found

    def look_for_bridges(self) -> None:
        """Get ready to stop those that are there by now, whatever they are called."""
        for stop in self._stops.values():
            stop.look()

    def ask(self, action: str) -> tuple[bool, str]:
        """Ask for an action by its name, or for 'fault NAME:BOARD'; blocks until it is answered.

        Returns
        -------
        done, text
            Whether it was done, and what the bridge says.
        """
        if action.startswith(_FAULT):
            return self._mend(action.removeprefix(_FAULT))
        service = self._stops.get(action) or self._services.get(action)
        return (False, f'there is no {action}') if service is None else service.call()

    def _mend(self, fault: str) -> tuple[bool, str]:
        """Set the parameter `fault` of the emulated bridge."""
        with self._lock:
            for bridge in self._bridges:
                client = self._client(bridge)
                if client.wait_for_services(_TIMEOUT):
                    return self._set(client, fault)
        return False, 'no emulated bridge takes a fault'

    def _client(self, bridge: str) -> AsyncParameterClient:
        if bridge not in self._parameters:
            self._parameters[bridge] = AsyncParameterClient(self._node, bridge)
        return self._parameters[bridge]

    def _set(self, client: AsyncParameterClient, fault: str) -> tuple[bool, str]:
        answered = threading.Event()
        future = client.set_parameters([Parameter('fault', value=fault)])
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(_TIMEOUT):
            return False, f'no answer within {_TIMEOUT:g} s'
        answer = future.result().results[0]
        return bool(answer.successful), answer.reason or fault
