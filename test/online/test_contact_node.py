"""The node `contact_estimator`, which receives a recording state by state."""

import time
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


@pytest.fixture
def known(
    make_node, run: CarryingRun, bound: ResidualBound, tmp_path: Path
) -> ContactEstimatorNode:
    """Return the node with the thresholds of the recorded arm."""
    file = tmp_path / 'residuals.yaml'
    values = bound.to_dict(run.robot().joint_names)
    file.write_text(yaml.safe_dump({RESIDUALS_SECTION: values}))
    share = run.truth.load_friction.tolist()
    parameters = {'residuals_file': file, 'confirmation': 0.01, 'load_friction': share}
    return make_node(ContactEstimatorNode, **parameters, payload_mass=0.5, payload_size=0.15)


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


@pytest.mark.parametrize(
    ('text', 'message'),
    [('', 'residuals_file is not set: learn the contact thresholds'), ('a: 1', 'residual_bound')],
)
def test_missing_and_invalid_thresholds_are_named(
    make_node, tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / 'residuals.yaml'
    file.write_text(text)
    with pytest.raises(ValueError, match=message):
        make_node(ContactEstimatorNode, **({'residuals_file': file} if text else {}))
