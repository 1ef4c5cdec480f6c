"""The emulated drone over real topics: it flies, is held, falls, and refuses what is wrong."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from controller_bench import ControllerBench
from forked_executable import run
from nav_msgs.msg import Odometry
from quick_spinning import spin_once
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState

from aerarm_msgs_py import topics
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.ros.process.node_process import NodeProcess

DRONE = resource('config', 'drone.yaml')
HOVER = (3.0 + 1.487) * 9.81 / 6  # [N] a rotor


class DroneBench(ControllerBench):
    """The emulated arm under its drone, and what that says."""

    def __init__(self, folder: Path, node: Node, **arm: object) -> None:
        super().__init__(folder, node, drone_file=DRONE, **arm)
        self.path: list[tuple[float, np.ndarray]] = []
        self.keep(topics.IMU)
        self.keep(topics.ROBOT_DESCRIPTION)
        self.listen(topics.ODOMETRY, self._on_odometry)
        self.answer: Callable[[Odometry], JointState] | None = None
        topic = topics.ROTOR_COMMAND
        self.rotors = node.create_publisher(topic.type, topic.name, topic.qos)

    @property
    def time(self) -> float:
        return self.path[-1][0] if self.path else 0.0

    @property
    def place(self) -> np.ndarray:
        return self.path[-1][1]

    @property
    def log(self) -> str:
        return self.hardware.log.read_text()

    def wait_until(self, time: float) -> None:
        self.wait(lambda: self.time > time, f'{time} s')

    def flight_control(self, **parameters: object) -> NodeProcess:
        return self.controller('flight_control', drone_file=DRONE, **parameters)

    def _on_odometry(self, message: Odometry) -> None:
        stamp, p = message.header.stamp, message.pose.pose.position
        self.path.append((stamp.sec + 1e-9 * stamp.nanosec, np.array([p.x, p.y, p.z])))
        if self.answer is not None:
            command = self.answer(message)
            command.header.stamp = stamp
            self.rotors.publish(command)


@pytest.fixture
def bench(tmp_path: Path, ros_node: Node) -> Iterator[DroneBench]:
    bench = DroneBench(tmp_path, ros_node, gust_force=0.5, gust_time=0.3)
    with bench.hardware:
        yield bench


def test_it_hovers_under_its_controller_and_falls_without(bench: DroneBench) -> None:
    with bench.controller('gravity_compensation'):
        with bench.flight_control() as flight:
            bench.wait(lambda: 'waiting for odometry' not in bench.problems[-3:], 'flight_control')
            bench.start()
            bench.wait(lambda: bench.mode == 'running', 'commands')
            begun = bench.time
            bench.wait_until(begun + 4.0)
            flown = np.array([place for time, place in bench.path if time > begun])
            assert 1e-3 < np.linalg.norm(flown, axis=1).max() < 0.2  # the wind moves it
            assert bench.mode == 'running', flight.tail()
            imu = bench.heard['imu']
            assert isinstance(imu, Imu)
            assert imu.header.frame_id == 'drone_imu'
            assert 'drone_mount' in bench.heard['robot_description'].data
            assert imu.linear_acceleration.z == pytest.approx(9.81, abs=2.0)
        # No more rotor commands: nobody waits for ever, the rotors stop.
        bench.wait(lambda: bench.place[2] < -2.0, 'the fall')
    bench.call('disable')
    bench.wait(lambda: bench.mode == 'idle', 'idle')
    bench.call('put_back')
    bench.wait(lambda: abs(bench.place[2]) < 0.01, 'the way back')


def test_commands_that_are_not_its_own_leave_it_where_it_is_held(bench: DroneBench) -> None:
    names = list(load_drone_config().rotor_names)
    bench.start()
    for command, reason in (
        (JointState(name=['a', 'b', 'c', 'd'], effort=[HOVER] * 4), 'it is for rotors a, b, c, d'),
        (JointState(name=names, effort=[np.nan, *[HOVER] * 5]), 'a thrust is NaN'),
        (JointState(name=names, position=[1.0] * 6), 'it has no effort'),
        (JointState(name=names, effort=[HOVER]), '6 names with 0 positions'),
    ):
        for _ in range(3):
            bench.rotors.publish(command)
            spin_once(bench.node, 0.05)
        bench.wait(
            lambda reason=reason: reason in bench.log,
            reason,
            lambda command=command: bench.rotors.publish(command),
        )
    np.testing.assert_allclose(bench.place, 0.0, atol=1e-6)
    bench.wait(lambda: any('rejected: rotor_command' in text for text in bench.problems), 'a word')


def test_a_weak_drone_and_two_kinds_of_base_are_refused(
    tmp_path: Path, ros_domain: dict[str, str]
) -> None:
    for parameters, reason in (
        ({'drone_file': tmp_path / 'none.yaml'}, 'No such file'),
        ({'drone_file': DRONE, 'base_motion_profile': 'moving'}, 'leave one of the two out'),
        ({'drone_file': DRONE, 'imu_noise': [0.1]}, 'imu_noise has 1 numbers, not 2'),
    ):
        done = run('fake_hardware', parameters=parameters)
        assert done.returncode == 1
        assert reason in done.stderr + done.stdout
