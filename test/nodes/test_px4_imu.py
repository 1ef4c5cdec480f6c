"""PX4's conventions at the edge; the node itself needs px4_msgs."""

import os
import signal
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from quick_spinning import spin_until
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.autopilot.px4 import vehicle_attitude
from aerarm_ros.nodes import px4_imu
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.states.state_stream import to_imu_sample


def test_a_level_autopilot_at_rest() -> None:
    sample = SimpleNamespace(gyro_rad=[0.1, 0.2, 0.3], accelerometer_m_s2=[0.0, 0.0, -9.81])
    attitude = vehicle_attitude(SimpleNamespace(q=[1.0, 0.0, 0.0, 0.0]))
    found = to_imu_sample(px4_imu.to_imu(Time(sec=3), attitude, sample))
    assert found.stamp == 3.0
    np.testing.assert_allclose(found.specific_force, [0.0, 0.0, 9.81])
    np.testing.assert_allclose(found.angular_velocity, [0.1, -0.2, -0.3])
    # Nose to the north: a quarter turn from the east.
    np.testing.assert_allclose(np.abs(found.attitude), [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    assert to_imu_sample(px4_imu.to_imu(Time(), None, sample)).attitude is None


@pytest.mark.skipif(find_spec('px4_msgs') is not None, reason='px4_msgs is installed')
def test_without_px4_msgs_it_says_what_to_do(ros_domain, capsys) -> None:
    assert px4_imu.main([]) == 1
    assert 'MAVROS' in capsys.readouterr().err


def test_a_silent_autopilot_is_a_warning(ros_node: Node, tmp_path: Path) -> None:
    # Any types will do for topics on which nothing comes.
    package = tmp_path / 'px4_msgs'
    package.mkdir()
    (package / '__init__.py').touch()
    (package / 'msg.py').write_text(
        'from std_msgs.msg import Int8 as SensorCombined, Int16 as VehicleAttitude'
    )
    paths = [str(tmp_path), *filter(None, [os.environ.get('PYTHONPATH')])]
    environment = {'PYTHONPATH': os.pathsep.join(paths)}
    found: list[DiagnosticStatus] = []

    def store(message: DiagnosticArray) -> None:
        found.extend(message.status)

    topic = topics.DIAGNOSTICS
    ros_node.create_subscription(topic.type, topic.name, store, topic.qos)
    with NodeProcess('px4_imu', (), {}, environment, tmp_path / 'log') as node:
        assert spin_until(ros_node, lambda: found, 60.0), node.tail()
        assert node.stop(signal.SIGHUP) == 0
    assert found[0].level == DiagnosticStatus.WARN
    assert found[0].name == '/px4_imu: px4_imu'
    assert '/fmu/out/sensor_combined and /fmu/out/vehicle_attitude' in found[0].message
