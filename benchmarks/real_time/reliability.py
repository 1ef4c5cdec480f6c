"""Processor time of publishing joint_states reliably, compared with best-effort publishing.

At 1 kHz a process publishes the same states on two topics in alternating order: best effort, and
reliable with depth 1. Both have a subscriber of this package (best effort). The reliable topic may
have another subscriber: a second one of this package, or a reliable one with depth 10, as in
tutorials. The latter reads all messages, reads once per second, or is stopped (SIGSTOP) as by a
debugger.
"""

import argparse
import os
import signal
import subprocess
import sys
import time

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from timing.waiting import wait_until

from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.ros.process.node_process import ros_environment

PERIOD = 1e-3
NAMES = ['joint1', 'joint2', 'joint3', 'joint4']
BEST_EFFORT = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE
)
RELIABLE = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE
)
TUTORIAL = QoSProfile(depth=10)
READERS = ('none', 'best effort', 'reads all', 'reads once a second', 'is stopped')


def subscribe(name: str, how: str) -> None:
    """Subscribe to a topic until standard input ends."""
    rclpy.init(args=[])
    node = Node('subscriber')
    qos = BEST_EFFORT if how in ('suite', 'best effort') else TUTORIAL
    node.create_subscription(JointState, name, lambda _: None, qos, raw=True)
    while rclpy.ok():
        rclpy.spin_once(node, timeout_sec=1.0)
        if how == 'reads once a second':
            time.sleep(1.0)


class Clocked:
    """Publisher that records elapsed and processor time of each message."""

    def __init__(self, node: Node, name: str, qos: QoSProfile) -> None:
        self.publisher: Publisher = node.create_publisher(JointState, name, qos)
        self.took: list[tuple[int, int]] = []

    def publish(self, payload: bytes) -> None:
        """Publish a message and record its cost."""
        begin, begin_cpu = time.perf_counter_ns(), time.thread_time_ns()
        self.publisher.publish(payload)
        end_cpu, end = time.thread_time_ns(), time.perf_counter_ns()
        self.took.append((end - begin, end_cpu - begin_cpu))

    def line(self) -> str:
        """Return quantiles of the cost [us]."""
        wall, cpu = np.array(self.took).T * 1e-3
        p50, p99, p999 = np.percentile(wall, [50.0, 99.0, 99.9])
        return f'{p50:6.1f}{p99:8.1f}{p999:8.1f}{wall.max():9.1f}{np.median(cpu):9.1f}'


def run(how: str, cycles: int) -> None:
    """Publish with one type of reader, and print a line for each topic."""
    command = [sys.executable, __file__, '--subscribe']
    others = [('best_effort', 'suite'), ('reliable', 'suite')]
    if how != 'none':
        others.append(('reliable', how))
    processes = [subprocess.Popen([*command, *other], env=ros_environment()) for other in others]
    node = Node('publisher')
    both = [Clocked(node, 'best_effort', BEST_EFFORT), Clocked(node, 'reliable', RELIABLE)]
    try:
        wait_until(lambda: sum(p.publisher.get_subscription_count() for p in both) == len(others))
        if how == 'is stopped':
            processes[-1].send_signal(signal.SIGSTOP)
        publish(both, cycles)
    finally:
        for process in processes:
            process.kill()
            process.wait()
        node.destroy_node()
    for topic, kind in zip(both, ('best effort', 'reliable'), strict=True):
        print(f'{how:22s}{kind:13s}{topic.line()}', flush=True)


def publish(both: list[Clocked], cycles: int) -> None:
    """Publish on both topics in alternating order."""
    cdr, state, loop = JointStateCdr(NAMES), np.full(4, 0.1), PeriodicLoop(PERIOD)

    def cycle(now_ns: int, index: int) -> None:
        payload = bytes(cdr.pack(time.time_ns(), state, state, state))
        for topic in both if index % 2 else reversed(both):
            topic.publish(payload)
        if loop.cycles >= cycles:
            loop.stop()

    loop.run(cycle)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cycles', type=int, default=10_000)
    parser.add_argument('--subscribe', nargs=2, metavar=('TOPIC', 'HOW'), help='be a subscriber')
    options = parser.parse_args()
    os.environ.update(ros_environment())
    if options.subscribe:
        subscribe(*options.subscribe)
        return 0
    rclpy.init(args=[])
    print('time in publish() [us]              p50     p99   p99.9      max  CPU p50')
    for how in READERS:
        run(how, options.cycles)
    rclpy.shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
