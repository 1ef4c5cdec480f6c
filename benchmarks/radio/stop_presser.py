"""Presses the e-stop on the ground, or clears it on the drone, as lines on standard input say.

Usage: python benchmarks/radio/stop_presser.py

The lines `press` and `clear` call the bridge's services. Each change of `arm_mode` and each answer
is printed as a JSON object with its time on the machine's monotonic clock, which both hosts of
`two_hosts.py` share.
"""

import json
import select
import sys
import time

import rclpy
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_ros.ros.process.node_process import stay_on_this_host, use_packaged_profile

SERVICES = {'press': 'e_stop', 'clear': 'clear_fault'}


def say(**row: object) -> None:
    """Print a row."""
    print(json.dumps({'time': time.monotonic(), **row}), flush=True)


def main() -> None:
    """Serve until standard input ends."""
    stay_on_this_host()
    use_packaged_profile()
    rclpy.init()
    node = rclpy.create_node('stop_presser')
    clients = {
        name: node.create_client(Trigger, f'fake_hardware/{service}')
        for name, service in SERVICES.items()
    }
    topic = topics.ARM_MODE
    node.create_subscription(
        topic.type, topic.name, lambda message: say(mode=message.data), topic.qos
    )
    while not all(client.service_is_ready() for client in clients.values()):
        rclpy.spin_once(node, timeout_sec=0.02)
    say(ready=True)
    while True:
        rclpy.spin_once(node, timeout_sec=0.002)
        if select.select([sys.stdin], [], [], 0.0)[0]:
            line = sys.stdin.readline().strip()
            if not line:
                return
            say(called=line)
            future = clients[line].call_async(Trigger.Request())
            future.add_done_callback(
                lambda done: say(answer=done.result().success, text=done.result().message)
            )


if __name__ == '__main__':
    main()
