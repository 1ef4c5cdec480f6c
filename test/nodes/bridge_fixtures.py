"""A bridge on emulated boards as a separate process, and its client."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from bridge_client import BridgeClient, StartBridge
from rclpy.node import Node

from aerarm_ros.ros.process.node_process import NodeProcess


@pytest.fixture
def start_bridge(
    ros_domain: dict[str, str], tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[StartBridge]:
    """Return a function that starts fake_hardware with parameters; all are stopped at the end.

    The simulation runs in lockstep, unless the test is marked with another pace. The encoders are
    absolute by default.
    """
    marker = request.node.get_closest_marker('pace')
    pace = marker.args[0] if marker else 'lockstep'
    with ExitStack() as stack:

        def start(**parameters: object) -> NodeProcess:
            given = {'seed': 3, 'pace': pace, 'encoders': 'absolute', **parameters}
            process = NodeProcess('fake_hardware', (), given, log=tmp_path / 'log')
            return stack.enter_context(process)

        yield start


@pytest.fixture
def bridge(start_bridge: StartBridge, tmp_path: Path) -> NodeProcess:
    return start_bridge(truth_file=tmp_path / 'truth.yaml')


@pytest.fixture
def client(bridge: NodeProcess, ros_node: Node) -> BridgeClient:
    return BridgeClient(ros_node)
