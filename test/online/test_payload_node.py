"""The node `payload_estimator`, with a recording as input, state by state."""

import time

import numpy as np
import pytest
import rclpy
from carrying_run import CarryingRun
from flying_run import FlyingRun
from geometry_msgs.msg import InertiaStamped
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.description.resources import resource
from aerarm_ros.nodes.payload_estimator import PayloadEstimatorNode

PATIENCE = 60.0  # [s] of the host, which may be busy
EPOCH = 1_700_000_000.0


def tell(node: PayloadEstimatorNode, run: CarryingRun, first: float, last: float) -> None:
    """Let the node answer states between two times of a recording [s]."""
    for now, state in run.states():
        if first <= now < last:
            node.stamp_ns = round(1e9 * (EPOCH + now))
            node.answer(node.stamp_ns, state)


def test_a_picked_up_payload_is_published(make_node, run: CarryingRun) -> None:
    node = make_node(PayloadEstimatorNode, load_friction=run.truth.load_friction.tolist())
    heard: list[InertiaStamped] = []
    topic = topics.PAYLOAD
    listener = rclpy.create_node('listener')
    listener.create_subscription(topic.type, topic.name, heard.append, topic.qos)
    tell(node, run, 0.0, run.pick_up + 2.0)
    deadline = time.monotonic() + PATIENCE
    told = node.describe()
    assert told['carries'] == 'a payload'
    while not heard or heard[-1].inertia.m < 0.1:
        assert node._estimator.estimate is not None
        node._send(node.stamp_ns, node._estimator.estimate)
        rclpy.spin_once(listener, timeout_sec=0.05)
        assert time.monotonic() < deadline
    listener.destroy_node()
    body = heard[-1].inertia
    centre = np.array([body.com.x, body.com.y, body.com.z])
    assert heard[-1].header.frame_id == 'link4'
    assert body.m == pytest.approx(run.payload[0], rel=0.05)
    assert np.linalg.norm(centre - run.payload[1:4] / run.payload[0]) < 5e-3
    assert told['mass [kg]'] == pytest.approx(body.m, abs=1e-4)
    assert not node.warning()


def test_in_flight_it_is_weighed_for_as_long_as_the_imu_speaks(make_node) -> None:
    run = FlyingRun(silent=4.2)
    node = make_node(
        PayloadEstimatorNode,
        drone_file=resource('config', 'drone.yaml'),
        base_motion='free',
        load_friction=run.truth.load_friction.tolist(),
    )
    told: dict[str, object] = {}
    for now, state in run.states(node.base.offer, EPOCH):
        node.stamp_ns = round(1e9 * (EPOCH + now))
        node.answer(node.stamp_ns, state)
        estimate = node._estimator.estimate
        if now < run.pick_up:
            assert estimate is None or not estimate.carries
        if now < run.silent:
            assert not node.warning() or now < 0.01
            told = node.describe()
    assert told['mass [kg]'] == pytest.approx(run.load[0], rel=0.05)
    centre, spread = (told[f'{kind}centre [m]'] for kind in ('', 'standard deviations of the '))
    assert np.linalg.norm(np.subtract(centre, run.load[1:])) < 5e-3
    assert (np.abs(np.subtract(centre, run.load[1:])) < 2.0 * np.array(spread)).all()
    # The base's motion isn't known any more: what was found stays, and nothing is sent.
    assert 'no IMU sample for' in node.warning()
    assert node.describe()['mass [kg]'] == pytest.approx(told['mass [kg]'], rel=0.02)


def test_an_arm_that_nothing_holds_is_not_weighed(make_node, run: CarryingRun) -> None:
    node = make_node(PayloadEstimatorNode)
    node._on_mode(String(data='idle'), 0.0)
    tell(node, run, 0.0, 2.0)
    assert node.describe()['carries'] == 'not yet identified'


def test_a_drone_whose_motion_is_ignored_is_refused(make_node) -> None:
    with pytest.raises(ValueError, match="set base_motion to 'free'"):
        make_node(PayloadEstimatorNode, drone_file=resource('config', 'drone.yaml'))
