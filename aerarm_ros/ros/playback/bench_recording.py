"""What the motor bench measured: samples for its own use, and a bag for everybody's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.bags.recorded_message import RecordedMessage
from aerarm_msgs_py.bags.recorded_topic import RecordedTopic
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.excitation.planning.bench_measurement import BenchMeasurement, split
from aerarm_ros.identification.motor_bench.motor_run import MotorRun
from aerarm_ros.motion.arm_state import ArmState

_TYPE = 'sensor_msgs/msg/JointState'
_STATES, _COMMANDS = 0, 1


class BenchRecording:
    """Samples of a bench's motion.

    Parameters
    ----------
    bag
        Directory of the bag, must not exist.
    joint_names
        Of the n joints.
    topics
        Names of joint_states and joint_command, as resolved.
    """

    def __init__(self, bag: Path, joint_names: tuple[str, ...], topics: tuple[str, str]) -> None:
        self._codec = JointStateCdr(joint_names)
        self._writer = BagWriter(bag, [RecordedTopic(name, _TYPE) for name in topics])
        self._rows: list[NDArray[np.float64]] = []
        self._first_ns: int | None = None

    def add(self, stamp_ns: int, path_time: float, state: ArmState, command: bytes) -> None:
        """Keep a state, when along the motion [s] it was measured, and its command."""
        if self._first_ns is None:
            self._first_ns = stamp_ns
        time = 1e-9 * (stamp_ns - self._first_ns)
        self._rows.append(np.concatenate([[path_time, time], state.q, state.dq, state.tau]))
        number = len(self._rows)
        payload = bytes(self._codec.pack(stamp_ns, state.q, state.dq, state.tau))
        for topic, message in ((_STATES, payload), (_COMMANDS, command)):
            self._writer.write(RecordedMessage(topic, message, stamp_ns, stamp_ns, number))

    def close(self) -> None:
        """Complete the bag; raises BagError if it could not be written."""
        self._writer.close()

    def runs(self, measurements: list[BenchMeasurement]) -> dict[int, list[MotorRun]]:
        """Return the runs of each joint."""
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
