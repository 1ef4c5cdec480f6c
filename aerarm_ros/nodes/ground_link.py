"""Make topics and services of the drone's computer available on the ground computer.

The 1 kHz topics stay on the drone. The node sends joint states at a lower rate, diagnostics and the
mode to the ground, and commands, service requests and the e-stop to the drone. The encrypted
connection carries at most 0.3 Mbit/s and 100 packets per second. Run the node on both computers.

Usage: ros2 run aerarm_ros ground_link --ros-args -p role:=ground -p drone:=ADDRESS
"""

from collections.abc import Sequence
from pathlib import Path

import rclpy

from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import (
    ARM_FILES,
    REAL_TIME_PARAMETERS,
    prepare_thread,
)
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.process_end import StopSignals
from aerarm_ros.ros.process.shared_ports import PortWatch

NAME = 'ground_link'

PARAMETERS = ParameterTable(
    Parameter('role', 'drone', 'role of the computer on which this node runs: drone or ground',
        choices=('drone', 'ground')),
    Parameter('drone', '', "network address of the drone's computer, for the node on the "
                           'ground only'),
    Parameter('ground', '',
        'network address of the ground computer, for the node on the drone only; any address '
        'if empty'),
    Parameter('port', 7447, "UDP port of the drone's computer", '', 1024, 65535),
    Parameter('address', '0.0.0.0',
        "network address at which the drone's computer receives, for the node on the drone "
        'only'),
    Parameter('key_file', '~/.config/aerarm/ground_link.key',
        'file with the shared key, identical on both computers; the node on the drone creates a '
        'missing file'),
    Parameter('rate', 50.0,
        'publishing rate of joint states on the ground computer', 'Hz', 0.1, 50.0),
    Parameter('values_rate', 10.0,
        'publishing rate of all other topics on the ground computer', 'Hz', 0.1, 50.0),
    Parameter('ground_timeout', 0.0,
        'time without messages from the ground after which ground_lost applies; 0 for never',
        's', 0.0, 3600.0),
    Parameter('ground_lost', 'stop',
        "reaction of the arm if messages from the ground stop: 'continue' the motion, 'stop' "
        "along the path, or return 'home'", choices=('continue', 'stop', 'home')),
    Parameter('bags', '~/aerarm_bags',
        'folder for bags that the ground computer requests, for the node on the drone only'),
    Parameter('fetch_rate', 4.0,
        'largest data rate at which a bag is copied to the ground; must be below the data rate '
        'of the radio; for the node on the ground only', 'Mbit/s', 0.05, 50.0),
    *REAL_TIME_PARAMETERS,
    *(item for item in ARM_FILES if item.name in ('config', 'tf_prefix')),
)  # fmt: skip


class GroundLink:
    """Node that relays messages between drone and ground; one instance runs on each computer.

    Attributes
    ----------
    status
        Exit status after `run`.

    Raises
    ------
    ValueError
        If a parameter, the key file or the port cannot be used.
    """

    def __init__(self) -> None:
        # Only a running node needs these imports, which take most of the time of --help.
        from aerarm_ros.link.sealed import make_key, read_key
        from aerarm_ros.ros.link.link_ends import DroneEnd, GroundEnd

        self.status = 0
        self._is_over = False
        self._node = rclpy.create_node(NAME)
        self._values = values = PARAMETERS.declare(self._node)
        path = Path(values.key_file).expanduser()
        is_drone = values.role == 'drone'
        if is_drone and not path.exists():
            make_key(path)
            self._node.get_logger().info(
                f'created the file {path} with the shared key: copy this file to the same path on '
                'the ground computer'
            )
        key = read_key(path)
        self._end = (DroneEnd if is_drone else GroundEnd)(self._node, values, key)

    def run(self) -> None:
        """Relay messages until the process receives a stop signal."""
        # Without PortWatch a publisher could wait for a new subscriber and delay an e-stop.
        with StopSignals(self._stop), PortWatch(), BackgroundExecutor(self._node):
            prepare_thread(self._values, self._node.get_logger())
            while not self._is_over and rclpy.ok():
                self._end.step()

    def close(self) -> None:
        """Close the connection and destroy the node."""
        self._end.close()
        self._node.destroy_node()

    def _stop(self) -> None:
        self._is_over = True


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, GroundLink, args, PARAMETERS, __doc__)
