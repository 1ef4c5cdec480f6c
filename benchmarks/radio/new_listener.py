"""Start subscribers to the bridge one after the other, and measure when each receives states.

Usage: python benchmarks/radio/new_listener.py COUNT

Each subscriber is a process that is forked from a process with rclpy already imported. It creates
its own DDS participant; the start time of Python does not count. The program prints a JSON list of
times [s].
"""

import json
import os
import sys
import time

import rclpy

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.ros.process.node_process import stay_on_this_host, use_packaged_profile
from aerarm_ros.ros.process.process_end import ExitLimit

_PATIENCE = 20.0  # [s]


def listen(result: int) -> None:
    """Write the time [s] until a new participant has received joint states and mode."""
    begin = time.monotonic()
    rclpy.init()
    node = rclpy.create_node('new_listener')
    reader = RawReader(node, topics.JOINT_STATES, topics.ARM_MODE)
    came: set[int] = set()
    while len(came) < 2 and time.monotonic() - begin < _PATIENCE:
        reader.wait(0.02)
        came |= {index for index in (0, 1) if reader.take(index) is not None}
    os.write(result, json.dumps(time.monotonic() - begin).encode())
    with ExitLimit(0):  # Fast DDS may hang while it deletes a new participant
        reader.destroy()
        node.destroy_node()
        rclpy.shutdown()


def main() -> None:
    """Start one process after the other."""
    stay_on_this_host()
    use_packaged_profile()
    times = []
    for _ in range(int(sys.argv[1])):
        reading, writing = os.pipe()
        if os.fork() == 0:
            listen(writing)
            os._exit(0)
        os.close(writing)
        with os.fdopen(reading) as stream:
            times.append(json.loads(stream.read()))
        os.wait()
    print(json.dumps(times), flush=True)


if __name__ == '__main__':
    main()
