"""Serve a web page that shows the arm, with buttons to stop, enable and move it.

Usage: run `ros2 run aerarm_ros view`, then open the printed address in a browser.
"""

from __future__ import annotations

import logging
import socket
import time
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.drone_urdf import with_drone
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES, DRONE_FILE, load_arm, load_drone
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.process_end import StopSignals
from aerarm_ros.ros.requests.arm_client import BRIDGES_PARAMETER

NAME = 'view'
# The node updates the scene in each cycle, text and plots in each third cycle.
TEXT_EVERY = 3

PARAMETERS = ParameterTable(
    Parameter('host', '127.0.0.1', (
        'network address at which the page is served. Any address except that of the local host '
        'opens the page to the network, and the page then requires the token in the printed URL'
    )),
    Parameter('port', 8080, 'TCP port of the page; the next free port if it is in use', '', 1,
        65535),
    BRIDGES_PARAMETER,
    Parameter('rate', 30.0, 'frame rate of the 3-D view', 'Hz', 1.0, 100.0),
    Parameter('history', 10.0, 'time range that the plots show', 's', 1.0, 120.0),
    Parameter('tool', 'tool0',
        'link whose path the 3-D view shows; the last link of the URDF if empty'),
    *ARM_FILES,
    DRONE_FILE,
)  # fmt: skip


class ViewError(ValueError):
    """Error if the server of the page cannot start; the message states what to do."""


class View:
    """Node that shows the topics of the arm on a web page.

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
        try:  # Imported here, because the help does not need the package viser, which loads slowly.
            from aerarm_ros.ros.page.page_controller import PageController
            from aerarm_ros.ros.page.page_server import PageError, PageGuard, serve_page
            from aerarm_ros.ros.page.view_controls import PageMotion, PageRequests, ViewControls
            from aerarm_ros.ros.page.view_diagnostics import ViewDiagnostics
            from aerarm_ros.ros.page.view_panel import ViewPanel
            from aerarm_ros.ros.page.view_plots import ViewFeed, ViewPlots
            from aerarm_ros.ros.page.view_scene import ViewScene
        except ImportError as error:
            raise ViewError(
                f"the web page needs the package viser ({error}): run pip install 'viser>=1.1,<2'"
            ) from None
        self.status = 0
        self._node = node = rclpy.create_node(NAME)
        self._values = values = PARAMETERS.declare(node)
        config, robot = load_arm(values)
        drone = load_drone(values, config, robot)
        robot = robot if drone is None else _carried(robot, drone)
        names = robot.joint_names
        self._mode = ''
        self._rejections: dict[str, str] = {}
        self._diagnostics = ViewDiagnostics()
        self._requests = PageRequests(node, values.bridges)
        self._feed = ViewFeed(node, names, values.history, values.rate, drone is not None)
        files = {item.name: getattr(values, item.name) for item in ARM_FILES}
        self._controller = PageController(node.get_namespace(), files, values.drone_file)
        topics.ARM_MODE.subscription(node, self._on_mode)
        topics.DIAGNOSTICS.subscription(node, self._on_diagnostics)
        self._loop = PeriodicLoop(1.0 / values.rate)
        _check_address(values.host)
        # Unused connections of a browser are not errors, and `run` prints the address.
        logging.getLogger('websockets.server').setLevel(logging.CRITICAL)
        guard = PageGuard.for_host(values.host)
        try:
            with redirect_stdout(StringIO()):
                self._server = serve_page(values.host, values.port, guard, self._log_refused)
        except PageError as error:
            raise ViewError(str(error)) from None
        self._address = guard.address(values.host, self._server.get_port())
        self._is_private = guard.is_private
        # The stop button is created first, because the other elements take longer to load.
        self._panel = ViewPanel(self._server, config.name, self._requests.ask)
        self._scene = ViewScene(self._server, robot, values.tool)
        # The bridge's limits: the URDF has none for a continuous joint.
        limits = np.column_stack([config.column('position_min'), config.column('position_max')])
        motion = PageMotion(node, config)
        self._controls = ViewControls(
            self._server, self._panel, motion, self._controller, names, limits
        )
        self._panel.add_reports(self._server)
        self._plots = ViewPlots(self._server, names, values.history)

    def run(self) -> None:
        """Update the page until the process receives a stop signal."""
        # Printed instead of logged: the log is published and stored, and the address may contain a
        # token.
        print(f'{NAME}: open {self._address} in a browser', flush=True)
        if not self._is_private:
            self._node.get_logger().warning(
                'the page is reachable from the network: any browser with its URL can move the arm'
            )
        with StopSignals(self._loop.stop), BackgroundExecutor(self._node):
            self._loop.run(self._update)

    def close(self) -> None:
        """End the controller that the page started, stop the server and destroy the node."""
        self._controller.close()
        with redirect_stdout(StringIO()):
            self._server.stop()
        self._feed.destroy()
        self._node.destroy_node()

    def _log_refused(self, text: str) -> None:
        self._node.get_logger().warning(text)

    def _update(self, now_ns: int, index: int) -> None:
        # One message for all changes, because waking the server's thread takes longer than the
        # update.
        with self._server.atomic():
            self._show_all(now_ns * 1e-9, index)

    def _show_all(self, now: float, index: int) -> None:
        feed = self._feed
        if feed.update(now) and feed.posture is not None:
            if feed.pose is not None:
                self._scene.move_base(*feed.pose)
            self._scene.update(feed.posture)
        # Without a connected browser, nothing is updated.
        if index % TEXT_EVERY == 0 and self._server.get_clients():
            self._show(now)

    def _show(self, now: float) -> None:
        self._requests.look_for_bridges()
        feed, diagnostics = self._feed, self._diagnostics
        self._scene.update_path()
        self._plots.show(*feed.window(now))
        self._panel.show_mode(
            self._mode, feed.describe(now), diagnostics.recovery_hint(now), self._requests.emulated
        )
        self._controls.show(feed.posture)
        self._panel.show_diagnostics(diagnostics.motors_html(now), diagnostics.status_html(now))

    def _on_mode(self, message: String) -> None:
        self._mode = message.data

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            level = int.from_bytes(status.level, 'little')
            self._show_rejection(status.name, values)
            self._diagnostics.add(status.name, level, status.message, values, now)

    def _show_rejection(self, name: str, values: Mapping[str, str]) -> None:
        """Show why a controller rejected an input, once per new rejection."""
        count = values.get('rejected inputs')
        before = self._rejections.get(name)
        if count is not None:
            self._rejections[name] = count
            if before not in (None, count) and count != '0':
                self._panel.show_result(False, 'rejected:', values.get('last rejection', ''))


def _carried(robot: Robot, drone: DroneConfig) -> Robot:
    """Return the model of an arm under its drone."""
    text = with_drone(robot.urdf_text, drone, robot.prefix)
    return replace(load_robot(text, joint_names=robot.joint_names), prefix=robot.prefix)


def _check_address(host: str) -> None:
    """Raise ViewError if no server can use the address, because viser would then wait for ever."""
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except OSError as error:
        raise ViewError(
            f'the page cannot be served at the address {host} ({error.strerror or error}): set the '
            'parameter host to 127.0.0.1, 0.0.0.0 or an address of this computer'
        ) from None


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, View, args, PARAMETERS, __doc__)
