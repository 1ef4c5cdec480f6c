"""The bridge's last resort: whatever ends the cycle, the motors go off."""

import sys
from collections.abc import Iterator

import pytest
import rclpy

from aerarm_ros.nodes.fake_hardware import FakeHardware


class Defective(FakeHardware):
    """Enables the arm, drives it for a moment, and then meets a defect."""

    cycles = 0

    def _run_cycle(self, cycle, timing, now):
        super()._run_cycle(cycle, timing, now)
        self.cycles += 1
        if cycle.mode == 'idle':
            cycle.enable()
        if cycle.mode == 'aligning' and self.cycles > 100:
            self.was_enabled = [board.system_enabled for board in self._boards.boards]
            raise ZeroDivisionError('a defect')


@pytest.fixture
def defective(ros_domain: dict[str, str]) -> Iterator[Defective]:
    interval = sys.getswitchinterval()
    rclpy.init(args=['--ros-args', '-p', 'freeze_gc:=false'])
    node = Defective()
    yield node
    node.close()
    rclpy.try_shutdown()
    sys.setswitchinterval(interval)


def test_an_exception_in_the_cycle_switches_the_motors_off(defective: Defective) -> None:
    with pytest.raises(ZeroDivisionError):
        defective.run()
    assert defective.was_enabled == [True, True]
    assert not any(board.system_enabled for board in defective._boards.boards)
    with pytest.raises(RuntimeError, match='not active'):
        defective.requests.ask(lambda cycle: cycle.enable())
