"""Energy topics of a `base_reaction` process with test inputs."""

import time
from pathlib import Path

import numpy as np
import pytest
from quick_spinning import spin_once
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.energy.energy_model import DrivePower
from aerarm_ros.ros.process.node_process import NodeProcess

TAU = np.array([0.5, 3.0, -0.2, 0.4])
SECONDS = 0.5


def test_joules_are_by_cause_and_joint(ros_node: Node, tmp_path: Path) -> None:
    config = load_arm_config()
    codec = JointStateCdr(config.joint_names)
    states = ros_node.create_publisher(
        topics.JOINT_STATES.type, topics.JOINT_STATES.name, topics.JOINT_STATES.qos
    )
    heard = []
    energy = topics.ENERGY
    ros_node.create_subscription(energy.type, energy.name, heard.append, energy.qos)
    stamp = 10**9
    with NodeProcess('base_reaction', log=tmp_path / 'log') as process:
        while not states.get_subscription_count():
            spin_once(ros_node, 0.05)
            assert process.returncode is None, process.tail()
        q = np.array([0.0, 0.5, 0.0, 0.0])
        deadline = time.monotonic() + 60.0
        # What comes too fast is not heard: its time counts nevertheless.
        while not (heard and seconds_of(heard[-1]) > SECONDS):
            assert time.monotonic() < deadline
            stamp += 10_000_000
            states.publish(codec.pack(stamp, q, np.zeros(4), TAU))
            spin_once(ros_node, 0.01)
    table = heard[-1]
    (causes, joints) = table.layout.dim
    assert (causes.size, joints.size) == (8, 4)
    assert causes.label.split()[1:3] == ['copper', 'friction']
    assert joints.label.split()[1:] == list(config.joint_names)
    rows = np.array(table.data).reshape(8, 4)
    copper = DrivePower(config).copper(TAU) * seconds_of(table)
    np.testing.assert_allclose(rows[0], copper, rtol=1e-6)
    assert rows[1:6] == pytest.approx(0.0)  # it stands still


def seconds_of(table: object) -> float:
    """Return the time that was metered [s], by what the boards take for themselves."""
    standby = np.array(table.data).reshape(8, 4)[6].sum()  # type: ignore[attr-defined]
    return float(standby / load_arm_config().power_stage.standby)
