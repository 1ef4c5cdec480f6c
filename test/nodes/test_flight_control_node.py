"""flight_control over topics: answers to odometry, and names of faulty sensors."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import InertiaStamped, PoseStamped, Transform, WrenchStamped
from nav_msgs.msg import Odometry
from quick_spinning import spin_once, spin_until
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Header
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
        for topic, act in (
            (topics.ROTOR_COMMAND, self.commands.append),
            (topics.DIAGNOSTICS, lambda m: self.problems.append(m.status[0].message)),
        ):
            node.create_subscription(topic.type, topic.name, act, topic.qos)
        self.odometry, self.imu = self.publisher(topics.ODOMETRY), self.publisher(topics.IMU)

    def publisher(self, topic: topics.Topic) -> Publisher:
        """Return a publisher that the node hears."""
        made = self.node.create_publisher(topic.type, topic.name, topic.qos)
        assert spin_until(self.node, made.get_subscription_count, PATIENCE)
        return made

    def header(self, stamp_ns: int | None = None) -> Header:
        stamp = Time()
        stamp.sec, stamp.nanosec = divmod(stamp_ns or self.now_ns, 10**9)
        return Header(frame_id='odom', stamp=stamp)

    def odometry_message(self, *position: float) -> Odometry:
        message = Odometry(header=self.header())
        pose = message.pose.pose
        pose.position.x, pose.position.y, pose.position.z = position or (0.0, 0.0, 0.0)
        pose.orientation.w = 1.0
        return message

    def imu_message(self) -> Imu:
        message = Imu(header=self.header())
        message.orientation.w = 1.0
        message.linear_acceleration.z = 9.81 + 1e-6 * (self.now_ns % 1000003)
        return message

    def step(self, odometry: Odometry | None = None, imu: Imu | None = None) -> None:
        """Publish the given samples 4 ms later, and receive commands."""
        for message, publisher in ((imu, self.imu), (odometry, self.odometry)):
            if message is not None:
                publisher.publish(message)
        spin_once(self.node, 0.005)
        time.sleep(2e-3)  # most waits are for the node's log and diagnostics, in the host's time
        self.now_ns += STEP_NS

    def hover(self) -> None:
        self.step(self.odometry_message(), self.imu_message())

    def until(self, condition: Callable[[], object], act: Callable[[], object]) -> None:
        """Repeat an action until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, self.problems[-3:] + [self.log]
            act()

    def hover_until(self, problem: str) -> None:
        """Hover until the last diagnostics begin with a text."""
        self.problems.clear()
        self.until(lambda: self.problems and self.problems[-1].startswith(problem), self.hover)

    def thrust(self) -> float:
        """Return the newest command's sum of thrusts [N]."""
        return float(np.sum(self.commands[-1].effort))

    @property
    def log(self) -> str:
        return self.process.log.read_text()

    def refuse(self, reason: str, publisher: Publisher, message: object) -> None:
        """Hover and publish a message until the log names a reason.

        The message is published each time, because the log omits rejections that soon follow
        another one, and of the newest message alone one may be lost.
        """

        def act() -> None:
            publisher.publish(message)
            self.hover()

        self.until(lambda: reason in self.log, act)


@pytest.fixture
def drone(
    request: pytest.FixtureRequest, ros_domain: dict[str, str], ros_node: Node, tmp_path: Path
) -> Iterator[DroneSensors]:
    """Return the sensors of a drone that hovers; an indirect parameter is `arm_wait`."""
    arm_wait = getattr(request, 'param', 0.0)
    parameters = {'drone_file': resource('config', 'drone.yaml'), 'arm_wait': arm_wait}
    log = tmp_path / 'flight_control.log'
    with NodeProcess('flight_control', (), parameters, log=log) as process:
        drone = DroneSensors(ros_node, process)
        drone.hover_until('in order')
        yield drone


def test_hovers_and_follows_valid_set_points_and_trajectories(drone: DroneSensors) -> None:
    command = drone.commands[-1]
    assert list(command.name) == list(DRONE.rotor_names)
    assert (len(command.position), len(command.velocity)) == (0, 0)
    assert drone.thrust() == pytest.approx(WEIGHT, rel=0.01)
    stamp_ns = command.header.stamp.sec * 10**9 + command.header.stamp.nanosec
    assert stamp_ns % STEP_NS == 0
    assert stamp_ns < drone.now_ns
    higher, places = PoseStamped(), drone.publisher(topics.FLIGHT_SET_POINT)
    higher.pose.position.z, higher.pose.orientation.w = 0.5, 1.0
    higher.header.frame_id = 'map'
    drone.refuse("flight_set_point rejected, because its frame is 'map'", places, higher)
    assert drone.thrust() == pytest.approx(WEIGHT, rel=0.01)
    higher.header.frame_id = 'odom'
    places.publish(higher)
    drone.until(lambda: drone.thrust() > 1.05 * WEIGHT, drone.hover)
    ways = drone.publisher(topics.FLIGHT_TRAJECTORY)
    point = MultiDOFJointTrajectoryPoint(transforms=[Transform()])
    point.transforms[0].rotation.w, point.time_from_start.sec = 1.0, 2
    way = MultiDOFJointTrajectory(points=[point])
    for height, stamp_s, reason in ((np.nan, 0, 'flight path'), (5.0, 10**6, 'its stamp is')):
        point.transforms[0].translation.z, way.header.stamp.sec = height, stamp_s
        drone.refuse(reason, ways, way)
    way.header.stamp.sec = 0
    ways.publish(way)
    drone.until(lambda: drone.thrust() > 1.2 * WEIGHT, drone.hover)


def test_messages_of_base_reaction_are_fed_forward(drone: DroneSensors) -> None:
    wrenches, inertias = map(drone.publisher, (topics.MOTION_WRENCH, topics.ARM_INERTIA))
    inertia = InertiaStamped(header=drone.header())
    inertia.inertia.m = np.nan
    drone.refuse('arm_inertia', inertias, inertia)
    # The arm is 0.5 kg heavier than it was, and thrown upward besides: its base hangs upside down.
    inertia.inertia.m, inertia.inertia.com.z = 1.987, 0.2
    inertia.inertia.ixx = inertia.inertia.iyy = inertia.inertia.izz = 0.1
    wrench = WrenchStamped()
    wrench.wrench.force.z = -5.0

    def tell() -> None:
        inertia.header = wrench.header = drone.header()
        inertias.publish(inertia)
        wrenches.publish(wrench)
        drone.hover()

    wanted = WEIGHT + 0.5 * 9.81 - 5.0
    drone.until(lambda: drone.thrust() == pytest.approx(wanted, rel=0.01), tell)


@pytest.mark.parametrize('drone', [0.0, 10.0], indirect=True)
def test_waits_for_the_forecast_of_the_arm_if_arm_wait_is_set(
    drone: DroneSensors, request: pytest.FixtureRequest
) -> None:
    wrenches, arm_wait = (
        drone.publisher(topics.MOTION_WRENCH),
        request.node.callspec.params['drone'],
    )
    told_ns = drone.now_ns + 300_000_000
    end = time.monotonic() + (arm_wait or PATIENCE)  # before it can have given up, if it waits

    def answered_ns() -> int:
        stamp = drone.commands[-1].header.stamp
        return stamp.sec * 10**9 + stamp.nanosec

    def tell() -> None:
        wrenches.publish(WrenchStamped(header=drone.header(told_ns)))
        drone.hover()
        assert time.monotonic() < end

    while drone.now_ns < told_ns + 20 * STEP_NS:
        tell()
    if arm_wait:
        assert answered_ns() < told_ns
    else:
        drone.until(lambda: answered_ns() >= told_ns, tell)
    answered, told_ns = answered_ns(), drone.now_ns + 10**9
    drone.until(lambda: answered_ns() > answered, tell)


@pytest.mark.parametrize('drone', [1.0], indirect=True)
def test_a_silent_base_reaction_is_awaited_once(drone: DroneSensors) -> None:
    wrenches = drone.publisher(topics.MOTION_WRENCH)
    told = WrenchStamped(header=drone.header())
    for _ in range(50):
        wrenches.publish(told)
        drone.hover()
    answers = len(drone.commands)  # to wait each time would take longer
    drone.until(lambda: len(drone.commands) >= answers + 100, drone.hover)
    drone.hover_until('forecasts of the arm motion are late or missing')


def test_implausible_inputs_are_named_and_the_drone_stays_level(drone: DroneSensors) -> None:
    # Silent odometry: level by the IMU, sinking.
    drone.until(
        lambda: any('level by the IMU' in text for text in drone.problems),
        lambda: drone.step(None, drone.imu_message()),
    )
    assert drone.thrust() == pytest.approx(0.97 * WEIGHT, rel=0.02)
    for _ in range(50):
        drone.hover()
    # A silent IMU is named; the odometry's rate serves.
    drone.problems.clear()
    drone.until(
        lambda: 'imu silent' in drone.problems, lambda: drone.step(drone.odometry_message())
    )
    assert drone.thrust() == pytest.approx(WEIGHT, rel=0.05)
    drone.until(
        lambda: 'odometry: a value is NaN' in drone.log,
        lambda: drone.step(drone.odometry_message(np.nan, 0.0, 0.0)),
    )
    # Both silent: no command any more.
    drone.until(
        lambda: any('the rotors stop' in text for text in drone.problems),
        lambda: spin_once(drone.node, 0.02),
    )
    # What was under way when it was told still comes; then nothing does.
    count = -1
    while count < len(drone.commands):
        count = len(drone.commands)
        for _ in range(20):
            spin_once(drone.node, 0.02)
