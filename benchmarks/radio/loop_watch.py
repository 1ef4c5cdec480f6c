"""Print the bridge's loop statistics from /diagnostics, one JSON object per message.

Usage: python benchmarks/radio/loop_watch.py SECONDS
"""

import json
import sys
import time

import rclpy

from aerarm_msgs_py import topics
from aerarm_ros.ros.process.node_process import stay_on_this_host, use_packaged_profile


def main() -> None:
    """Subscribe on this host for a given time."""
    stay_on_this_host()
    use_packaged_profile()
    begin = time.monotonic()
    rclpy.init()
    node = rclpy.create_node('loop_watch')

    def on_diagnostics(message: topics.DiagnosticArray) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            if 'missed cycles' in values:
                row = {
                    'time': message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec,
                    'cycles': int(values['cycles']),
                    'missed': int(values['missed cycles']),
                    'longest [ms]': float(values['period max [us]']) / 1e3,
                }
                print(json.dumps(row), flush=True)

    topic = topics.DIAGNOSTICS
    node.create_subscription(topic.type, topic.name, on_diagnostics, topic.qos)
    while time.monotonic() - begin < float(sys.argv[1]):
        rclpy.spin_once(node, timeout_sec=0.2)


if __name__ == '__main__':
    main()
