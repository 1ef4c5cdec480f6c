"""Forecast of a `base_reaction` process for a drone, with inputs from the test."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmLoadModel, at_drone_centre
from aerarm_ros.motion.signals import JointReference
from aerarm_ros.ros.controllers.state_node import PlanTopic
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.process.node_process import NodeProcess

LEAD = 0.03
DRONE = load_drone_config()
CONFIG = load_arm_config()
MODEL = ArmLoadModel(load_robot(gravity_in_base=DRONE.gravity_in_base))
AMPLITUDE, W = np.array([0.5, 0.8, 0.6, 0.7]), 2.0 * np.pi * np.array([0.5, 0.6, 0.75, 0.9])


def swing(time: float | np.ndarray) -> JointReference:
    t = np.asarray(time)[..., np.newaxis]
    s, c = np.sin(W * t), np.cos(W * t)
    return JointReference(AMPLITUDE * s, AMPLITUDE * W * c, -AMPLITUDE * W**2 * s)


class PublishedArm:
    """Publish a swinging arm's states and plan, and receive the drone's topics."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.codec = JointStateCdr(CONFIG.joint_names)
        self.stamp_ns = 10**9
        self.heard: dict[str, object] = {}
        topic = topics.JOINT_STATES
        self.states = node.create_publisher(topic.type, topic.name, topic.qos)
        self.plan = PlanTopic(
            node, CONFIG.joint_names, lambda: self.stamp_ns, lambda t: swing(self.now + t)
        )
        for topic in (
            *(topics.ARM_INERTIA, topics.ARM_COM, topics.WEIGHT_WRENCH, topics.MOTION_WRENCH),
            topics.FEEDFORWARD_ACCELERATION,
        ):
            node.create_subscription(
                topic.type,
                topic.name,
                lambda message, name=topic.name: self.heard.__setitem__(name, message),
                topic.qos,
            )

    @property
    def now(self) -> float:
        return 1e-9 * self.stamp_ns

    def about(self, name: str) -> int:
        stamp = self.heard[name].header.stamp if name in self.heard else None
        return stamp.sec * 10**9 + stamp.nanosec if stamp else 0

    def motion(self) -> float:
        """Return the largest component of the motion's wrench on the drone."""
        force = vector(self.heard['base_wrench_motion'].wrench.force)
        spin = vector(self.heard['feedforward_acceleration'].accel.angular)
        return float(np.abs([force, spin]).max())

    def step(self) -> bool:
        """Continue for 5 ms; return whether the drone's topics answered this state in time."""
        self.stamp_ns += 5_000_000
        self.plan.update()
        rclpy.spin_once(self.node, timeout_sec=0.005)
        motion = swing(self.now)
        self.states.publish(self.codec.pack(self.stamp_ns, motion.q, motion.dq, np.zeros(4)))
        goal = self.stamp_ns + round(1e9 * LEAD)
        told = ('base_wrench_motion', 'feedforward_acceleration', 'arm_inertia')
        return spin_until(
            self.node, lambda: all(abs(self.about(name) - goal) < 10 for name in told), 0.2
        )


@pytest.fixture
def arm(ros_domain: dict[str, str], ros_node: Node, tmp_path: Path) -> Iterator[PublishedArm]:
    parameters = {
        'drone_file': resource('config', 'drone.yaml'),
        'lead': LEAD,
        'load_rate': 500.0,
        'acceleration_at': 'centre',
    }
    with NodeProcess('base_reaction', (), parameters, log=tmp_path / 'log') as process:
        arm = PublishedArm(ros_node)
        assert spin_until(ros_node, arm.states.get_subscription_count, 60.0), process.tail()
        yield arm


def vector(part) -> np.ndarray:
    return np.array([part.x, part.y, part.z])


def until_in_time(arm: PublishedArm) -> None:
    end = time.monotonic() + 60.0
    while not arm.step():
        assert time.monotonic() < end


def sizes_of_a_fade(arm: PublishedArm) -> list[float]:
    """Return the sizes of a fading motion after the last state, until zero."""
    sizes = [arm.motion()]
    while sizes[-1] > 0.0:
        count = arm.about('feedforward_acceleration')
        assert spin_until(arm.node, lambda c=count: arm.about('feedforward_acceleration') > c, 60.0)
        sizes.append(arm.motion())
    return sizes


def test_the_forecast_is_published_in_advance_and_fades_at_the_end(arm: PublishedArm) -> None:
    # Until one plan has been heard for as long as it takes to be believed.
    in_time = errors = 0
    while in_time < 30:
        if not arm.step():
            continue
        planned = MODEL.evaluate(swing(arm.now + LEAD))
        force = vector(arm.heard['base_wrench_motion'].wrench.force)
        errors += np.linalg.norm(force - planned.motion[:3]) > 0.02
        in_time += 1
        if errors and in_time == 30 and arm.now < 20.0:
            in_time = errors = 0
    assert not errors
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

    # The states end in the middle of a motion: within some steps, nothing is left of it.
    sizes = sizes_of_a_fade(arm)
    for _ in range(10):
        assert np.all(np.diff(sizes) <= 1e-9)
        if len(sizes) > 3:
            break
        until_in_time(arm)  # it was held up for the time of a fade
        sizes = sizes_of_a_fade(arm)
    assert len(sizes) > 3

    # The last state once more, as in lockstep, is no motion either.
    last = swing(arm.now)
    count = len(arm.heard)
    arm.heard.clear()
    arm.states.publish(arm.codec.pack(arm.stamp_ns, last.q, last.dq, np.zeros(4)))
    assert spin_until(arm.node, lambda: len(arm.heard) == count, 60.0)
    assert arm.motion() == 0.0

    # A state that was held up on its way is no news: time never goes back for who is told.
    ended_ns = arm.about('base_wrench_motion')
    assert not arm.step()
    assert arm.about('base_wrench_motion') == ended_ns
    assert arm.motion() == 0.0
    arm.stamp_ns = ended_ns
    until_in_time(arm)
    assert arm.motion() > 0.0
