"""The bridge in this process: work next to its cycle, and all ends of the cycle."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
import rclpy
from quick_spinning import spin_until
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_modes import Answer
from aerarm_ros.ros.bridge.hardware_bridge import HardwareBridge
from aerarm_ros.ros.emulation.emulated_arm import EmulatedArm
from aerarm_ros.ros.requests.bridge_service import ServiceCall

LIMIT = 60.0  # [s]


class FakeHardware(HardwareBridge):
    """A bridge on emulated boards."""

    def __init__(self):
        super().__init__('fake_hardware', EmulatedArm())

    @property
    def boards(self):
        return self.world.boards.boards


class Defective(FakeHardware):
    """Bridge that enables the arm, drives it for a moment, and then fails."""

    cycles = 0

    def _run_cycle(self, cycle, timing, now):
        super()._run_cycle(cycle, timing, now)
        self.cycles += 1
        if cycle.mode == 'idle':
            cycle.enable()
        if cycle.mode == 'aligning' and self.cycles > 100:
            self.was_enabled = [board.system_enabled for board in self.boards]
            raise ZeroDivisionError('a defect')


class Quiet(FakeHardware):
    """Counts what the executor beside the cycle does in 1.3 s of cycles; diagnostics are 1 Hz."""

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
        if self.cycles == 1800:
            self.after = self.pieces
            self.stop()


class Unhurried(FakeHardware):
    """Begins its first cycle once it is asked for something, while no board is known yet."""

    has_begun = False

    def _run_cycle(self, cycle, timing, now):
        end = time.monotonic() + LIMIT
        while not self.has_begun and not self.requests.are_waiting:
            assert time.monotonic() < end
            time.sleep(1e-3)
        self.has_begun = True
        super()._run_cycle(cycle, timing, now)


class StoppedEarly(FakeHardware):
    """Is stopped while it starts."""

    def on_activate(self, state):
        self.stop()
        return super().on_activate(state)


@pytest.fixture
def start(ros_domain: dict[str, str]) -> Iterator[Callable[[type[FakeHardware]], FakeHardware]]:
    """Return a function that makes a bridge in this process."""
    interval = sys.getswitchinterval()
    given = ('freeze_gc:=false', 'encoders:=absolute')
    rclpy.init(args=['--ros-args', *(part for one in given for part in ('-p', one))])
    with ExitStack() as stack:

        def make(bridge: type[FakeHardware]) -> FakeHardware:
            node = bridge()
            stack.callback(node.close)
            return node

        yield make
    rclpy.try_shutdown()
    sys.setswitchinterval(interval)


def test_no_periodic_work_wakes_the_executor(start) -> None:
    quiet = start(Quiet)
    quiet.run()
    assert quiet.before > 0  # the modes at the start were logged
    assert quiet.after == quiet.before


def test_an_exception_in_the_cycle_switches_the_motors_off(start) -> None:
    defective = start(Defective)
    with pytest.raises(ZeroDivisionError):
        defective.run()
    assert defective.was_enabled == [True, True]
    assert not any(board.system_enabled for board in defective.boards)
    with pytest.raises(RuntimeError, match='not active'):
        defective.requests.ask(lambda cycle: cycle.enable())


def ask_and_stop(bridge: FakeHardware, action: str, answers: list[Answer]) -> None:
    """Ask as soon as the service is seen, then stop the bridge."""
    asker = rclpy.create_node('asker')
    try:
        client = asker.create_client(Trigger, f'fake_hardware/{action}')
        assert spin_until(asker, client.service_is_ready, LIMIT)
        call = ServiceCall(client, LIMIT)
        assert spin_until(asker, call.poll, LIMIT)
        answers.append(call.poll())
    finally:
        asker.destroy_node()
        bridge.stop()


@pytest.mark.parametrize(
    ('action', 'settings', 'text'),
    [
        ('enable', {}, 'the motors align now'),
        ('e_stop', {'connect_frames': 1000, 'bad_frames_max': 1000}, 'the arm is damped'),
    ],
)
def test_requests_during_the_start_run_once_the_boards_are_known(
    start, action, settings, text
) -> None:
    node, answers = start(Unhurried), []
    vars(node.values).update(settings)
    asking = threading.Thread(target=ask_and_stop, args=(node, action, answers))
    asking.start()
    node.run()
    asking.join()
    assert answers[0].accepted, answers[0].message
    assert text in answers[0].message


def test_stopping_a_starting_bridge_rejects_waiting_requests(start) -> None:
    node = start(StoppedEarly)
    node.run()
    with pytest.raises(RuntimeError, match='not active'):
        node.requests.ask(lambda cycle: cycle.enable())
