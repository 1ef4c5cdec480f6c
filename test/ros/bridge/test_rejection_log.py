import time
from collections.abc import Callable

import pytest
from quick_spinning import spin_once
from rclpy.node import Node

from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import REJECTIONS, CommandIntake
from aerarm_ros.ros.bridge.bridge_diagnostics import RejectionLog

PERIOD = 1e-3
TWO = 'joint_command has 2 publishers (/a, /b)'


class Cycle:
    """An intake that rejects, and the log of it."""

    def __init__(self, node: Node, capfd: pytest.CaptureFixture[str]) -> None:
        self.warning = ''
        self.intake = CommandIntake(['joint1'], BridgeSettings())
        self.rejections = RejectionLog(node, lambda: self.warning)
        self.node = node
        self._capfd = capfd
        self._text = ''

    def run(self, begin: float, seconds: float, reason: str = '', mode: str = 'running') -> None:
        for index in range(round(seconds / PERIOD)):
            now = begin + index * PERIOD
            if reason:
                self.intake.reject(reason, now)
            self.rejections.update(self.intake, mode, now)

    def lines(self) -> list[str]:
        self._text += self._capfd.readouterr().err
        return [line for line in self._text.splitlines() if 'a command was rejected' in line]

    def wait_for(self, condition: Callable[[list[str]], bool]) -> None:
        end = time.monotonic() + 60.0
        while not condition(self.lines()):
            assert time.monotonic() < end, self._text
            spin_once(self.node, 0.05)


@pytest.fixture
def cycle(ros_node: Node, capfd: pytest.CaptureFixture[str]) -> Cycle:
    return Cycle(ros_node, capfd)


def test_each_reason_is_one_warning_when_it_begins(cycle: Cycle) -> None:
    cycle.run(100.0, 30.0, 'nan')
    cycle.run(130.0, 1.0, 'length')
    cycle.wait_for(lambda lines: len(lines) == 2)
    nan, length = cycle.lines()
    assert '[WARN]' in nan
    assert nan.endswith(f'a command was rejected: {REJECTIONS["nan"]}')
    assert length.endswith(REJECTIONS['length'])


def test_a_repeated_rejection_is_logged_at_most_every_ten_seconds(cycle: Cycle) -> None:
    cycle.run(100.0, 1.0, 'nan')
    cycle.run(103.0, 1.0, 'nan')
    cycle.run(111.0, 1.0, 'nan')
    cycle.run(150.0, 1.0, 'length')
    cycle.wait_for(lambda lines: bool(lines) and lines[-1].endswith(REJECTIONS['length']))
    assert len(cycle.lines()) == 3


def test_publishers_that_are_found_a_little_later_are_named(cycle: Cycle) -> None:
    cycle.run(100.0, 0.1, 'source')
    spin_once(cycle.node, 0.1)
    assert cycle.lines() == []
    cycle.warning = TWO
    cycle.wait_for(lambda lines: len(lines) == 1)
    assert cycle.lines()[0].endswith(f'a command was rejected: {TWO}')
    cycle.run(200.0, 0.1, 'nan')
    cycle.wait_for(lambda lines: len(lines) == 2)
    assert cycle.lines()[1].endswith(REJECTIONS['nan'])


def test_commands_in_transit_when_the_arm_stops_are_not_logged(cycle: Cycle) -> None:
    cycle.run(100.0, 1.0)
    cycle.run(101.0, 0.1, 'not_ready', mode='fault')
    cycle.run(102.0, 0.1, 'nan', mode='fault')
    cycle.wait_for(lambda lines: bool(lines))
    assert len(cycle.lines()) == 1
    cycle.run(103.0, 1.0, 'not_ready', mode='fault')
    cycle.wait_for(lambda lines: len(lines) == 2)
    assert cycle.lines()[1].endswith(REJECTIONS['not_ready'])
