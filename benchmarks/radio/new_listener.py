"""A new process that listens to the bridge: prints how long it takes until states and mode come.

Usage: python benchmarks/radio/new_listener.py
"""

import json
import time

import rclpy

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.ros.process.node_process import stay_on_this_host, use_packaged_profile


def main() -> None:
    """Listen until both came."""
    stay_on_this_host()
    use_packaged_profile()
    begin = time.monotonic()
    rclpy.init()
    node = rclpy.create_node('new_listener')
    reader = RawReader(node, topics.JOINT_STATES, topics.ARM_MODE)
    came: dict[int, float] = {}
    while len(came) < 2 and time.monotonic() - begin < 20.0:
        reader.wait(0.05)
        for index in (0, 1):
            if index not in came and reader.take(index) is not None:
                came[index] = time.monotonic() - begin
    print(json.dumps({'states': came.get(0), 'mode': came.get(1)}), flush=True)


if __name__ == '__main__':
    main()
