"""The emulated drone over real topics: it flies, is held, falls, and rejects bad commands."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from controller_bench import LIMIT, ControllerBench, trajectory
from forked_executable import run
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from quick_spinning import answer_of, spin_once, spin_until
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from sensor_msgs.msg import Imu, JointState
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_ros.control.base.base_motion import rotation_matrix
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.ros.process.node_process import NodeProcess

DRONE = resource('config', 'drone.yaml')
DRONE_CONFIG = load_drone_config()
HOVER = (3.0 + 1.487) * 9.81 / 6  # [N] a rotor


class DroneBench(ControllerBench):
    """The emulated arm under its drone, and what that says."""

    def __init__(self, folder: Path, node: Node, **arm: object) -> None:
        super().__init__(folder, node, drone_file=DRONE, **arm)
        self.path: list[tuple[float, np.ndarray]] = []
        self.attitude = np.eye(3)
        self.pushes: list[np.ndarray] = []
        self.keep(topics.IMU)
        self.keep(topics.ROBOT_DESCRIPTION)
        self.listen(topics.ODOMETRY, self._on_odometry)
        self.listen(topics.CONTACT_WRENCH, self._on_contact)
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

    def feels(self, force: np.ndarray) -> bool:
        """Return whether the last twenty contact messages were that force, within a tenth."""
        if len(self.pushes) < 20:
            return False
        errors = np.linalg.norm(np.array(self.pushes[-20:]) - force, axis=-1)
        return bool(errors.max() < 0.1 * np.linalg.norm(force))

    def _on_contact(self, message: WrenchStamped) -> None:
        force = message.wrench.force
        in_body = DRONE_CONFIG.mount.rotation @ [force.x, force.y, force.z]
        self.pushes.append(self.attitude @ in_body)

    def _on_odometry(self, message: Odometry) -> None:
        stamp, p = message.header.stamp, message.pose.pose.position
        q = message.pose.pose.orientation
        self.attitude = rotation_matrix(np.array([q.x, q.y, q.z, q.w]))
        self.path.append((stamp.sec + 1e-9 * stamp.nanosec, np.array([p.x, p.y, p.z])))
        if self.answer is not None:
            command = self.answer(message)
            command.header.stamp = stamp
            self.rotors.publish(command)


@pytest.fixture
def bench(tmp_path: Path, ros_node: Node) -> Iterator[DroneBench]:
    air = {'gust_force': 0.05, 'gust_time': 0.3, 'odometry_delay': 0.05}
    bench = DroneBench(tmp_path, ros_node, contact_link='tool0', **air)
    with bench.hardware:
        yield bench


class ArmSwinger:
    """Lets the arm swing to and fro, and pulls at its tool; it is made while the world stands."""

    def __init__(self, bench: DroneBench) -> None:
        self._bench = bench
        self._swing = bench.publisher(topics.JOINT_TRAJECTORY)
        self._world = AsyncParameterClient(bench.node, 'fake_hardware')
        bench.wait(self._world.services_are_ready, 'its parameters')

    def swing(self) -> None:
        message = trajectory([0.6, 1.2, 0.5, -0.5], 1.0)
        for turn in range(1, 100):
            point = trajectory([0.6 * (turn % 2), 1.2 + 0.4 * (turn % 2), 0.0, 0.5], 1.0).points[0]
            point.time_from_start.sec = 1 + turn
            message.points.append(point)
        self._swing.publish(message)
        self._bench.wait(lambda: np.abs(self._bench.dq).max() > 0.1, 'the swing')

    def pull_is_found(self, force: list[float]) -> None:
        bench, wanted = self._bench, np.array(force)
        self._world.set_parameters([Parameter('contact_force', value=force)])
        bench.wait(lambda: bench.feels(wanted) and np.abs(bench.dq).max() > 0.1, f'{force} N')


def test_the_drone_hovers_with_its_controller_and_falls_without(bench: DroneBench) -> None:
    contact = {'drone_file': DRONE, 'contact_bandwidth': 2.0}
    with bench.controller('gravity_compensation'), bench.controller('base_reaction', **contact):
        with bench.flight_control() as flight:
            bench.wait(lambda: 'waiting for odometry' not in bench.problems[-3:], 'flight_control')
            arm = ArmSwinger(bench)
            bench.start()
            bench.wait(lambda: bench.mode == 'running', 'commands')
            bench.wait(lambda: np.abs(bench.place).max() > 1e-4, 'the wind')
            bench.wait_until(bench.time + 0.5)
            flown = np.array([place for _, place in bench.path])
            assert np.linalg.norm(flown, axis=1).max() < 0.2
            assert bench.mode == 'running', flight.tail()
            imu = bench.heard['imu']
            assert isinstance(imu, Imu)
            assert imu.header.frame_id == 'drone_imu'
            assert 'drone_mount' in bench.heard['robot_description'].data
            assert imu.linear_acceleration.z == pytest.approx(9.81, abs=2.0)
            arm.swing()
            for force in ([0.0, 5.0, 0.0], [2.0, 0.0, -10.0]):
                arm.pull_is_found(force)
        # No more rotor commands: nobody waits for ever, the rotors stop.
        bench.wait(lambda: bench.place[2] < -2.0, 'the fall')
    bench.call('disable')
    bench.wait(lambda: bench.mode == 'idle', 'idle')
    put_back = bench.node.create_client(Trigger, 'fake_hardware/put_back')
    assert put_back.wait_for_service(LIMIT)
    assert answer_of(bench.node, lambda: put_back.call_async(Trigger.Request()), LIMIT).success
    spin_until(bench.node, lambda: False, 0.2)  # what was under way
    bench.path.clear()
    assert spin_until(bench.node, lambda: len(bench.path) > 50, 10.0)
    assert all(abs(place[2]) < 0.01 for _, place in bench.path), 'the old pose is not published'


def test_commands_that_are_not_its_own_leave_it_where_it_is_held(bench: DroneBench) -> None:
    names, deadline = list(DRONE_CONFIG.rotor_names), time.monotonic() + LIMIT
    bench.start()
    for command, reason in (
        (JointState(name=[*'abcd'], effort=[HOVER] * 4), 'contains the rotors a, b, c, d'),
        (JointState(name=names, effort=[np.nan, *[HOVER] * 5]), 'a rotor thrust is NaN'),
        (JointState(name=names, position=[1.0] * 6), 'effort is empty'),
        (JointState(name=names, effort=[HOVER]), '6 names, but 0 positions'),
    ):
        while reason not in bench.log:  # which names one reason per second
            bench.rotors.publish(command)
            spin_once(bench.node, 0.05)
            assert time.monotonic() < deadline, reason
    np.testing.assert_allclose(bench.place, 0.0, atol=1e-6)
    bench.wait(lambda: any('rejected: rotor_command' in text for text in bench.problems), 'a word')


def test_a_weak_drone_and_two_kinds_of_base_are_refused(
    tmp_path: Path, ros_domain: dict[str, str]
) -> None:
    for parameters, reason in (
        ({'drone_file': tmp_path / 'none.yaml'}, 'No such file'),
        ({'drone_file': DRONE, 'base_motion_profile': 'moving'}, 'remove one of the two'),
        ({'drone_file': DRONE, 'imu_noise': [0.1]}, 'imu_noise has 1 numbers instead of 2'),
        ({'contact_force': [1.0, 0.0, 0.0]}, 'a flying drone: set drone_file'),
        ({'drone_file': DRONE, 'contact_link': 'nowhere'}, "unknown link 'nowhere'"),
    ):
        done = run('fake_hardware', parameters=parameters)
        assert done.returncode == 1
        assert reason in done.stderr + done.stdout
