"""Payload of a running controller: from payload.yaml at its start, and while it runs."""

from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from rclpy.parameter import Parameter

from aerarm_ros.nodes.controllers.computed_torque import ComputedTorqueNode
from aerarm_ros.ros.controllers.controller_parameters import PAYLOAD

BALL = [0.2, 0.02, 0.0, 0.0, 1e-4, 0.0, 2.1e-3, 0.0, 0.0, 2.1e-3]
UPRIGHT_BENT = np.array([0.0, np.pi / 2, 0.0, 1.0])


@pytest.fixture
def node(ros_domain: dict[str, str], tmp_path: Path):
    file = tmp_path / 'payload.yaml'
    payload = {'payload': {'mass': 0.2, 'inertial_parameters': BALL}}
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': payload}}))
    rclpy.init(args=['--ros-args', '--params-file', str(file)])
    node = ComputedTorqueNode()
    yield node
    node.close()
    rclpy.shutdown()


def weight(node: ComputedTorqueNode) -> np.ndarray:
    """Torque [Nm] that the node's model says the payload costs at rest."""
    for request in list(node._requests):
        request(0.0)
    node._requests.clear()
    (model,) = node.arm._models
    alone = node.arm.dynamics(node.values)
    alone.carry(np.zeros(10))
    node.arm._models.remove(alone)
    return model.gravity(UPRIGHT_BENT) - alone.gravity(UPRIGHT_BENT)


def test_payload_file_and_live_parameter(node: ComputedTorqueNode) -> None:
    full = weight(node)
    assert np.abs(full).max() > 0.1
    half = Parameter(PAYLOAD, value=[0.5 * value for value in BALL])
    assert node.node.set_parameters([half])[0].successful
    np.testing.assert_allclose(weight(node), 0.5 * full, atol=1e-9)


def test_an_impossible_payload_changes_nothing(node: ComputedTorqueNode) -> None:
    full = weight(node)
    for values in ([-1.0, *BALL[1:]], BALL[:4]):
        answer = node.node.set_parameters([Parameter(PAYLOAD, value=values)])[0]
        assert not answer.successful
        assert 'no body has these inertial parameters' in answer.reason
    np.testing.assert_allclose(weight(node), full, atol=1e-9)
