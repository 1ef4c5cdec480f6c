"""Shows the running arm in a browser: 3-D, joint plots, jitter, mode and emergency stop.

Usage: ros2 run aerarm_ros view, then open the address it prints.
"""

from __future__ import annotations

import logging
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.description.drone_urdf import with_drone
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.ros.executors.background_executor import BackgroundExecutor
from aerarm_ros.ros.page.page_guard import PageGuard, is_loopback
from aerarm_ros.ros.page.view_diagnostics import ViewDiagnostics, ViewStatus
from aerarm_ros.ros.page.view_history import ViewHistory
from aerarm_ros.ros.parameters.arm_files import ARM_FILES, load_arm
from aerarm_ros.ros.parameters.drone_file import DRONE_FILE, load_drone
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.stop_signals import StopSignals
from aerarm_ros.ros.requests.arm_client import BRIDGES
from aerarm_ros.ros.requests.bridge_service import BridgeService
from aerarm_ros.ros.states.state_sampler import StateSampler

NAME = 'view'
# The scene moves at every cycle, text and plots are sent at every third.
TEXT_EVERY = 3

PARAMETERS = ParameterTable(
    Parameter('host', '127.0.0.1', 'address to serve the page at; others than this machine reach '
              'it only if it is another one, and then need the token in the address printed'),
    Parameter('port', 8080, 'first TCP port to try', '', 1, 65535),
    Parameter('bridges', list(BRIDGES),
              'node names of the bridges whose e_stop service the button calls'),
    Parameter('rate', 30.0, 'pictures a second', 'Hz', 1.0, 100.0),
    Parameter('history', 10.0, 'time the plots show', 's', 1.0, 120.0),
    Parameter('tool', 'tool0', 'frame whose path is drawn; the last of the URDF if empty'),
    *ARM_FILES,
    DRONE_FILE,
)  # fmt: skip


class ViewError(ValueError):
    """The page cannot be served; the message says what to do."""


class View:
    """Reads the arm's topics as often as a person can see, and shows them.

    Attributes
    ----------
    status
        Exit status after `run`.

    Raises
    ------
    ValueError
        If a parameter or a file cannot be used, or viser is not installed.
    """

    def __init__(self) -> None:
        self.status = 0
        self._node = rclpy.create_node(NAME)
        self._values = values = PARAMETERS.declare(self._node)
        config, robot = load_arm(values)
        drone = load_drone(values, config, robot)
        if drone is not None:
            text = with_drone(robot.urdf_text, drone, robot.prefix)
            carried = load_robot(text, joint_names=config.joint_names)
            robot = replace(carried, prefix=robot.prefix)
            self._listen_to_drone()
        self._names = list(robot.joint_names)
        self._mode = ''
        self._odometry: Odometry | None = None
        self._diagnostics = ViewDiagnostics()
        self._history = ViewHistory(robot.n, values.history, values.rate)
        self._heard = -np.inf
        self._stop = BridgeService(self._node, 'e_stop', values.bridges)
        self._states = StateSampler(self._node, self._names)
        self._subscribe()
        self._loop = PeriodicLoop(1.0 / values.rate)
        self._serve(robot)

    def run(self) -> None:
        """Show until stopped."""
        address = self._guard.address(self._values.host, self._server.get_port())
        # Not by the log: that is published, and kept, and the address may hold a token.
        print(f'{NAME}: the arm is shown at {address}', flush=True)
        if not is_loopback(self._values.host):
            self._node.get_logger().warning(
                'the page is open to the network: who knows its address can stop the arm'
            )
        with StopSignals(self._loop.stop), BackgroundExecutor(self._node):
            self._loop.run(self._update)

    def close(self) -> None:
        """Close the page and destroy the node."""
        with redirect_stdout(StringIO()):
            self._server.stop()
        self._states.destroy()
        self._node.destroy_node()

    def _serve(self, robot: Robot) -> None:
        try:
            from aerarm_ros.ros.page.page_server import PageError, serve_page
            from aerarm_ros.ros.page.view_panel import ViewPanel
            from aerarm_ros.ros.page.view_scene import ViewScene
        except ImportError as error:
            raise ViewError(f"{error}: install it with pip install 'viser>=1.1,<2'") from None
        _check_address(self._values.host)
        # A browser's spare connections are no errors, and the address is said below.
        logging.getLogger('websockets.server').setLevel(logging.CRITICAL)
        self._guard = PageGuard.for_host(self._values.host)
        try:
            with redirect_stdout(StringIO()):
                self._server = serve_page(
                    self._values.host, self._values.port, self._guard, self._tell_refused
                )
        except PageError as error:
            raise ViewError(str(error)) from None
        self._scene = ViewScene(self._server, robot, self._values.tool)
        self._panel = ViewPanel(self._server, self._names, self._values.history, self._stop.call)

    def _tell_refused(self, text: str) -> None:
        self._node.get_logger().warning(text)

    def _subscribe(self) -> None:
        for topic, callback in (
            (topics.ARM_MODE, self._on_mode),
            (topics.DIAGNOSTICS, self._on_diagnostics),
        ):
            self._node.create_subscription(topic.type, topic.name, callback, topic.qos)

    def _update(self, now_ns: int, index: int) -> None:
        now = now_ns * 1e-9
        state = self._states.newest()
        if state is not None:
            self._heard = now
            self._history.add(now, state)
            self._place_drone()
            self._scene.update(state[0])
        # A page nobody looks at costs nothing.
        if index % TEXT_EVERY == 0 and self._server.get_clients():
            self._scene.update_path()
            self._panel.show_motion(*self._history.window(now))
            self._panel.show_mode(self._mode, self._describe_states(now))
            self._panel.show_diagnostics(
                self._diagnostics.timing_html(now), self._diagnostics.status_html(now)
            )

    def _listen_to_drone(self) -> None:
        topic = topics.ODOMETRY
        self._node.create_subscription(topic.type, topic.name, self._on_odometry, topic.qos)

    def _on_odometry(self, message: Odometry) -> None:
        self._odometry = message

    def _place_drone(self) -> None:
        message, self._odometry = self._odometry, None
        if message is not None:
            p, q = message.pose.pose.position, message.pose.pose.orientation
            place, turn = np.array([p.x, p.y, p.z]), np.array([q.w, q.x, q.y, q.z])
            if np.all(np.isfinite([*place, *turn])) and np.any(turn):
                self._scene.move_base(place, turn / np.linalg.norm(turn))

    def _describe_states(self, now: float) -> str:
        if self._states.missing:
            return (
                f'joint_states lacks {", ".join(self._states.missing)}: another arm? (config, '
                'urdf, tf_prefix)'
            )
        if not np.isfinite(self._heard):
            return 'no joint_states in this ROS domain: start a bridge, check ROS_DOMAIN_ID'
        if now - self._heard > 1.0:
            return f'the last joint_states came {now - self._heard:.0f} s ago'
        return f'joint_states at {self._states.frequency(now):.0f} Hz'

    def _on_mode(self, message: String) -> None:
        self._mode = message.data

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            level = int.from_bytes(status.level, 'little')
            self._diagnostics.add(status.name, ViewStatus(level, status.message, values, now))


def _check_address(host: str) -> None:
    """Raise ViewError if no page can be served there: the server would wait for ever."""
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except OSError as error:
        raise ViewError(
            f'no page can be served at host {host}: {error.strerror or error}; give 127.0.0.1, '
            '0.0.0.0 or an address of this computer'
        ) from None


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, View, args, PARAMETERS, __doc__)


if __name__ == '__main__':
    sys.exit(main())
