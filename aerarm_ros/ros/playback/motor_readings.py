"""What the bridge tells of the motors while their joints are measured."""

from __future__ import annotations

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.float64_array_cdr import Float64ArrayCdr
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics.raw_reader import RawReader
from aerarm_ros.identification.motor_bench.motor_supply import MotorSupply
from aerarm_ros.ros.bridge.bridge_diagnostics import MOTORS, POWER_FROM, resistance_key

_NUMBER = 'publication_sequence_number'
_STATES, _POWER = 0, 1


class MotorReadings:
    """Current, speed and power of each motor, and the resistance that its board reports.

    Diagnostics come by an executor that spins the node.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    joint_names
        Of the n joints.
    """

    def __init__(self, node: Node, joint_names: tuple[str, ...]) -> None:
        self._names = joint_names
        self._namespace = node.get_namespace()
        self._reader = RawReader(node, topics.MOTOR_STATES, topics.MOTOR_POWER)
        self._states, self._power = JointStateCdr(joint_names), Float64ArrayCdr(len(joint_names))
        self._waiting: dict[int, tuple[int, bytes]] = {}  # by topic: number and message
        self._rows: list[NDArray[np.float64]] = []
        self._told: dict[str, str] = {}
        topic = topics.DIAGNOSTICS
        node.create_subscription(topic.type, topic.name, self._on_diagnostics, topic.qos)

    def take(self) -> None:
        """Take what is new; states and power count where they are of the same cycle."""
        for index in (_STATES, _POWER):
            message = self._reader.take_newest(index)
            if message is not None:
                self._waiting[index] = message[1][_NUMBER], message[0]
        if len(self._waiting) == 2 and self._waiting[_STATES][0] == self._waiting[_POWER][0]:
            self._add(self._waiting[_STATES][1], self._waiting[_POWER][1])
            self._waiting.clear()

    def supply(self, joint: int) -> MotorSupply:
        """Return what was read of a joint's motor."""
        rows = self._rows if self._told.get(POWER_FROM) == 'voltage' else []
        table = np.array(rows).reshape(len(rows), 1 + 3 * len(self._names))
        current, speed, power = np.split(table[:, 1:], 3, axis=1)
        return MotorSupply(
            table[:, 0], current[:, joint], speed[:, joint], power[:, joint], self._reported(joint)
        )

    def _reported(self, joint: int) -> float:
        try:
            return float(self._told[resistance_key(self._names[joint])])
        except (KeyError, ValueError):  # whoever may publish diagnostics
            return float('nan')

    def destroy(self) -> None:
        """Destroy the subscriptions of the fast topics."""
        self._reader.destroy()

    def _add(self, states: bytes, power: bytes) -> None:
        sample, watts = self._states.unpack(states), self._power.unpack(power)
        if sample is None or sample.velocity is None or sample.effort is None or watts is None:
            return
        row = np.concatenate([[1e-9 * sample.stamp_ns], sample.effort, sample.velocity, watts])
        if np.isfinite(row).all():
            self._rows.append(row)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            # /NAMESPACE/BRIDGE: motors
            node, _, part = status.name.partition(': ')
            if part == MOTORS and node.rpartition('/')[0] == self._namespace.rstrip('/'):
                self._told = {pair.key: pair.value for pair in status.values}
