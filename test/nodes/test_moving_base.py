"""The emulated drone swings under the arm: only with the IMU a controller holds the arm."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from controller_bench import ControllerBench
from rclpy.node import Node
from sensor_msgs.msg import Imu

from aerarm_msgs_py import topics

LEANING = [0.0, 0.9, 0.0, 0.0]


@pytest.fixture
def bench(tmp_path: Path, ros_node: Node) -> Iterator[ControllerBench]:
    bench = ControllerBench(
        tmp_path, ros_node, base_motion_profile='moving', initial_position=LEANING
    )
    with bench.hardware:
        bench.start()
        yield bench


class SwingingArm:
    """The IMU's samples of the base, and the joints' motion meanwhile."""

    def __init__(self, bench: ControllerBench) -> None:
        self.bench = bench
        self.reset()
        bench.listen(topics.IMU, self._on_imu)
        bench.listen(topics.JOINT_STATES, self._on_state)

    def reset(self) -> None:
        self.angles: list[float] = []
        self.postures: list[np.ndarray] = []

    def _on_imu(self, message: Imu) -> None:
        q = message.orientation
        self.angles.append(2.0 * np.arctan2(q.x, q.w))

    def _on_state(self, _: object) -> None:
        self.postures.append(self.bench.q)

    @property
    def span(self) -> float:
        """Largest range of a joint's motion [rad]."""
        return float(np.ptp(self.postures, axis=0).max())

    def wait_for_both_sides(self) -> None:
        """Wait until the base has tilted by more than 25 degrees to both sides."""
        self.reset()
        self.bench.wait(
            lambda: self.angles and min(self.angles) < -0.43 and max(self.angles) > 0.43,
            'the swing',
        )


def test_the_arm_is_held_on_a_swinging_base(bench: ControllerBench) -> None:
    swing = SwingingArm(bench)
    for base_motion in ('full', 'none'):
        # The observer would compensate two thirds of what the IMU is not asked for.
        law = {'base_motion': base_motion, 'compensation': 0.0}
        with bench.controller('computed_torque', **law) as process:
            bench.wait(lambda: bench.mode == 'running', 'commands')
            swing.wait_for_both_sides()
            swing.wait_for_both_sides()
            if base_motion == 'full':
                assert swing.span < 0.01
                assert bench.mode == 'running', process.tail()
            else:
                assert swing.span > 0.03
        bench.wait(lambda: bench.mode == 'ready', 'the end of commands')
