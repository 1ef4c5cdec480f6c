"""The node as a process, with an autopilot over UDP, and the arm over topics."""

import select
import socket
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from forked_executable import run
from geometry_msgs.msg import PoseStamped, Transform
from quick_spinning import spin_once
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.autopilot.mavlink import FrameReader, FrameWriter, Message
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.ros.process.node_process import NodeProcess

DRONE = load_drone_config()
LIMIT = 60.0  # [s] of a busy host
IGNORE_YAW_RATE = 2048
SET_POINT = 'SET_POSITION_TARGET_LOCAL_NED'
ARDUPILOT, PX4 = 3, 12  # MAV_AUTOPILOT


class Autopilot:
    """An autopilot on the ground, as its MAVLink shows it; PX4 unless `firmware` is ArduPilot's."""

    def __init__(self) -> None:
        self.firmware = PX4
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(('127.0.0.1', 0))
        self.port = int(self._socket.getsockname()[1])
        self._writer, self._reader = FrameWriter(1, 1), FrameReader()
        self._peer: tuple[str, int] | None = None
        self._next = 0.0
        self.base_mode, self.custom_mode = 81, 3 << 24 | 4 << 16
        self.is_damaged = self.is_deaf = False
        self.result = 0
        self.heard: list[Message] = []

    def of(self, name: str) -> list[Message]:
        """Return the received messages of a name."""
        return [message for message in self.heard if message.name == name]

    def commands(self) -> list[int]:
        """Return the received commands, except those for streams."""
        return [m['command'] for m in self.of('COMMAND_LONG') if m['command'] != 511]

    def tick(self) -> None:
        """Receive messages, and send those that are due."""
        while select.select([self._socket], [], [], 0.0)[0]:
            data, self._peer = self._socket.recvfrom(4096)
            for message in self._reader.feed(data):
                self.heard.append(message)
                if message.name == 'COMMAND_LONG' and not self.is_deaf:
                    self._say('COMMAND_ACK', command=message['command'], result=self.result)
        now = time.monotonic()
        if now < self._next or self._peer is None:
            return
        self._next = now + 0.01
        self._say('HEARTBEAT', type=13, autopilot=self.firmware, base_mode=self.base_mode,
                  custom_mode=self.custom_mode)  # fmt: skip
        self._say('ATTITUDE_QUATERNION', q1=1.0)
        self._say('LOCAL_POSITION_NED', x=1.0, y=2.0, z=-3.0)
        self._say('HIGHRES_IMU', zacc=-9.8)
        if self.firmware == PX4:
            self._say('ACTUATOR_OUTPUT_STATUS', active=6, actuator=[1500.0] * 6 + [0.0] * 26)
        else:
            pulses = {f'servo{number}_raw': 1000 + 100 * number for number in range(1, 7)}
            self._say('SERVO_OUTPUT_RAW', **pulses)

    def _say(self, name: str, **values: object) -> None:
        assert self._peer is not None
        frame = bytearray(self._writer.pack(name, **values))
        if self.is_damaged:
            frame[-1] ^= 0xFF
        self._socket.sendto(bytes(frame), self._peer)

    def close(self) -> None:
        self._socket.close()


class Bench:
    """Node, autopilot, and what the node publishes."""

    def __init__(self, node: Node, autopilot: Autopilot) -> None:
        self.node, self.autopilot = node, autopilot
        self.received: dict[str, object] = {}
        self.status: dict[str, str] = {}
        self.text = ''
        for topic in (topics.ODOMETRY, topics.IMU, topics.ROTOR_COMMAND):
            keep = partial(self.received.__setitem__, topic.name)
            node.create_subscription(topic.type, topic.name, keep, topic.qos)
        topic = topics.DIAGNOSTICS
        node.create_subscription(topic.type, topic.name, self._on_diagnostics, topic.qos)
        topic = topics.FLIGHT_SET_POINT
        self.places = node.create_publisher(topic.type, topic.name, topic.qos)

    @property
    def points(self) -> list[Message]:
        """Set points that the autopilot received."""
        return self.autopilot.of(SET_POINT)

    def until(self, is_done: Callable[[], object], limit: float = LIMIT) -> bool:
        """Spin, and run the autopilot, until a condition holds."""
        deadline = time.monotonic() + limit
        while time.monotonic() < deadline:
            spin_once(self.node, 0.002)
            self.autopilot.tick()
            if is_done():
                return True
        return False

    def pass_time(self, seconds: float) -> None:
        self.until(lambda: False, seconds)

    def lead_until(self, is_done: Callable[[], object]) -> None:
        """Send a set point every 0.1 s until a condition holds."""
        message, deadline = PoseStamped(), time.monotonic() + LIMIT
        message.pose.position.x, message.pose.orientation.w = 0.5, 1.0
        while not is_done():
            assert time.monotonic() < deadline
            self.places.publish(message)
            self.pass_time(0.1)

    def ask(self, name: str) -> Future:
        """Call a service of the node; return its future answer."""
        client = self.node.create_client(Trigger, f'mavlink_feedforward/{name}')
        assert self.until(client.service_is_ready)
        return client.call_async(Trigger.Request())

    def call(self, name: str) -> tuple[bool, str]:
        """Call a service of the node; return success and message."""
        future = self.ask(name)
        assert self.until(future.done)
        return future.result().success, future.result().message

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.text = status.message
            self.status = {value.key: value.value for value in status.values}


@pytest.fixture
def bench(request: pytest.FixtureRequest, ros_node: Node, tmp_path: Path) -> Iterator[Bench]:
    """Return the bench; `firmware` as an indirect parameter is the node's parameter."""
    autopilot = Autopilot()
    parameters = {
        'drone_file': 'config/drone.yaml',
        'connection': f'udp:127.0.0.1:{autopilot.port}',
        'set_point_timeout': 0.5,
        'firmware': getattr(request, 'param', 'px4'),
    }
    with NodeProcess('mavlink_feedforward', parameters=parameters, log=tmp_path / 'log'):
        yield Bench(ros_node, autopilot)
    autopilot.close()


def test_publishes_sensors_set_points_and_a_trajectory_until_the_link_is_lost(bench: Bench) -> None:
    assert bench.until(lambda: len(bench.received) == 3)
    odometry, imu, rotors = (bench.received[name] for name in ('odometry', 'imu', 'rotor_command'))
    place = odometry.pose.pose.position
    np.testing.assert_allclose([place.x, place.y, place.z], [2.0, 1.0, 3.0])
    assert imu.linear_acceleration.z == pytest.approx(9.8, rel=1e-6)
    assert list(rotors.name) == list(DRONE.rotor_names)
    np.testing.assert_allclose(rotors.effort, 0.5 * DRONE.column('thrust_max'))
    # Set points: forwarded while they come, and not after that.
    assert bench.points == []
    bench.lead_until(lambda: len(bench.points) >= 20)
    last = bench.points[-1]
    assert (last['x'], last['y'], last['z']) == pytest.approx((0.0, 0.5, 0.0))
    assert last['type_mask'] == IGNORE_YAW_RATE  # an acceleration is always with it
    count = -1
    while count < len(bench.points):  # until none arrives for 0.4 s
        count = len(bench.points)
        bench.pass_time(0.4)
    # A trajectory ends in a hover.
    topic = topics.FLIGHT_TRAJECTORY
    paths = bench.node.create_publisher(topic.type, topic.name, topic.qos)
    assert bench.until(paths.get_subscription_count)
    point = MultiDOFJointTrajectoryPoint(transforms=[Transform()])
    place = point.transforms[0].translation
    place.x, place.y, place.z = 2.5, 1.0, 3.0
    point.transforms[0].rotation.w = 1.0
    point.time_from_start.nanosec = 500_000_000
    paths.publish(MultiDOFJointTrajectory(joint_names=['drone'], points=[point]))
    bench.pass_time(1.2)  # beyond its end and set_point_timeout
    count = len(bench.points)
    assert bench.until(lambda: len(bench.points) > count)
    last = bench.points[-1]
    assert last['y'] == pytest.approx(2.5)  # north-east-down
    assert (last['vx'], last['vy'], last['vz']) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    # A lost link ends the trajectory.
    bench.autopilot.is_damaged = True
    assert bench.until(lambda: 'no heartbeat' in bench.text)
    assert int(bench.status['damaged frames']) > 0
    success, text = bench.call('arm')
    assert (success, bench.autopilot.commands()) == (False, [])
    assert 'check the connection' in text
    bench.autopilot.is_damaged = False
    assert bench.until(lambda: bench.text.startswith('no set points'))


def test_arms_and_changes_the_mode_only_by_its_services_while_set_points_continue(
    bench: Bench,
) -> None:
    assert bench.until(lambda: bench.status.get('mode') == 'auto hold')
    assert bench.call('offboard') == (True, 'accepted')
    bench.autopilot.result = 1
    assert bench.call('arm') == (False, 'temporarily rejected')
    assert set(bench.autopilot.commands()) == {176, 400}
    bench.autopilot.base_mode, bench.autopilot.custom_mode = 209, 6 << 16
    assert bench.until(lambda: bench.status.get('mode') == 'offboard')
    assert bench.until(lambda: bench.status.get('armed') == 'True')
    # Set points continue while a request waits.
    bench.autopilot.is_deaf = True
    future, times, counts = bench.ask('arm'), [], [len(bench.points)]

    def is_answered() -> bool:
        counts.append(len(bench.points))
        if counts[-1] > counts[-2]:
            times.append(time.monotonic())
        return future.done()

    bench.lead_until(is_answered)
    assert future.result().message.startswith('the autopilot did not answer within 2 s')
    assert times[-1] - times[0] > 1.2, 'beyond set_point_timeout'


@pytest.mark.parametrize('bench', ['ardupilot'], indirect=True)
def test_ardupilot_gets_moving_set_points_and_reports_its_motors(bench: Bench) -> None:
    autopilot, other = bench.autopilot, 'the autopilot reports the firmware px4'
    # As long as the autopilot is another one than the parameter says, it gets no set points.
    assert bench.until(lambda: bench.text.startswith(other))
    begun = time.monotonic()
    bench.lead_until(lambda: time.monotonic() > begun + 0.3)
    assert bench.points == []
    success, text = bench.call('arm')
    assert (success, autopilot.commands()) == (False, [])
    assert text.startswith(other)
    autopilot.firmware, autopilot.custom_mode = ARDUPILOT, 5
    assert bench.until(lambda: bench.status.get('mode') == 'loiter')
    assert bench.until(lambda: 'rotor_command' in bench.received)
    # Rotors in the order of the drone file; ArduPilot's motors are numbered from the right.
    shares = bench.received['rotor_command'].effort / DRONE.column('thrust_max')
    share = dict(zip(DRONE.rotor_names, shares, strict=True))
    assert (share['right'], share['rear_left']) == pytest.approx((0.1, 0.6))
    bench.lead_until(lambda: bench.points)
    point = bench.points[-1]
    assert (point['x'], point['y'], point['z']) == pytest.approx((0.0, 0.5, 0.0), abs=1e-6)
    assert point['type_mask'] == IGNORE_YAW_RATE  # position, velocity and acceleration
    assert bench.call('offboard')[0]
    request = autopilot.of('COMMAND_LONG')[-1]
    assert (request['command'], request['param2']) == (176, 4.0)  # guided


NO_LINE = {'drone_file': 'config/drone.yaml', 'connection': 'serial:/dev/no_such:57600'}


@pytest.mark.parametrize(
    ('parameters', 'reason'), [(NO_LINE, 'No such file'), ({}, 'drone_file is empty')]
)
def test_a_wrong_parameter_ends_it_with_one_line(
    ros_domain: dict[str, str], parameters: dict[str, str], reason: str
) -> None:
    done = run('mavlink_feedforward', parameters=parameters)
    assert done.returncode == 1
    assert reason in done.stderr
    assert len(done.stderr.splitlines()) == 1
