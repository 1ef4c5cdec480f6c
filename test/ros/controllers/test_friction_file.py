"""A controller compensates the friction of `friction_file`, which the URDF cannot contain."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from controller_bench import NAMES, ControllerBench, trajectory
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
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
    reader = RawReader(
        bench.node, topics.JOINT_STATES.queued(20_000), topics.DISTURBANCE.queued(20_000)
    )
    codec = JointStateCdr(NAMES)
    velocities: dict[int, np.ndarray] = {}
    efforts: dict[int, np.ndarray] = {}

    def take() -> None:
        """Take the messages of half a second; more come meanwhile."""
        for index, values in enumerate((velocities, efforts)):
            for _ in range(500):
                message = reader.take(index)
                if message is None:
                    break
                sample = codec.unpack(message[0])
                assert sample is not None
                values[sample.stamp_ns] = sample.effort if index else sample.velocity

    def have_all_come() -> bool:
        take()
        return max(velocities) >= max(efforts)

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
            bench.wait(lambda: bench.mode == 'running', 'commands')

            def is_there() -> bool:
                take()  # the middleware keeps 5000 states
                return bool(np.abs(bench.q - goal).max() < 0.05 and np.abs(bench.dq).max() < 0.05)

            bench.wait(is_there, f'{goal}', lambda: goals.publish(motion))
            assert process.stop() == 0, process.tail()
        # All states have arrived, up to the newest disturbance.
        bench.wait(have_all_come, 'the last state')
        bench.wait(lambda: bench.mode == 'ready', 'the end of commands')

    move(GOAL)
    move(HERE, friction_file=estimate(tmp_path))
    without, with_file = unexplained(1.0), unexplained(-1.0)
    assert np.all(with_file < 0.4 * without), (without, with_file)
