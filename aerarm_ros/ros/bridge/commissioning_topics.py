"""Topics for the commissioning of an arm, and the commissioning record that the bridge reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.commissioning.commissioning_record import (
    CommissioningRecord,
    load_record,
    record_path,
)
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.description.resources import resource
from aerarm_ros.hardware.boards.commissioning_probe import OFF, ProbeReport, ProbeRequest
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.bridge_modes import OFF as OFF_MODES
from aerarm_ros.hardware.bridge_modes import Action, Answer
from aerarm_ros.ros.parameters.parameter import Parameter

AUTO = 'auto'
# Modes in which the motors are off once a commissioning client has ended.
_MOTORS_OFF = (*OFF_MODES, 'commissioning')
COMMISSIONING_PARAMETER = Parameter(
    'commissioning_record',
    AUTO,
    "file with the record of 'arm commission'. 'auto' is CONFIG.commissioning.yaml next to the "
    'configuration file. If empty, the bridge uses no record and does not warn',
)


class RecordWatch:
    """Read the arm's commissioning record, and warn if the arm counts as not commissioned.

    Parameters
    ----------
    node
        Node that logs each problem once.
    values
        Parameters of the node.
    config
        Configuration of the arm, with the joint names of its topics.
    emulated
        Whether the boards are emulated.

    Attributes
    ----------
    problem
        Reason why the arm counts as not commissioned. Empty if the arm is commissioned, or if the
        bridge uses no record.
    """

    def __init__(
        self, node: Node, values: SimpleNamespace, config: ArmConfig, emulated: bool
    ) -> None:
        self.problem, self.emulated = '', emulated
        self._node, self._config, self._prefix = node, config, values.tf_prefix
        self._record = CommissioningRecord(config.name)
        source = Path(values.config) if values.config else resource('config', 'aerarm.yaml')
        given = values.commissioning_record
        path = record_path(source, emulated) if given == AUTO else Path(given)
        self._path = path if given else None
        self.look()

    @property
    def pulse_offset(self) -> NDArray[np.float64]:
        """Recorded motor angle of each joint's index pulse (n,) [rad], zero if not recorded."""
        return self._record.pulse_offset(self._config)

    def look(self) -> None:
        """Read the commissioning record again, and log each new reason why it is unusable."""
        if self._path is None:
            return
        before, self.problem = self.problem, self._read(self._path)
        if self.problem and self.problem != before:
            self._node.get_logger().warning(self.problem)

    def _read(self, path: Path) -> str:
        self._record = CommissioningRecord(self._config.name)
        if not path.exists():
            return f"the arm is not commissioned, because {path} is missing: run 'arm commission'"
        try:
            record = load_record(path).with_prefix(self._prefix)
        except ConfigError as error:
            return str(error)
        problem = record.problem(self._config, self.emulated)
        if record.arm == self._config.name and record.emulated == self.emulated:
            self._record = record
        return problem


class CommissioningTopics:
    """Pass commissioning requests to the cycle's thread, and publish the resulting reports.

    Parameters
    ----------
    node
        Owner of publisher and subscription.
    ask
        Runs an action in the cycle's thread, as `CycleRequests.ask` does.
    record
        Commissioning record, which is read again after each commissioning client has ended.
    """

    def __init__(self, node: Node, ask: Callable[[Action], Answer], record: RecordWatch) -> None:
        self._node = node
        self._ask = ask
        self._record = record
        self._publisher = topics.COMMISSIONING_REPORT.publisher(node)
        self._subscription = topics.COMMISSIONING_REQUEST.subscription(node, self._answer)

    def destroy(self) -> None:
        """Destroy publisher and subscription."""
        self._node.destroy_publisher(self._publisher)
        self._node.destroy_subscription(self._subscription)

    def _answer(self, message: String) -> None:
        reports: list[ProbeReport] = []
        try:
            request = ProbeRequest.parse(message.data)

            def action(cycle: BridgeCycle) -> Answer:
                reports.append(cycle.probe.ask(request, cycle.mode))
                return Answer(True, '')

            self._ask(action)
            if request.kind == OFF:
                self._use_record()
        except ValueError as error:
            self._node.get_logger().warning(str(error), throttle_duration_sec=10.0)
        except (RuntimeError, TimeoutError):
            return  # no cycle runs: the client reports a missing answer
        if not reports:
            return
        report = replace(reports[0], emulated=self._record.emulated)
        self._publisher.publish(String(data=report.text()))

    def _use_record(self) -> None:
        """Read the commissioning record again, and use it for homing from now on."""
        self._record.look()
        offset = self._record.pulse_offset

        def action(cycle: BridgeCycle) -> Answer:
            problem = cycle.recall.take_pulse_offset(offset, cycle.mode in _MOTORS_OFF)
            return Answer(not problem, problem)

        answer = self._ask(action)
        if not answer.accepted:
            self._node.get_logger().warning(answer.message, throttle_duration_sec=10.0)
