"""Press the e-stop on the ground, or clear it on the drone, by commands on standard input.

Usage: python benchmarks/radio/stop_presser.py [watch]

With `watch` the program prints when joint states return after a pause of 0.3 s. The lines `press`
and `clear` on standard input call the bridge's services. `state` prints the newest joint states,
and `sweep` moves joint 1 by 1 rad within 6 s by a trajectory. `diagnostics` prints the offset of
the drone's clock that ground_link estimates, and the largest latency that a node reports. The
program prints each change of `arm_mode` and each answer as a JSON object. The object contains the
time on the machine's monotonic clock, which both hosts of `two_hosts.py` share.
"""

import contextlib
import json
import select
import sys
import time
from typing import Any

import rclpy
from builtin_interfaces.msg import Duration
from rclpy.node import Node
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.ros.process.node_process import stay_on_this_host, use_packaged_profile

SERVICES = {'press': 'e_stop', 'clear': 'clear_fault'}


def say(**row: object) -> None:
    """Print a JSON row."""
    print(json.dumps({'time': time.monotonic(), **row}), flush=True)


def received(node: Node, topic: topics.Topic, seconds: float = 0.0) -> list[Any]:
    """Return the messages of a topic within a time [s]; at least one."""
    came: list[Any] = []
    subscription = topic.subscription(node, came.append)
    end = time.monotonic() + seconds
    while not came or time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.02)
    node.destroy_subscription(subscription)
    return came


def joint_state(node: Node) -> dict[str, list[float]]:
    """Return position [rad] and velocity [rad/s] of the next joint states."""
    message = received(node, topics.JOINT_STATES)[0]
    return {'position': list(message.position), 'velocity': list(message.velocity)}


def diagnostics(node: Node) -> dict[str, float]:
    """Return the drone's clock minus the ground's [ms] and the largest latency [us] of 2.5 s."""
    offset, latency = float('nan'), float('-inf')
    came = received(node, topics.DIAGNOSTICS, 2.5)
    for status in (status for message in came for status in message.status):
        for item in status.values:
            if item.key == 'clock offset [ms]' and status.name == '/ground_link: ground side':
                offset = float(item.value)
            elif 'latency' in item.key or 'command age' in item.key:
                with contextlib.suppress(ValueError):
                    latency = max(latency, abs(float(item.value)))
    return {'offset': offset, 'latency': latency}


def sweep(node: Node) -> topics.JointTrajectory:
    """Return a trajectory that starts at the present posture."""
    message = received(node, topics.JOINT_STATES)[0]
    begin, end = list(message.position), list(message.position)
    end[0] -= 1.0
    still = [0.0] * len(begin)
    points = [
        JointTrajectoryPoint(
            positions=place, velocities=still, time_from_start=Duration(sec=seconds)
        )
        for place, seconds in ((begin, 0), (end, 6))
    ]
    return topics.JointTrajectory(joint_names=list(message.name), points=points)


class StateWatch:
    """Monitor that prints when joint states return after a pause, with the length of the pause."""

    def __init__(self, node: Node) -> None:
        self._last = 0.0
        topic = topics.JOINT_STATES
        node.create_subscription(topic.type, topic.name, self._on_state, topic.qos, raw=True)

    def _on_state(self, _: bytes) -> None:
        now = time.monotonic()
        if now - self._last > 0.3:
            say(back=True, pause=now - self._last)
        self._last = now


def main() -> None:
    """Process commands until standard input ends."""
    stay_on_this_host()
    use_packaged_profile()
    rclpy.init()
    node = rclpy.create_node('stop_presser')
    clients = {
        name: node.create_client(Trigger, f'fake_hardware/{service}')
        for name, service in SERVICES.items()
    }
    trajectories = topics.JOINT_TRAJECTORY.publisher(node)
    topics.ARM_MODE.subscription(node, lambda message: say(mode=message.data))
    while not all(client.service_is_ready() for client in clients.values()):
        rclpy.spin_once(node, timeout_sec=0.02)
    if sys.argv[1:] == ['watch']:
        StateWatch(node)
    say(ready=True)
    while True:
        rclpy.spin_once(node, timeout_sec=0.01)
        if select.select([sys.stdin], [], [], 0.0)[0]:
            line = sys.stdin.readline().strip()
            if not line:
                return
            say(called=line)
            if line in ('state', 'diagnostics'):
                say(**(joint_state if line == 'state' else diagnostics)(node))
            elif line == 'sweep':
                trajectories.publish(sweep(node))
            else:
                clients[line].call_async(Trigger.Request()).add_done_callback(
                    lambda done: say(answer=done.result().success, text=done.result().message)
                )


if __name__ == '__main__':
    main()
