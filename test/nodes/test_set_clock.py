"""The system clock is set while an arm in real time moves."""

import time
from pathlib import Path

import numpy as np
import pytest
import spi_boards
from controller_bench import ControllerBench, trajectory
from quick_spinning import spin_once
from rclpy.node import Node
from sensor_msgs.msg import JointState
from set_clock import SetClock
from test_killed_processes import UNHURRIED

from aerarm_msgs_py import topics

POSTURES = ([0.6, 1.5, -0.5, 0.6], [-0.4, 1.1, 0.3, -0.2])
SECONDS = 1.5  # of a motion
# Share of the way, and how far the system clock is ahead from there on [s].
STEPS = ((0.2, 2.0), (0.5, 0.0), (0.8, -2.0))
# A busy host may hold up a controller for the 0.1 s after which it starts from the arm's posture,
# as it does after a jump of the stamps. Then the next motion is sent, with the same steps.
ATTEMPTS = 6


class ClockBench(ControllerBench):
    """Keeps stamps, postures and modes of the arm."""

    def __init__(self, folder: Path, node: Node) -> None:
        self.stamps: list[float] = []
        self.postures: list[list[float]] = []
        super().__init__(folder, node, pace='real_time', **UNHURRIED)
        self.modes: set[str] = set()
        self.listen(topics.ARM_MODE, lambda m: self.modes.add(m.data))

    def move(self, goal: list[float], clock: SetClock) -> bool:
        """Set the clock during a motion; return whether the arm reaches the goal."""
        start, steps = np.array(self.q), list(STEPS)
        self.publisher(topics.JOINT_TRAJECTORY).publish(trajectory(goal, SECONDS))
        end = time.monotonic() + 2.0 * SECONDS
        while time.monotonic() < end:
            spin_once(self.node, 0.05)
            way = np.abs(self.q - start).max() / np.ptp([start, goal], axis=0).max()
            if steps and way > steps[0][0]:
                clock.set(steps.pop(0)[1])
            if np.abs(self.q - goal).max() < 0.02 and np.abs(self.dq).max() < 0.02:
                return not steps
        return False

    def _on_state(self, message: JointState) -> None:
        super()._on_state(message)
        self.stamps.append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
        self.postures.append(list(message.position))


@pytest.mark.skipif(spi_boards.compiler() is None, reason='no C compiler to build clock_shim.c')
def test_a_moving_arm_continues_while_the_system_clock_is_set(
    tmp_path: Path, ros_node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SetClock(tmp_path)
    for name, value in clock.environment.items():
        monkeypatch.setenv(name, value)
    bench = ClockBench(tmp_path, ros_node)
    with bench.hardware:
        bench.start()
        with bench.controller('computed_torque'):
            bench.wait(lambda: bench.mode == 'running', 'commands')
            begun, first = time.monotonic(), len(bench.stamps)
            goals = [POSTURES[attempt % 2] for attempt in range(ATTEMPTS)]
            assert any(bench.move(goal, clock) for goal in goals), bench.q
            passed = time.monotonic() - begun
        stamps = np.array(bench.stamps[first - 1 :])
        assert stamps[-1] - stamps[0] == pytest.approx(passed, abs=1.0)
        assert np.diff(stamps).min() > 0.0
        # By these stamps no joint is faster than a motion of 1 rad is in its middle.
        moved = np.abs(np.diff(bench.postures[first - 1 :], axis=0)).max(axis=1)
        assert np.all(moved < 1.5 * 1.875 / SECONDS * np.diff(stamps) + 2e-3)
        assert 'fault' not in bench.modes
        told = 'the stamps of joint_states are 2000 ms ahead of the system clock'
        bench.wait(lambda: any(told in problem for problem in bench.problems), told)
        bench.call('disable')
        bench.wait(lambda: bench.stamps[-1] < time.time() - 1.0, 'stamps of the system clock')
