"""The bridge in this process: what it does beside its cycle, and whatever ends the cycle."""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
import rclpy
from std_srvs.srv import Trigger

from aerarm_ros.ros.emulation.fake_hardware import FakeHardware


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


class Quiet(FakeHardware):
    """Counts what the executor beside the cycle does in some seconds of cycles."""

    cycles = 0
    pieces = 0

    def __init__(self):
        super().__init__()
        wait = self._slack.wait

        def counted():
            self.pieces += 1
            wait()

        self._slack.wait = counted

    def _run_cycle(self, cycle, timing, now):
        super()._run_cycle(cycle, timing, now)
        self.cycles += 1
        if self.cycles == 500:  # discovery and the first modes are over
            self.before = self.pieces
        if self.cycles == 4000:
            self.after = self.pieces
            self.stop()


class AskedEarly(FakeHardware):
    """Is asked for something before its cycle runs, and ends once that is answered."""

    action = 'enable'
    answer = None

    def make_transport(self, config, robot, profile):
        def ask():
            service = next(s for s in self.services if s.srv_name.endswith(f'/{self.action}'))
            self.answer = service.callback(Trigger.Request(), Trigger.Response())
            self.stop()

        self.asking = threading.Thread(target=ask)
        self.asking.start()
        self.asking.join(0.2)
        return super().make_transport(config, robot, profile)


class AskedHome(AskedEarly):
    action = 'home'


class AskedAndFailing(AskedEarly):
    def make_transport(self, config, robot, profile):
        super().make_transport(config, robot, profile)
        raise ValueError('a wrong value')


@pytest.fixture
def start(ros_domain: dict[str, str]) -> Iterator[Callable[[type[FakeHardware]], FakeHardware]]:
    """Return a function that makes a bridge in this process."""
    interval = sys.getswitchinterval()
    rclpy.init(args=['--ros-args', '-p', 'freeze_gc:=false'])
    with ExitStack() as stack:

        def make(bridge: type[FakeHardware]) -> FakeHardware:
            node = bridge()
            stack.callback(node.close)
            return node

        yield make
    rclpy.try_shutdown()
    sys.setswitchinterval(interval)


def test_nothing_periodic_wakes_the_executor_beside_the_cycle(start) -> None:
    quiet = start(Quiet)
    quiet.run()
    assert quiet.before > 0  # the modes at the start were logged
    assert quiet.after == quiet.before


def test_an_exception_in_the_cycle_switches_the_motors_off(start) -> None:
    defective = start(Defective)
    with pytest.raises(ZeroDivisionError):
        defective.run()
    assert defective.was_enabled == [True, True]
    assert not any(board.system_enabled for board in defective._boards.boards)
    with pytest.raises(RuntimeError, match='not active'):
        defective.requests.ask(lambda cycle: cycle.enable())


@pytest.mark.parametrize('bridge', [AskedEarly, AskedHome])
def test_what_is_asked_of_a_bridge_that_starts_is_done_once_its_boards_are_known(
    start, bridge
) -> None:
    node = start(bridge)
    node.run()
    node.asking.join()
    assert node.answer.success, node.answer.message
    assert 'the motors align' in node.answer.message


def test_who_asks_a_bridge_that_cannot_start_is_told_at_once(start) -> None:
    node = start(AskedAndFailing)
    with pytest.raises(OSError, match='a wrong value'):
        node.run()
    node.asking.join()
    assert 'not active' in node.answer.message
