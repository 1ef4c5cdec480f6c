"""A controller compensates the friction of `friction_file`, which the URDF cannot contain."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml
from controller_bench import NAMES, ControllerBench, trajectory
from rclpy.node import Node
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_ros.description.robot import load_robot

STRIBECK, VELOCITY = 1.0, 0.2  # of the dry friction, and [rad/s]
HERE, GOAL = [0.0, 0.5 * np.pi, 0.0, 0.0], [0.15, 1.435, 0.15, -0.15]


@pytest.fixture
def bench(tmp_path: Path, ros_node: Node) -> Iterator[ControllerBench]:
    bench = ControllerBench(tmp_path, ros_node, stribeck=STRIBECK, stribeck_velocity=VELOCITY)
    with bench.hardware:
        bench.start()
        yield bench


def estimate(folder: Path) -> Path:
    """Write the emulated arm's friction as the identifier does."""
    robot = load_robot()
    friction = {
        'viscous': robot.viscous,
        'coulomb': robot.coulomb,
        'stribeck': STRIBECK * robot.coulomb,
        'stribeck_width': np.full(4, VELOCITY),
    }
    parameters = {
        'joint_names': list(robot.joint_names),
        'inertial_parameters': robot.inertial_parameters.ravel().tolist(),
        'friction': {name: values.tolist() for name, values in friction.items()},
    }
    file = folder / 'estimate.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters}}))
    return file


def test_the_disturbance_of_a_slow_motion_contains_no_stribeck_friction(
    bench: ControllerBench, tmp_path: Path
) -> None:
    efforts: dict[int, list[float]] = {}
    velocities: dict[int, list[float]] = {}

    def keep(message: JointState, values: dict[int, list[float]], row: Sequence[float]) -> None:
        assert list(message.name) == NAMES
        stamp = message.header.stamp
        values[10**9 * stamp.sec + stamp.nanosec] = list(row)

    def unexplained(direction: float) -> np.ndarray:
        """Return the mean disturbance while all joints move and joint1 moves in a direction."""
        # A busy machine reads both topics late, so the stamps tell what belongs together.
        times = sorted(velocities)
        columns = np.array([velocities[time] for time in times]).T
        dq = np.array([np.interp(list(efforts), times, column) for column in columns]).T
        moves = (np.abs(dq).min(axis=1) > 0.02) & (direction * dq[:, 0] > 0.0)
        rows = np.array(list(efforts.values()))[moves]
        assert len(rows) > 20
        return np.abs(rows.mean(axis=0))

    def move(goal: list[float], **given: object) -> None:
        with bench.controller('computed_torque', compensation=0.0, **given) as process:
            goals, motion = bench.publisher(topics.JOINT_TRAJECTORY), trajectory(goal, 2.0)
            bench.wait_for_posture(goal, 0.05, lambda: goals.publish(motion))
            assert process.stop() == 0, process.tail()
        # All states have arrived, up to the newest disturbance.
        bench.wait(lambda: max(velocities) >= max(efforts), 'the last state')

    bench.listen(topics.DISTURBANCE.queued(1000), lambda m: keep(m, efforts, m.effort))
    bench.listen(topics.JOINT_STATES.queued(20_000), lambda m: keep(m, velocities, m.velocity))
    move(GOAL)
    move(HERE, friction_file=estimate(tmp_path))
    without, with_file = unexplained(1.0), unexplained(-1.0)
    assert np.all(with_file < 0.4 * without), (without, with_file)
