"""base_reaction publishes contact on the drone, or the reason why it does not."""

import time
from collections.abc import Callable

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.nodes.base_reaction import BaseReactionNode
from aerarm_ros.ros.executors import spin_until

LIMIT = 60.0  # [s] of the host
DRONE = load_drone_config()
HANGING = [0.0, np.pi / 2, 0.0, 0.0]
WEIGHT = (3.0 + 1.487) * 9.81
PUSH = 5.0  # [N] upward
STEP_NS = 4_000_000


class HoveringDrone:
    """Topics of a drone and an arm at rest, in the process of the receiving node."""

    def __init__(self, node: BaseReactionNode) -> None:
        self.told_to = node
        teller = node.node
        self.states, self.odometry, self.rotors = (
            teller.create_publisher(topic.type, topic.name, topic.offered)
            for topic in (topics.JOINT_STATES, topics.ODOMETRY, topics.ROTOR_COMMAND)
        )
        self.codec = JointStateCdr(node.arm.config.joint_names)
        self.reader = RawReader(teller, topics.CONTACT_WRENCH)
        self.now_ns = 10**9
        self.wrenches: list[WrenchStamped] = []

    def stamped(self, message: Odometry | JointState) -> Odometry | JointState:
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.now_ns, 10**9)
        return message

    def step(
        self, speaks: bool = True, lift: float = WEIGHT - PUSH, command: JointState | None = None
    ) -> None:
        """Say what it is 4 ms later; hear what comes."""
        self.now_ns += STEP_NS
        if speaks:
            thrust = [lift / 6 + 1e-9 * (self.now_ns % 7)] * 6
            command = command or JointState(name=list(DRONE.rotor_names), effort=thrust)
            self.rotors.publish(self.stamped(command))
            odometry = Odometry()
            odometry.pose.pose.orientation.w = 1.0
            self.odometry.publish(self.stamped(odometry))
        payload = self.codec.pack(self.now_ns, np.array(HANGING), np.zeros(4), np.zeros(4))
        self.states.publish(payload)
        if self.told_to._stream.wait(0.05):
            self.told_to._take()
        while (raw := self.reader.take()) is not None:
            self.wrenches.append(deserialize_message(raw[0], WrenchStamped))

    def until(self, condition: Callable[[], bool], **how: object) -> None:
        deadline = time.monotonic() + LIMIT
        while not condition():
            assert time.monotonic() < deadline, self.told_to.describe()
            self.step(**how)

    @property
    def force(self) -> float:
        return self.wrenches[-1].wrench.force.z if self.wrenches else np.nan


def service(node: BaseReactionNode, name: str) -> Trigger.Response:
    client = node.node.create_client(Trigger, f'base_reaction/{name}')
    future = client.call_async(Trigger.Request())
    assert spin_until(node.node, future.done, LIMIT)
    return future.result()


def test_a_push_is_published_and_missing_inputs_are_named(make_node) -> None:
    node = make_node(
        BaseReactionNode, drone_file=str(resource('config', 'drone.yaml')), contact_bandwidth=5.0
    )
    drone = HoveringDrone(node)
    assert node.describe()['contact'] == 'no joint states yet'
    drone.until(lambda: node.state is not None, speaks=False)
    assert node.describe()['contact'] == 'no odometry yet'
    assert node.warning() == ''  # nobody has to tell it
    assert 'no odometry yet' in service(node, 'zero_contact').message
    # The base hangs upside down.
    drone.until(lambda: drone.force == pytest.approx(-PUSH, rel=0.02))
    message = drone.wrenches[-1]
    assert message.header.frame_id == 'base_link'
    assert message.header.stamp.nanosec % STEP_NS == 0
    assert node.describe()['contact'] == 'published'
    assert np.hypot(message.wrench.force.x, message.wrench.force.y) < 1e-6
    # It can be zeroed, where there is something to average.
    told = service(node, 'zero_contact')
    assert told.success, told.message
    drone.until(lambda: abs(drone.force) < 0.02 * PUSH)
    drone.until(lambda: drone.force == pytest.approx(PUSH, rel=0.02), lift=WEIGHT)
    # It is quicker with another bandwidth, while it runs.
    (result,) = node.node.set_parameters([Parameter('contact_bandwidth', value=20.0)])
    assert result.successful, result.reason
    (result,) = node.node.set_parameters([Parameter('contact_bandwidth', value=np.nan)])
    assert not result.successful
    count = len(drone.wrenches)
    drone.until(lambda: len(drone.wrenches) > count + 20)
    assert abs(drone.force) < 0.1 * PUSH
    # A command of another drone, and NaN, are named and not used.
    for command in (JointState(name=['a'], effort=[1.0]), JointState(name=list(DRONE.rotor_names))):
        rejections = node.diagnostics.rejections
        drone.until(lambda n=rejections: node.diagnostics.rejections > n, command=command)
        assert node.diagnostics.last_rejection.startswith('rotor_command: the ')
    # What drone and rotors say ends: it fades, ends, and is named.
    drone.until(lambda: drone.force == pytest.approx(PUSH, rel=0.05), lift=WEIGHT)
    drone.until(lambda: drone.force == 0.0, speaks=False)
    count = len(drone.wrenches)
    for _ in range(50):
        drone.step(speaks=False)
    assert len(drone.wrenches) == count
    assert node.warning().startswith('contact_wrench: no good odometry for')


def test_without_drone_file_no_wrench_is_published(make_node) -> None:
    node = make_node(BaseReactionNode)
    drone = HoveringDrone(node)
    for _ in range(50):
        drone.step()
    assert not drone.wrenches
    assert 'set drone_file' in node.describe()['contact']
    assert node.warning() == ''


def test_nothing_is_published_before_the_joints_are_homed(
    make_node, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = make_node(BaseReactionNode, drone_file=str(resource('config', 'drone.yaml')))
    published: list[object] = []
    monkeypatch.setattr(node.answers, 'publish', lambda _, message: published.append(message))
    still = np.zeros(4)
    node.answer(10**9, ArmState(np.full(4, np.nan), still, still))
    assert not published
    assert 'home the arm' in node.warning()
    node.answer(10**9 + 10**7, ArmState(np.array(HANGING), still, still))
    assert published
    assert 'home the arm' not in node.warning()
