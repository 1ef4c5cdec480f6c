"""The node `contact_estimator`, which receives a recording state by state."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import rclpy
import yaml
from carrying_run import CarryingRun
from std_msgs.msg import Bool
from touched_run import Touch, recording

from aerarm_msgs_py import topics
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.nodes.contact_estimator import ContactEstimatorNode
from aerarm_ros.online.external_torque import ResidualBound
from aerarm_ros.ros.controllers.contact_parameters import RESIDUALS_SECTION

PATIENCE = 60.0  # [s] of the host, which may be busy
EPOCH = 1_700_000_000.0

Make = Callable[..., ContactEstimatorNode]


@pytest.fixture
def make(ros_domain: dict[str, str]) -> Iterator[Make]:
    """Return a function that makes the node with parameters."""
    nodes = []

    def make_node(**parameters: object) -> ContactEstimatorNode:
        given = [word for item in parameters.items() for word in ('-p', '{}:={}'.format(*item))]
        rclpy.init(args=['--ros-args', *given])
        nodes.append(ContactEstimatorNode())
        return nodes[0]

    yield make_node
    for node in nodes:
        node.close()
    rclpy.shutdown()


@pytest.fixture
def known(
    make: Make, run: CarryingRun, bound: ResidualBound, tmp_path: Path
) -> ContactEstimatorNode:
    """Return the node with the thresholds of the recorded arm."""
    file = tmp_path / 'residuals.yaml'
    values = bound.to_dict(run.robot().joint_names)
    file.write_text(yaml.safe_dump({RESIDUALS_SECTION: values}))
    share = run.truth.load_friction.tolist()
    parameters = {'residuals_file': file, 'confirmation': 0.01, 'load_friction': share}
    return make(**parameters, payload_mass=0.5, payload_size=0.15)


def test_a_touch_is_published(known: ContactEstimatorNode, run: CarryingRun) -> None:
    node = known
    received: list[Bool] = []
    listener = rclpy.create_node('listener')
    topic = topics.CONTACT
    listener.create_subscription(topic.type, topic.name, received.append, topic.qos)
    motion = Touch(1.6, 9.0, (0.0, 0.0, -8.0)).added(run, recording(run, 0.7, 2.0))
    assert motion.dq is not None
    deadline = time.monotonic() + PATIENCE
    for now, q, dq, tau in zip(motion.time, motion.q, motion.dq, motion.tau, strict=True):
        node.stamp_ns = round(1e9 * (EPOCH + now))
        state = ArmState(q, dq, tau)
        node.answer(node.stamp_ns, state)
        if now < 1.6:
            assert node.describe()['contact'] in ('no', 'unknown')
    described = node.describe()
    assert described['contact'] == 'yes'
    assert described['contacts'] == 1
    assert described['touched link'] in run.robot().link_names
    assert not node.warning()
    while not received or not received[-1].data:
        assert node._report is not None
        node._send(node.stamp_ns, state, node._report)
        rclpy.spin_once(listener, timeout_sec=0.05)
        assert time.monotonic() < deadline
    listener.destroy_node()


def feed(node: ContactEstimatorNode, motion: Recording) -> None:
    """Give the node a recording state by state."""
    assert motion.dq is not None
    for now, q, dq, tau in zip(motion.time, motion.q, motion.dq, motion.tau, strict=True):
        node.stamp_ns = round(1e9 * (EPOCH + now))
        node.answer(node.stamp_ns, ArmState(q, dq, tau))


def test_a_model_of_another_arm_is_named(known: ContactEstimatorNode, free: CarryingRun) -> None:
    motion = recording(free, 0.7, 9.0)
    for again in range(3):
        time = motion.time + 8.31 * again
        feed(known, replace(motion, time=time, tau=0.6 * motion.tau))
    assert 'check that the model belongs to this arm' in known.warning()
    assert known.describe()['contact'] == 'no'


def test_an_undeclared_payload_is_named(known: ContactEstimatorNode, loaded: CarryingRun) -> None:
    feed(known, recording(loaded, 0.7, 7.5))
    described = known.describe()
    assert described['undeclared payload [kg]'] == pytest.approx(0.2, rel=0.25)
    assert described['contact'] == 'no'


def test_an_encoder_that_hangs_is_named(known: ContactEstimatorNode, run: CarryingRun) -> None:
    motion = recording(run, 0.7, run.pick_up)
    q = motion.q.copy()
    q[500:] = q[500]
    feed(known, replace(motion, q=q))
    assert 'check the encoder' in known.warning()
    assert known.describe()['contacts'] == 0


def test_a_saturated_drive_is_named(known: ContactEstimatorNode, run: CarryingRun) -> None:
    motion = recording(run, 0.7, run.pick_up)
    tau = motion.tau.copy()
    tau[-100:] = known.arm.limits.effort_max
    feed(known, replace(motion, tau=tau))
    assert 'is at its limit' in known.warning()
    assert known.describe()['contacts'] == 0


def test_without_thresholds_the_error_states_how_to_learn_them(make: Make) -> None:
    with pytest.raises(ValueError, match='residuals_file is not set: learn the contact thresholds'):
        make()


def test_an_invalid_thresholds_file_is_named(make: Make, tmp_path: Path) -> None:
    file = tmp_path / 'residuals.yaml'
    file.write_text('a: 1\n')
    with pytest.raises(ValueError, match='residual_bound'):
        make(residuals_file=file)
