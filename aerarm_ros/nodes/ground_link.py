"""Connect drone and ground: the drone's topics and services appear on the ground.

The 1 kHz topics stay on the drone. This relay sends decimated states, diagnostics and the mode to
the ground, and sends commands, service requests and the e-stop to the drone. One encrypted
connection carries at most 0.3 Mbit/s and 100 packets per second. Run the node on each host.

Usage: ros2 run aerarm_ros ground_link --ros-args -p role:=ground -p drone:=ADDRESS
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import rclpy

from aerarm_ros.link.sealed import make_key, read_key
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.link.link_ends import CONTINUE, DRONE, GROUND, HOME, STOP, DroneEnd, GroundEnd
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
    Parameter('role', DRONE, 'host on which this node runs', choices=(DRONE, GROUND)),
    Parameter('drone', '', 'address of the drone (on the ground only)'),
    Parameter(
        'ground',
        '',
        'address of the ground; any if empty (on the drone only)',
    ),
    Parameter('port', 7447, 'UDP port of the drone', '', 1024, 65535),
    Parameter(
        'address', '0.0.0.0', "address at which the drone's host listens (on the drone only)"
    ),
    Parameter(
        'key_file',
        '~/.config/aerarm/ground_link.key',
        "file of the shared key, identical on both hosts; the drone's node creates a missing file",
    ),
    Parameter('rate', 50.0, 'publishing rate of joint states on the ground host', 'Hz', 0.1, 50.0),
    Parameter(
        'values_rate',
        10.0,
        'publishing rate of all other topics on the ground host',
        'Hz',
        0.1,
        50.0,
    ),
    Parameter('rates', [''], 'rates of individual topics, each as NAME=HZ'),
    Parameter(
        'ground_timeout',
        0.0,
        'silence of the ground host after which ground_lost applies; 0 switches it off',
        's',
        0.0,
        3600.0,
    ),
    Parameter(
        'ground_lost',
        STOP,
        "reaction to the loss of the ground host: 'continue' the motion, 'stop' along "
        "its path, or return 'home'",
        choices=(CONTINUE, STOP, HOME),
    ),
    Parameter('bags', '~/aerarm_bags', 'on the drone: folder for bags that the ground requests'),
    Parameter(
        'fetch_rate',
        4.0,
        'on the ground: largest data rate of the fetch of a bag; lower if the radio is slower',
        'Mbit/s',
        0.05,
        50.0,
    ),
    *REAL_TIME_PARAMETERS,
    *(item for item in ARM_FILES if item.name in ('config', 'tf_prefix')),
)


class GroundLink:
    """Drone end or ground end of the connection.

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
        self.status = 0
        self._is_over = False
        self._node = rclpy.create_node(NAME)
        self._values = values = PARAMETERS.declare(self._node)
        path = Path(values.key_file).expanduser()
        is_drone = values.role == DRONE
        if is_drone and not path.exists():
            make_key(path)
            self._node.get_logger().info(
                f'created the shared key {path}: copy it to the same path on the ground host'
            )
        key = read_key(path)
        self._end = (DroneEnd if is_drone else GroundEnd)(self._node, values, key)

    def run(self) -> None:
        """Relay messages until stopped."""
        # A publisher must not wait for a new subscriber while an e-stop waits for it.
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


if __name__ == '__main__':
    sys.exit(main())
