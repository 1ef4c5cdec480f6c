"""Readings of motors, from messages as a bridge sends them."""

import time

import numpy as np
import pytest
from quick_spinning import spin_once
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.cdr import Float64ArrayCdr
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.ros.bridge.bridge_diagnostics import MOTORS, POWER_FROM, resistance_key
from aerarm_ros.ros.diagnostics import DiagnosticsPublisher
from aerarm_ros.ros.playback.bench_recording import MotorReadings

NAMES = ('joint1', 'joint2')


class Motors:
    """What a bridge tells of two motors, and readings of it."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.readings = MotorReadings(node, NAMES)
        self._states, self._power = (
            node.create_publisher(topic.type, topic.name, topic.offered)
            for topic in (topics.MOTOR_STATES, topics.MOTOR_POWER)
        )
        self._diagnostics = DiagnosticsPublisher(node)
        self._cdr, self._power_cdr = JointStateCdr(NAMES), Float64ArrayCdr(2)
        self.wait(
            lambda: all(p.get_subscription_count() for p in (self._states, self._power)), 'topics'
        )

    def wait(self, condition, what: str) -> None:
        deadline = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < deadline, what
            spin_once(self.node, 0.02)

    def tell(self, source: str, part: str = MOTORS, **ohms: str) -> None:
        values = {POWER_FROM: source, **{resistance_key(name): ohm for name, ohm in ohms.items()}}
        self._diagnostics.publish([self._diagnostics.status(part, b'\0', '', values)])

    def cycle(self, k: int, power: bool = True) -> None:
        current, speed = np.array([0.1 * k, -1.0]), np.array([2.0, 3.0 * k])
        self._states.publish(self._cdr.pack(k * 10**6, np.zeros(2), speed, current))
        if power:
            self._power.publish(self._power_cdr.pack([4.0 * k, 5.0]))


def test_states_and_power_of_the_same_cycle_are_read_by_joint(ros_node: Node) -> None:
    motors = Motors(ros_node)
    readings = motors.readings
    motors.tell('voltage', joint1='not known', joint2='0.15000')
    motors.wait(lambda: readings.supply(1).reported == 0.15, 'diagnostics')
    for k in range(1, 6):
        motors.cycle(k)

        def is_read(k: int = k) -> bool:
            readings.take()
            return len(readings.supply(0).time) == k

        motors.wait(is_read, f'cycle {k}')
    motors.cycle(6, power=False)  # half of a cycle is no reading
    spin_once(ros_node, 0.1)
    readings.take()
    first, second = readings.supply(0), readings.supply(1)
    k = np.arange(1.0, 6.0)
    np.testing.assert_allclose(first.time, 1e-3 * k)
    np.testing.assert_allclose(first.current, 0.1 * k)
    np.testing.assert_allclose(first.power, 4.0 * k)
    np.testing.assert_allclose(second.speed, 3.0 * k)
    assert np.isnan(first.reported)
    readings.destroy()


@pytest.mark.parametrize(('source', 'part'), [('model', MOTORS), ('voltage', 'arm')])
def test_power_that_was_computed_is_no_reading(ros_node: Node, source: str, part: str) -> None:
    """A power computed from a resistance cannot determine the resistance."""
    motors = Motors(ros_node)
    motors.tell(source, part)
    motors.cycle(1)
    spin_once(ros_node, 0.1)
    motors.readings.take()
    assert motors.readings.supply(0).time.size == 0
    motors.readings.destroy()
