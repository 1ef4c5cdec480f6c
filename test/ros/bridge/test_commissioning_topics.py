"""Commissioning topics without a bridge: use of the record."""

from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.node import Node
from std_msgs.msg import String

from aerarm_ros.commissioning.commissioning_record import CommissioningRecord, JointRecord
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.boards.commissioning_probe import OFF, WATCH, ProbeReport, ProbeRequest
from aerarm_ros.ros.bridge.commissioning_topics import CommissioningTopics, RecordWatch


class StubCycle:
    """Interface of a cycle for commissioning."""

    mode = 'unhomed'

    def __init__(self) -> None:
        self.probe = self.recall = self
        self.offsets: list[np.ndarray] = []

    def ask(self, request: ProbeRequest, mode: str) -> ProbeReport:
        return ProbeReport(request.id, 'off', '', mode, (), (), (), (), (), ())

    def take_pulse_offset(self, offset: np.ndarray, motors_are_off: bool) -> str:
        assert motors_are_off
        self.offsets.append(offset)
        return ''


def test_pulse_offsets_are_used_once_a_client_has_ended(ros_node: Node, tmp_path: Path) -> None:
    config, path = load_arm_config(), tmp_path / 'record.yaml'
    values = SimpleNamespace(tf_prefix='', config='', commissioning_record=str(path))
    record, cycle = RecordWatch(ros_node, values, config, emulated=False), StubCycle()
    assert 'is not commissioned' in record.problem
    bridge = CommissioningTopics(ros_node, lambda action: action(cycle), record)
    now = datetime(2026, 3, 1, tzinfo=UTC)
    entries = {j.name: JointRecord.of(j, now, [], {'pulse_offset': 1.25}) for j in config.joints}
    CommissioningRecord(config.name, False, now, entries).save(path)
    bridge._answer(String(data=ProbeRequest('a:1', WATCH).text()))
    assert cycle.offsets == []
    bridge._answer(String(data=ProbeRequest('a:end', OFF).text()))
    assert [offset.tolist() for offset in cycle.offsets] == [pytest.approx([1.25] * 4)]
    assert record.problem == ''
    bridge._answer(String(data='[' * 5000))  # is logged, and nothing else
    assert len(cycle.offsets) == 1
    bridge.destroy()
