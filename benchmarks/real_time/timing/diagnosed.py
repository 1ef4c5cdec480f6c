"""Diagnostics of measured nodes, and a client of their parameters."""

import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from aerarm_msgs_py.topics import DIAGNOSTICS
from aerarm_ros.ros.requests.arm_client import ArmClientError

CLIENT_PERIOD = 0.1  # [s] between two pairs of requests


class Diagnosed:
    """Values of the newest diagnostics by status, and a client of the bridge's parameters."""

    def __init__(self, node: Node, bridge: str) -> None:
        self._node = node
        self.values: dict[str, dict[str, str]] = {}
        self._client = AsyncParameterClient(node, bridge)
        self._subscription = node.create_subscription(
            DIAGNOSTICS.type, DIAGNOSTICS.name, self._on_diagnostics, DIAGNOSTICS.qos
        )

    def spin(self, seconds: float) -> None:
        """Receive messages for a time [s]."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self._node, timeout_sec=left)

    def wait_for(self, status: str, key: str) -> None:
        """Wait until a status with a value of this key has been received.

        Raises
        ------
        ArmClientError
            If the status does not arrive.
        """
        end = time.monotonic() + 20.0
        while key not in self.values.get(status, {}):
            if time.monotonic() > end:
                raise ArmClientError(
                    f'no diagnostics of {status} {key} in 20 s: check the load of this computer'
                )
            self.spin(0.1)

    def use_parameters(self, seconds: float) -> None:
        """Get and set a parameter ten times per second."""
        for step in range(round(seconds / CLIENT_PERIOD)):
            start = time.monotonic()
            gains = [Parameter('board_kd', value=[0.2 + 0.001 * (step % 50)])]
            for future in (
                self._client.set_parameters(gains),
                self._client.get_parameters(['board_kd', 'period']),
            ):
                rclpy.spin_until_future_complete(self._node, future, timeout_sec=1.0)
            self.spin(start + CLIENT_PERIOD - time.monotonic())

    def destroy(self) -> None:
        """Destroy the subscription."""
        self._node.destroy_subscription(self._subscription)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            part = status.name.rsplit(' ', 1)[-1]
            self.values[part] = {item.key: item.value for item in status.values}
