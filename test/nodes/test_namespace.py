"""An arm in a namespace, with the drone's IMU on a topic outside it."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import rclpy
from bridge_client import BridgeClient
from rclpy.node import Node

from aerarm_ros.ros.process.node_process import NodeProcess

NAMESPACE, IMU = '/left', '/drone/imu'
ROS_ARGUMENTS = ('--ros-args', '-r', f'__ns:={NAMESPACE}', '-r', f'imu:={IMU}', '--')
NODES = {
    'fake_hardware': {'seed': 3, 'encoders': 'absolute', 'base_motion_profile': 'tilted'},
    'gravity_compensation': {'base_motion': 'full'},
}


@pytest.fixture
def arm(ros_domain: dict[str, str], tmp_path: Path) -> Iterator[None]:
    with ExitStack() as stack:
        for name, parameters in NODES.items():
            log = tmp_path / f'{name}.log'
            stack.enter_context(NodeProcess(name, ROS_ARGUMENTS, parameters, log=log))
        yield


@pytest.fixture
def neighbour(ros_node: Node) -> Iterator[Node]:
    """Return a node in the arm's namespace."""
    node = rclpy.create_node('neighbour', namespace=NAMESPACE)
    yield node
    node.destroy_node()


def test_the_arm_runs_on_the_imu_outside(arm: None, neighbour: Node) -> None:
    client = BridgeClient(neighbour)
    client.wait_for_mode('idle')
    assert client.call('enable').success
    client.wait_for_mode('running')
    reported = client.diagnostics
    client.wait_for(lambda: any(values.get('base motion') == 'IMU' for values in reported.values()))
    topics = {name for name, _ in neighbour.get_topic_names_and_types()}
    assert {f'{NAMESPACE}/joint_states', f'{NAMESPACE}/joint_command', IMU} <= topics
    assert not topics & {'/joint_states', '/joint_command', f'{NAMESPACE}/imu', '/imu'}
