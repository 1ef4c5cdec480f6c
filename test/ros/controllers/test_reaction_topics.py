"""Forecast of the arm's load and contact on the drone, which base_reaction publishes."""

import time
from collections.abc import Callable

import numpy as np
import pytest
from controller_bench import NAMES
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmLoadModel, at_drone_centre
from aerarm_ros.motion.signals import ArmState, JointReference
from aerarm_ros.nodes.base_reaction import BaseReactionNode
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.messages import vector
from aerarm_ros.ros.states.state_stream import base_header

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


LEAD = 0.03
MODEL = ArmLoadModel(load_robot(gravity_in_base=DRONE.gravity_in_base))
AMPLITUDE, W = np.array([0.5, 0.8, 0.6, 0.7]), 2.0 * np.pi * np.array([0.5, 0.6, 0.75, 0.9])


def swing(time: float) -> JointReference:
    s, c = np.sin(W * time), np.cos(W * time)
    return JointReference(AMPLITUDE * s, AMPLITUDE * W * c, -AMPLITUDE * W**2 * s)


class SwingingArm:
    """A swinging arm whose states and plan a node receives, and the node's messages."""

    def __init__(self, node: BaseReactionNode) -> None:
        self.node, self.heard, self.now_ns = node, {}, 10**9
        node._loads._publish = lambda publisher, message: self.heard.update(
            {publisher.topic_name.strip('/'): message}
        )

    def answer(self, stamp_ns: int) -> None:
        self.now_ns, now = stamp_ns, 1e-9 * stamp_ns
        plan = JointTrajectory(header=base_header(stamp_ns, ''), joint_names=NAMES)
        for time_ns in range(0, 100_000_001, 20_000_000):
            q, dq, ddq = map(np.ndarray.tolist, swing(now + 1e-9 * time_ns))
            point = JointTrajectoryPoint(positions=q, velocities=dq, accelerations=ddq)
            point.time_from_start.nanosec = time_ns
            plan.points.append(point)
        self.node._loads.take_plan(plan, now)
        motion = swing(now)
        self.node.answer(stamp_ns, ArmState(motion.q, motion.dq, np.zeros(4)))

    @property
    def about_ns(self) -> int:
        stamp = self.heard['base_wrench_motion'].header.stamp
        return stamp.sec * 10**9 + stamp.nanosec

    @property
    def motion(self) -> float:
        """Return the largest component of the motion's effect on the drone."""
        force = vector(self.heard['base_wrench_motion'].wrench.force)
        spin = vector(self.heard['feedforward_acceleration'].accel.angular)
        return float(np.abs([force, spin]).max())


def test_the_forecast_is_published_in_advance_and_fades_at_the_end(make_node) -> None:
    arm = SwingingArm(
        make_node(
            BaseReactionNode,
            drone_file=resource('config', 'drone.yaml'),
            lead=LEAD,
            load_rate=500.0,
            acceleration_at='centre',
        )
    )
    for step in range(300):
        arm.answer(10**9 + 5_000_000 * step)
        planned = MODEL.evaluate(swing(1e-9 * arm.now_ns + LEAD))
        if step > 200:  # the node has received the plan for long enough
            assert arm.about_ns == arm.now_ns + round(1e9 * LEAD)
            force = vector(arm.heard['base_wrench_motion'].wrench.force)
            assert np.linalg.norm(force - planned.motion[:3]) < 0.02
    assert np.linalg.norm(planned.motion[:3]) > 0.1
    told = arm.heard['feedforward_acceleration']
    assert told.header.frame_id == 'drone'
    wanted = at_drone_centre(planned.acceleration(DRONE), DRONE)
    both = np.concatenate([vector(told.accel.linear), vector(told.accel.angular)])
    np.testing.assert_allclose(both, wanted, atol=0.02 * np.abs(wanted).max())
    inertia = arm.heard['arm_inertia'].inertia
    np.testing.assert_allclose(vector(inertia.com), planned.com, atol=1e-4)
    np.testing.assert_allclose(vector(arm.heard['arm_com'].point), vector(inertia.com))
    weight = vector(arm.heard['base_wrench_weight'].wrench.force)
    np.testing.assert_allclose(weight, inertia.m * np.array(DRONE.gravity_in_base), rtol=1e-9)
    # The states end in the middle of a motion.
    sizes = [arm.motion]
    while (pause := arm.node._loads.fade()) is not None:
        sizes.append(arm.motion)
        time.sleep(pause)
    assert np.all(np.diff(sizes) <= 1e-9)
    assert len(sizes) > 3
    assert sizes[-1] == 0.0
    # A state that was held up on its way is no news: time never goes back.
    ended_ns = arm.about_ns
    arm.answer(arm.now_ns + 1_000_000)
    assert (arm.about_ns, arm.motion) == (ended_ns, 0.0)
    arm.answer(ended_ns)
    assert arm.motion > 0.0
