"""Asks the bridge to do something: enable, disable, clear_fault, home or e_stop.

Usage: ros2 run aerarm_ros arm enable --wait ready
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import rclpy
from rclpy.utilities import remove_ros_args

from aerarm_ros.hardware.bridge_cycle import MODES
from aerarm_ros.nodes.arm_client import ACTIONS, BRIDGES, ArmClient, ArmClientError
from aerarm_ros.nodes.node_main import run_node

NAME = 'arm'


class Arm:
    """One request to the bridge, on the command line.

    Attributes
    ----------
    status
        Exit status after `run`: 0 when the bridge did what was asked.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.status = 1
        self._options = options
        self._node = rclpy.create_node(NAME)
        self._client = ArmClient(self._node, options.bridge or BRIDGES, [options.action])

    def run(self) -> None:
        """Ask, and wait for the mode if told to."""
        options = self._options
        try:
            if options.wait_before:
                # An arm that is where it shall end up need not come from there.
                modes = [options.wait_before, *(options.wait or ())]
                self._client.wait_for_mode(modes, options.timeout)
            print(self._client.call(options.action, options.timeout), flush=True)
            if options.wait:
                self._client.wait_for_mode(options.wait, options.timeout)
                print(f'arm_mode {self._client.mode}', flush=True)
            self.status = 0
        except ArmClientError as error:
            print(f'{NAME}: {error}', file=sys.stderr)

    def close(self) -> None:
        """Destroy the node."""
        self._node.destroy_node()


def main(args: Sequence[str] | None = None) -> int:
    """Run the command; 0 if the bridge did what was asked."""
    arguments = list(sys.argv if args is None else ['', *args])
    parser = argparse.ArgumentParser(prog=NAME, description=__doc__.splitlines()[0])
    parser.add_argument('action', choices=ACTIONS)
    parser.add_argument(
        '--bridge',
        action='append',
        metavar='NODE',
        help=f'node name of the bridge (default: {" or ".join(BRIDGES)})',
    )
    parser.add_argument(
        '--wait-before', choices=MODES, metavar='MODE', help='mode to wait for before asking'
    )
    parser.add_argument(
        '--wait', nargs='+', choices=MODES, metavar='MODE', help='modes to wait for afterwards'
    )
    parser.add_argument('--timeout', type=float, default=20.0, help='for each step [s]')
    options = parser.parse_args(remove_ros_args(arguments)[1:])
    return run_node(NAME, lambda: Arm(options), args)


if __name__ == '__main__':
    sys.exit(main())
