"""Arrival times of commands, relative to the stamp of the state to which each responds.

It runs as a separate program at the priority of a bridge, and prints quantiles [us] as JSON.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import rclpy

from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_msgs_py.topics import JOINT_COMMAND
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.realtime.scheduling import freeze_garbage_collector, set_fifo
from aerarm_ros.ros.process.node_process import ros_environment
from aerarm_ros.ros.requests.arm_client import ArmClientError

PRIORITY = 75  # between bridge and controller, because it only observes
SHARES = (0.5, 0.99)
_PATIENCE = 20.0  # [s] for the first command


class Arrivals:
    """Run the observer in parallel with a measurement.

    Parameters
    ----------
    seconds
        Duration from the first command [s].
    """

    def __init__(self, seconds: float) -> None:
        command = [sys.executable, str(Path(__file__)), '--seconds', str(seconds)]
        self._process = subprocess.Popen(
            command, env=ros_environment(), stdout=subprocess.PIPE, text=True
        )

    def quantiles(self) -> list[float]:
        """Wait for the observer to end; return median and p99 from state to command [us]."""
        output, _ = self._process.communicate()
        if self._process.returncode:
            raise ArmClientError('no joint_command was received by a third process')
        return json.loads(output)


def listen(seconds: float) -> list[float]:
    """Return the time from state to command of each command [us]."""
    node = rclpy.create_node('bystander')
    reader, codec = RawReader(node, JOINT_COMMAND), JointStateCdr(load_arm_config().joint_names)
    ages: list[float] = []
    if reader.wait(_PATIENCE):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            reader.wait(0.1)
            message = reader.take()
            command = codec.unpack(message[0]) if message else None
            if command is not None:
                ages.append(1e-3 * (message[1]['received_timestamp'] - command.stamp_ns))
    reader.destroy()
    node.destroy_node()
    return ages


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        '--seconds', type=float, default=10.0, help='duration from the first command [s]'
    )
    options = parser.parse_args()
    set_fifo(PRIORITY)
    rclpy.init(args=[])
    freeze_garbage_collector()
    ages = listen(options.seconds)
    rclpy.shutdown()
    print(json.dumps(np.quantile(ages, SHARES).tolist() if ages else []))
    return 0 if ages else 1


if __name__ == '__main__':
    sys.exit(main())
