"""Measurements of the node `motor_bench`: joint states, commands and motor power."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.cdr import Float64ArrayCdr
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.excitation.bench_motion import BenchMeasurement, split
from aerarm_ros.identification.motor_bench.motor_friction import MotorRun, MotorSupply
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.ros.bridge.bridge_diagnostics import MOTORS, POWER_FROM, resistance_key

_NUMBER = 'publication_sequence_number'
_STATES, _POWER = 0, 1


class MotorReadings:
    """Receive and store current, speed, power and winding resistance of all motors.

    An executor must spin the node, so that the diagnostics with the resistances arrive.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    joint_names
        Names of the n joints.
    """

    def __init__(self, node: Node, joint_names: tuple[str, ...]) -> None:
        self._names = joint_names
        self._namespace = node.get_namespace()
        self._reader = RawReader(node, topics.MOTOR_STATES, topics.MOTOR_POWER)
        self._states, self._power = JointStateCdr(joint_names), Float64ArrayCdr(len(joint_names))
        self._waiting: dict[int, tuple[int, bytes]] = {}  # message number and message, by topic
        self._rows: list[NDArray[np.float64]] = []
        self._pairs: dict[str, str] = {}
        topic = topics.DIAGNOSTICS
        node.create_subscription(topic.type, topic.name, self._on_diagnostics, topic.qos)

    def take(self) -> None:
        """Read new messages; store motor states and power if they are of the same bridge cycle."""
        for index in (_STATES, _POWER):
            message = self._reader.take_newest(index)
            if message is not None:
                self._waiting[index] = message[1][_NUMBER], message[0]
        if len(self._waiting) == 2 and self._waiting[_STATES][0] == self._waiting[_POWER][0]:
            self._add(self._waiting[_STATES][1], self._waiting[_POWER][1])
            self._waiting.clear()

    def supply(self, joint: int) -> MotorSupply:
        """Return the stored measurements of the motor of one joint."""
        rows = self._rows if self._pairs.get(POWER_FROM) == 'voltage' else []
        table = np.array(rows).reshape(len(rows), 1 + 3 * len(self._names))
        current, speed, power = np.split(table[:, 1:], 3, axis=1)
        return MotorSupply(
            table[:, 0], current[:, joint], speed[:, joint], power[:, joint], self._reported(joint)
        )

    def _reported(self, joint: int) -> float:
        try:
            return float(self._pairs[resistance_key(self._names[joint])])
        except (KeyError, ValueError):  # a node other than the bridge published this status
            return float('nan')

    def destroy(self) -> None:
        """Destroy the subscriptions to motor states and motor power."""
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
                self._pairs = {pair.key: pair.value for pair in status.values}


_TYPE = 'sensor_msgs/msg/JointState'
_BENCH_STATES, _COMMANDS = 0, 1


class BenchRecording:
    """Store joint states and commands of a bench motion, in memory and in a bag.

    Parameters
    ----------
    bag
        Directory of the bag, which must not exist.
    joint_names
        Names of the n joints.
    topics
        Full topic names of joint_states and joint_command.
    """

    def __init__(self, bag: Path, joint_names: tuple[str, ...], topics: tuple[str, str]) -> None:
        self._codec = JointStateCdr(joint_names)
        self._writer = BagWriter(bag, [RecordedTopic(name, _TYPE) for name in topics])
        self._rows: list[NDArray[np.float64]] = []
        self._first_ns: int | None = None

    def add(self, stamp_ns: int, path_time: float, state: ArmState, command: bytes) -> None:
        """Store a joint state, its time along the motion [s], and the command that answers it."""
        if self._first_ns is None:
            self._first_ns = stamp_ns
        time = 1e-9 * (stamp_ns - self._first_ns)
        self._rows.append(np.concatenate([[path_time, time], state.q, state.dq, state.tau]))
        number = len(self._rows)
        payload = bytes(self._codec.pack(stamp_ns, state.q, state.dq, state.tau))
        for topic, message in ((_BENCH_STATES, payload), (_COMMANDS, command)):
            self._writer.write(RecordedMessage(topic, message, stamp_ns, stamp_ns, number))

    def close(self) -> None:
        """Complete the bag; raises BagError if the bag could not be written."""
        self._writer.close()

    def runs(self, measurements: list[BenchMeasurement]) -> dict[int, list[MotorRun]]:
        """Return the test runs of each joint, by joint index; each measurement is one run."""
        table = np.array(self._rows)
        path_time, time = table[:, 0], table[:, 1]
        q, dq, tau = np.split(table[:, 2:], 3, axis=1)
        runs: dict[int, list[MotorRun]] = {}
        for measurement, rows in split(measurements, path_time):
            joint = measurement.joint
            run = MotorRun(
                measurement.speed,
                time[rows],
                q[rows, joint],
                dq[rows, joint],
                tau[rows, joint],
                measurement.swings,
            )
            runs.setdefault(joint, []).append(run)
        return runs
