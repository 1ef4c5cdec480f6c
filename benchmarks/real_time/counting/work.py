"""Parts of the nodes' work per cycle that `instructions.py` runs separately to count instructions.

In the folder `benchmarks/real_time`, `python -m counting.work PIECE CYCLES` runs one part for a
number of cycles.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rclpy
from counting.replayed_boards import replayed_cycle
from rclpy.node import Node
from timing.waiting import wait_until

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_msgs_py.topics import JOINT_COMMAND, JOINT_STATES, MOTOR_STATES
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.compensation import FrictionCompensation, MomentumObserver
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.computed_torque import ComputedTorque
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.gate.command_intake import OfferedCommand
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.ros.bridge.hardware_bridge import BridgeStreams
from aerarm_ros.ros.process.node_process import ros_environment

PERIOD = 1e-3
MOST = 2000  # largest number of cycles
ENABLED_AT = 20
ALIGNED_AT = 1500
SWING = np.array([0.5, 0.1, 0.5, 0.5])
NAMES = load_arm_config().joint_names


def drive(bridge: BridgeCycle, cycles: int) -> None:
    """Enable a bridge, and move the arm back and forth; the first 1.5 s are not counted."""
    now = 100.0
    for index in range(ALIGNED_AT + cycles):
        now += PERIOD
        if index == ENABLED_AT:
            bridge.enable()
        if index >= ALIGNED_AT:
            velocity = SWING * np.sin(3.0 * now)
            bridge.command(OfferedCommand(NAMES, None, velocity, None, PERIOD, 'counted'), now)
        bridge.update(now)
    if bridge.mode != 'running':
        raise SystemExit(f'the arm is {bridge.mode}: {bridge.faults}')


def bridge_cycle(cycles: int) -> None:
    """Run the bridge's cycle: frames, monitors, limits, barriers; without emulation and topics."""
    drive(replayed_cycle(drive, MOST), cycles)


def emulated_cycle(cycles: int) -> None:
    """Run the bridge's cycle with emulated boards and the arm's physics."""
    config = load_arm_config().with_encoders('absolute')
    drive(BridgeCycle(config, make_emulated_transport(config, load_robot(), 1)), cycles)


def control_law(cycles: int) -> None:
    """Run computed torque with observer and friction, from state bytes to command bytes.

    The arm moves all the time; holding it takes a fifth less.
    """
    config, robot = load_arm_config(), load_robot()
    dynamics = MovingBaseDynamics(robot, config.column('reflected_inertia'))
    friction = FrictionCompensation(robot.viscous, robot.coulomb, load_share=0.04)
    limits = JointLimits.from_config(config)
    follower = TrajectoryFollower(limits, FollowerTolerances.uniform(len(NAMES)))
    loop = ControlLoop(
        limits,
        follower,
        ComputedTorque(dynamics, 400.0, 40.0, friction=friction),
        MomentumObserver(dynamics, 30.0, friction),
    )
    cdr, rest, tau = JointStateCdr(NAMES), np.array(config.rest_position), np.zeros(len(NAMES))
    loop.update(ArmState(rest, tau, tau), 0.0)
    way = JointTrajectory(limits, NAMES, [0.0, 2.0 * MOST * PERIOD], [rest, 0.5 * rest])
    follower.follow(way, 0.0)
    for index in range(1, cycles + 1):
        stamp_ns, (q, dq, _) = index * 1_000_000, follower.reference
        sample = cdr.unpack(cdr.pack(stamp_ns, q, dq, tau))
        state = ArmState(sample.position, sample.velocity, sample.effort)
        command = loop.update(state, index * PERIOD)
        cdr.pack(stamp_ns, effort=command.tau)
        loop.observe()
    if follower.status != 'moving':
        raise SystemExit(f'the arm does not follow its motion: {follower.outcome}')


def topics(cycles: int) -> None:
    """Send three states and receive a command; another process responds."""
    with _node('counted') as node:
        streams, values = BridgeStreams(node, NAMES), np.full(4, 0.1)
        with _partner():
            wait_until(
                lambda: node.count_subscribers(JOINT_STATES.name) and streams.commands.publishers(),
                120.0,  # counting slows execution down
            )
            for _ in range(cycles):
                streams.publish(time.time_ns(), [values] * 3, [values] * 3, values)
                while not streams.commands.wait(1.0):
                    streams.publish(time.time_ns(), [values] * 3, [values] * 3, values)
                streams.newest_command()
        streams.destroy()


def recording(cycles: int) -> None:
    """Write two messages of the arm into a compressed bag; they are received like topics."""
    described = [
        RecordedTopic(t.name, 'sensor_msgs/msg/JointState') for t in (JOINT_STATES, MOTOR_STATES)
    ]
    cdr, values = JointStateCdr(NAMES), np.random.default_rng(0).standard_normal((MOST, 4))
    with tempfile.TemporaryDirectory() as folder, BagWriter(Path(folder) / 'bag', described) as bag:
        for index in range(cycles):
            stamp = index * 1_000_000
            payload = cdr.pack(stamp, values[index], values[-index], values[index])
            for topic in range(2):
                bag.write(RecordedMessage(topic, payload, stamp, stamp, index))


def answering(cycles: int) -> None:
    """Respond to every state until no more arrive."""
    with _node('partner') as node:
        states, cdr = RawReader(node, JOINT_STATES), JointStateCdr(NAMES)
        commands = node.create_publisher(JOINT_COMMAND.type, JOINT_COMMAND.name, JOINT_COMMAND.qos)
        while True:
            if states.wait(1.0) and (message := states.take_newest()):
                commands.publish(cdr.pack(cdr.unpack(message[0]).stamp_ns, np.zeros(4)))


@contextmanager
def _node(name: str) -> Iterator[Node]:
    rclpy.init(args=[])
    node = rclpy.create_node(name)
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.shutdown()


@contextmanager
def _partner() -> Iterator[None]:
    command = [sys.executable, '-m', 'counting.work', answering.__name__, '0']
    with subprocess.Popen(command, env=ros_environment()) as process:
        try:
            yield
        finally:
            process.kill()


PIECES: dict[str, Callable[[int], None]] = {
    piece.__name__: piece
    for piece in (bridge_cycle, emulated_cycle, control_law, topics, recording, answering)
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('piece', choices=PIECES)
    parser.add_argument('cycles', type=int)
    options = parser.parse_args()
    PIECES[options.piece](options.cycles)


if __name__ == '__main__':
    main()
