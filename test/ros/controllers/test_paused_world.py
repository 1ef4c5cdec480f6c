"""Topics of `base_reaction` while the host of an emulated arm pauses, and after its end."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from bridge_client import BridgeClient, velocity_command
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.ros.process.node_process import NodeProcess

LEAD = 0.03  # [s]
PAUSE = 0.4  # [s]
WELL_BEFORE = 8.0  # [s] the longest silence of an emulated arm
MISSED_NS = 20_000_000  # the last states may not have come here


def stamp_ns(message) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


class PausedArm(BridgeClient):
    """An arm whose host may pause, and what the drone is told of its motion."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self.told: list[WrenchStamped] = []
        topic = topics.MOTION_WRENCH
        node.create_subscription(topic.type, topic.name, self.told.append, topic.queued(100).qos)

    def let_it_move(self) -> None:
        """Enable the arm and turn joint 1, until the drone is told of it."""
        self.make_ready()
        self.answer = lambda state: velocity_command(state, [0.3, 0.0, 0.0, 0.0])
        self.wait_for(lambda: len(self.told) > 100 and not self.is_told_nothing())

    def is_told_nothing(self) -> bool:
        force = self.told[-1].wrench.force
        return not np.any([force.x, force.y, force.z])


@pytest.fixture
def drone(ros_domain: dict[str, str], ros_node: Node, tmp_path: Path) -> Iterator[PausedArm]:
    log = tmp_path / 'base_reaction.log'
    with NodeProcess('base_reaction', (), {'lead': LEAD}, log=log):
        yield PausedArm(ros_node)


def test_a_pause_of_the_host_does_not_fade_the_arms_motion(
    drone: PausedArm, tmp_path: Path
) -> None:
    # The clock of the second of two arms has another name, which only its bridge knows.
    names = ('--ros-args', '-r', '/clock:=/left/clock', '--')
    arm = {'seed': 3, 'encoders': 'absolute'}
    with NodeProcess('fake_hardware', names, arm, log=tmp_path / 'arm.log') as bridge:
        drone.let_it_move()
        for _ in range(2):
            os.kill(bridge.pid, signal.SIGSTOP)
            drone.spin(PAUSE)
            newest_ns = stamp_ns(drone.states[-1])
            assert stamp_ns(drone.told[-1]) < newest_ns + 1e9 * LEAD + MISSED_NS
            os.kill(bridge.pid, signal.SIGCONT)
            drone.wait_for(lambda since=newest_ns: stamp_ns(drone.told[-1]) > since + 2e8)
        # What is not newer than the last is ignored by who is told.
        assert min(np.diff([stamp_ns(wrench) for wrench in drone.told])) >= 0


@pytest.mark.pace('keep_up')
def test_the_motion_of_an_ended_emulated_arm_fades(drone: PausedArm, bridge: NodeProcess) -> None:
    drone.let_it_move()
    os.kill(bridge.pid, signal.SIGTERM)
    heard, count = time.monotonic(), len(drone.states)
    while not drone.is_told_nothing():
        drone.spin(0.05)
        if len(drone.states) > count:
            heard, count = time.monotonic(), len(drone.states)
        assert time.monotonic() < heard + WELL_BEFORE


@pytest.mark.pace('real_time')
def test_in_real_time_the_motion_of_a_silent_arm_fades(
    drone: PausedArm, bridge: NodeProcess
) -> None:
    drone.let_it_move()
    os.kill(bridge.pid, signal.SIGSTOP)
    drone.wait_for(drone.is_told_nothing, WELL_BEFORE)
    silent_ns = stamp_ns(drone.told[-1])
    os.kill(bridge.pid, signal.SIGCONT)
    drone.wait_for(lambda: stamp_ns(drone.told[-1]) > silent_ns + 2e8)
    assert min(np.diff([stamp_ns(wrench) for wrench in drone.told])) >= 0
