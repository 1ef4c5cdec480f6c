"""flight_control over topics: answers to odometry, and names of faulty sensors."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from forked_executable import run
from geometry_msgs.msg import InertiaStamped, PoseStamped, Transform, WrenchStamped
from nav_msgs.msg import Odometry
from quick_spinning import spin_once, spin_until
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.ros.process.node_process import NodeProcess

DRONE = load_drone_config()
WEIGHT = (3.0 + 1.487) * 9.81
STEP_NS = 4_000_000
PATIENCE = 60.0  # [s] of the host: diagnostics and the log are in its time


class DroneSensors:
    """Sensors of a hovering drone in steps of 4 ms, and received commands."""

    def __init__(self, node: Node, process: NodeProcess) -> None:
        self.node, self.process = node, process
        self.now_ns = 1_000_000_000
        self.commands: list[JointState] = []
        self.problems: list[str] = []
        self.odometry, self.imu = (
            node.create_publisher(topic.type, topic.name, topic.qos)
            for topic in (topics.ODOMETRY, topics.IMU)
        )
        self.set_point = node.create_publisher(PoseStamped, 'flight_set_point', 1)
        for topic, act in (
            (topics.ROTOR_COMMAND, self.commands.append),
            (topics.DIAGNOSTICS, self._on_diagnostics),
        ):
            node.create_subscription(topic.type, topic.name, act, topic.qos)
        spin_until(node, lambda: self.odometry.get_subscription_count() > 0, 60.0)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.problems.append(message.status[0].message)

    def odometry_message(self, *position: float) -> Odometry:
        message = Odometry()
        message.header.frame_id = 'odom'
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.now_ns, 10**9)
        place, pose = position or (0.0, 0.0, 0.0), message.pose.pose
        pose.position.x, pose.position.y, pose.position.z = place
        pose.orientation.w = 1.0
        return message

    def imu_message(self, rate: float = 0.0) -> Imu:
        message = Imu(header=self.odometry_message().header)
        message.orientation.w = 1.0
        message.linear_acceleration.z = 9.81 + 1e-6 * (self.now_ns % 1000003)
        message.angular_velocity.z = rate
        return message

    def step(self, odometry: Odometry | None = None, imu: Imu | None = None) -> None:
        """Publish the given samples 4 ms later, and receive commands."""
        for message, publisher in ((imu, self.imu), (odometry, self.odometry)):
            if message is not None:
                publisher.publish(message)
        spin_once(self.node, 0.005)
        time.sleep(2e-3)  # most waits are for the node's log and diagnostics, in the host's time
        self.now_ns += STEP_NS

    def hover(self, steps: int = 10) -> None:
        for _ in range(steps):
            self.step(self.odometry_message(), self.imu_message())

    def hover_until(self, problem: str) -> None:
        """Hover until the last diagnostics fulfil a condition."""
        self.problems.clear()
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            if self.problems and self.problems[-1].startswith(problem):
                return
            self.hover(1)
        raise AssertionError((problem, self.problems[-3:]))

    def hover_until_thrust(self, share: float) -> None:
        """Hover until the sum of thrusts exceeds a share of the weight."""
        for _ in range(1000):
            self.hover(1)
            if self.thrust() > share * WEIGHT:
                return
        raise AssertionError('it does not rise')

    def thrust(self) -> float:
        """Return the newest command's sum of thrusts [N]."""
        return float(np.sum(self.commands[-1].effort))

    @property
    def log(self) -> str:
        return self.process.log.read_text()

    def refuse(self, reason: str, make, steps: int = 400) -> None:
        """Send samples of `make`, some steps at a time, until the log names a reason.

        Rejections are logged at most once in some seconds of the host's time.
        """
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            for _ in range(steps):
                self.step(*make())
                if reason in self.log:
                    return
            self.hover(50)
        raise AssertionError(f'{reason!r} is not in {self.log}')


@pytest.fixture
def arm_wait() -> float:
    return 0.0


@pytest.fixture
def drone(
    ros_domain: dict[str, str], ros_node: Node, tmp_path: Path, arm_wait: float
) -> Iterator[DroneSensors]:
    parameters = {'drone_file': resource('config', 'drone.yaml'), 'arm_wait': arm_wait}
    log = tmp_path / 'flight_control.log'
    with NodeProcess('flight_control', (), parameters, log=log) as process:
        yield DroneSensors(ros_node, process)


def test_hovers_and_follows_valid_set_points_and_trajectories(drone: DroneSensors) -> None:
    drone.hover_until('in order')
    command = drone.commands[-1]
    assert list(command.name) == list(DRONE.rotor_names)
    assert not command.position
    assert not command.velocity
    assert drone.thrust() == pytest.approx(WEIGHT, rel=0.01)
    stamp_ns = command.header.stamp.sec * 10**9 + command.header.stamp.nanosec
    assert stamp_ns % STEP_NS == 0
    assert stamp_ns < drone.now_ns
    higher = PoseStamped()
    higher.pose.position.z, higher.pose.orientation.w = 0.5, 1.0
    higher.header.frame_id = 'map'
    drone.set_point.publish(higher)
    drone.refuse(
        "flight_set_point rejected, because its frame is 'map'",
        lambda: (drone.odometry_message(), drone.imu_message()),
    )
    assert drone.thrust() == pytest.approx(WEIGHT, rel=0.01)
    higher.header.frame_id = 'odom'
    drone.set_point.publish(higher)
    drone.hover_until_thrust(1.05)
    topic = topics.FLIGHT_TRAJECTORY
    ways = drone.node.create_publisher(topic.type, topic.name, topic.qos)
    assert spin_until(drone.node, ways.get_subscription_count, PATIENCE)
    point = MultiDOFJointTrajectoryPoint(transforms=[Transform()])
    point.transforms[0].rotation.w, point.time_from_start.sec = 1.0, 2
    point.transforms[0].translation.z = np.nan
    way = MultiDOFJointTrajectory(points=[point])

    def invalid() -> tuple[Odometry, Imu]:
        ways.publish(way)  # each time: the log omits rejections that soon follow another one
        return drone.odometry_message(), drone.imu_message()

    drone.refuse('flight path', invalid)
    point.transforms[0].translation.z = 5.0
    ways.publish(way)
    drone.hover_until_thrust(1.2)


def test_messages_of_base_reaction_are_fed_forward(drone: DroneSensors) -> None:
    drone.hover_until('in order')
    topic = topics.MOTION_WRENCH
    wrenches = drone.node.create_publisher(topic.type, topic.name, topic.qos)
    topic = topics.ARM_INERTIA
    inertias = drone.node.create_publisher(topic.type, topic.name, topic.qos)
    matched = (wrenches, inertias)
    assert spin_until(
        drone.node, lambda: all(p.get_subscription_count() for p in matched), PATIENCE
    )
    stamp = drone.odometry_message().header
    inertia = InertiaStamped(header=stamp)
    inertia.inertia.m = np.nan

    def no_mass() -> tuple[Odometry, Imu]:
        inertias.publish(inertia)  # each time: of the newest alone one may be lost
        return drone.odometry_message(), drone.imu_message()

    drone.refuse('arm_inertia', no_mass)
    # The arm is 0.5 kg heavier than it was, and thrown upward besides: its base hangs upside down.
    for told in range(2000):
        inertia.header = drone.odometry_message().header
        inertia.inertia.m, inertia.inertia.com.z = 1.987, 0.2
        inertia.inertia.ixx = inertia.inertia.iyy = inertia.inertia.izz = 0.1
        inertias.publish(inertia)
        if told > 100:
            wrench = WrenchStamped(header=inertia.header)
            wrench.wrench.force.z = -5.0
            wrenches.publish(wrench)
        drone.hover(1)
        if told > 100 and drone.thrust() == pytest.approx(WEIGHT + 0.5 * 9.81 - 5.0, rel=0.01):
            break
    else:
        raise AssertionError(f'{drone.thrust()} N')


@pytest.mark.parametrize('arm_wait', [0.0, 10.0])
def test_waits_for_the_forecast_of_the_arm_if_arm_wait_is_set(
    drone: DroneSensors, arm_wait: float
) -> None:
    drone.hover_until('in order')  # nothing is told: nothing to wait for
    topic = topics.MOTION_WRENCH
    wrenches = drone.node.create_publisher(topic.type, topic.name, topic.qos)
    assert spin_until(drone.node, wrenches.get_subscription_count, PATIENCE)
    told_ns = drone.now_ns + 300_000_000

    def answered_ns() -> int:
        stamp = drone.commands[-1].header.stamp
        return stamp.sec * 10**9 + stamp.nanosec

    def tell(steps: int) -> None:
        told = WrenchStamped()
        told.header.stamp.sec, told.header.stamp.nanosec = divmod(told_ns, 10**9)
        for _ in range(steps):
            wrenches.publish(told)  # each time: of the newest alone one may be lost
            drone.hover(1)

    # Before it can have given up, if it waits.
    end = time.monotonic() + (arm_wait or PATIENCE)
    while drone.now_ns < told_ns + 20 * STEP_NS:
        tell(1)

    def tell_until_answered(stamp_ns: int) -> None:
        while answered_ns() < stamp_ns:
            assert time.monotonic() < end
            tell(1)

    if arm_wait:
        assert answered_ns() < told_ns
    else:
        tell_until_answered(told_ns)
    told_ns = drone.now_ns + 10**9
    tell_until_answered(answered_ns() + 1)


@pytest.mark.parametrize('arm_wait', [1.0])
def test_a_silent_base_reaction_is_awaited_once(drone: DroneSensors) -> None:
    drone.hover_until('in order')
    topic = topics.MOTION_WRENCH
    wrenches = drone.node.create_publisher(topic.type, topic.name, topic.qos)
    assert spin_until(drone.node, wrenches.get_subscription_count, PATIENCE)
    told = WrenchStamped(header=drone.odometry_message().header)
    for _ in range(50):
        wrenches.publish(told)  # each time: of the newest alone one may be lost
        drone.hover(1)
    answers = len(drone.commands)
    deadline = time.monotonic() + PATIENCE
    while len(drone.commands) < answers + 100:  # to wait each time would take longer
        assert time.monotonic() < deadline
        drone.hover(1)
    drone.hover_until('forecasts of the arm motion are late or missing')


def test_implausible_inputs_are_named_and_the_drone_stays_level(drone: DroneSensors) -> None:
    drone.hover_until('in order')
    # Silent odometry: level by the IMU, sinking.
    deadline = time.monotonic() + PATIENCE
    while not any('level by the IMU' in text for text in drone.problems):
        drone.step(None, drone.imu_message())
        assert time.monotonic() < deadline, drone.problems
    assert drone.thrust() == pytest.approx(0.97 * WEIGHT, rel=0.02)
    drone.hover(50)
    # A silent IMU is named; the odometry's rate serves.
    drone.problems.clear()
    deadline = time.monotonic() + PATIENCE
    while 'imu silent' not in drone.problems:
        drone.step(drone.odometry_message())
        assert time.monotonic() < deadline, drone.problems
    assert drone.thrust() == pytest.approx(WEIGHT, rel=0.05)
    drone.refuse(
        'odometry: a value is NaN', lambda: (drone.odometry_message(np.nan, 0.0, 0.0), None)
    )
    # Both silent: no command any more.
    assert spin_until(
        drone.node, lambda: any('the rotors stop' in text for text in drone.problems), 60.0
    )
    # What was under way when it was told still comes; then nothing does.
    deadline, count = time.monotonic() + PATIENCE, -1
    while count < len(drone.commands):
        count = len(drone.commands)
        assert time.monotonic() < deadline
        for _ in range(20):
            spin_once(drone.node, 0.02)


def test_does_not_start_without_a_drone_file(ros_domain: dict[str, str]) -> None:
    done = run('flight_control', parameters={})
    assert done.returncode == 1
    assert 'drone_file is empty' in done.stderr + done.stdout
