"""Parts of the web page with which the user moves the arm and starts a controller."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser
from rclpy.duration import Duration
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.executables import controllers
from aerarm_ros.hardware.bridge_modes import ACTIONS, STOPS, Answer
from aerarm_ros.motion.polynomial_path import rest_to_rest_duration
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.graph import can_move, listeners
from aerarm_ros.ros.page.page_controller import PageController
from aerarm_ros.ros.page.view_panel import ViewPanel, indented
from aerarm_ros.ros.requests.bridge_service import BridgeService, StopService

_SHORTEST = 0.5  # [s]
# The controller starts at its reference, which differs slightly from the measured configuration.
# So it could reject a motion that uses the full limits.
_OF_LIMITS = 0.95


class PageMotion:
    """Publish joint trajectories for the active controller.

    Parameters
    ----------
    node
        Owner of the publisher.
    config
        Configuration of the arm, with its limits.
    """

    def __init__(self, node: Node, config: ArmConfig) -> None:
        self._node = node
        self._names = list(config.joint_names)
        self._velocity_max = np.array(config.column('velocity_max'))
        self._acceleration_max = np.array(config.column('acceleration_max'))
        self._trajectories = topics.JOINT_TRAJECTORY.publisher(node)

    def go(self, start: Array, goal: Sequence[float], share: float) -> tuple[bool, str]:
        """Publish a trajectory from the present joint angles (n,) to the goal angles (n,) [rad].

        Parameters
        ----------
        start, goal
            Present and final joint angles [rad].
        share
            Largest speed and acceleration as a fraction of the joints' limits.

        Returns
        -------
        sent, text
            Whether a controller receives the motion, and a message for the user.
        """
        if not any(map(can_move, listeners(self._node, self._trajectories.topic_name))):
            return False, (
                'no active controller accepts joint trajectories: start the controller '
                'computed_torque'
            )
        share *= _OF_LIMITS
        duration = rest_to_rest_duration(
            np.asarray(goal) - start,
            share * self._velocity_max,
            share * self._acceleration_max,
            _SHORTEST,
        )
        point = JointTrajectoryPoint(positions=[float(angle) for angle in goal])
        point.time_from_start = Duration(seconds=duration).to_msg()
        self._trajectories.publish(JointTrajectory(joint_names=self._names, points=[point]))
        return True, f'the motion takes {duration:.1f} s'


PUT_BACK = 'put_back'


class PageRequests:
    """Call the bridge's services.

    Parameters
    ----------
    node
        Node that an executor spins in another thread.
    bridges
        Possible node names of the bridge.
    """

    def __init__(self, node: Node, bridges: Sequence[str]) -> None:
        self._stops = {action: StopService(node, action, bridges) for action in STOPS}
        others = {*ACTIONS, PUT_BACK} - STOPS
        self._services = {action: BridgeService(node, action, bridges) for action in others}

    @property
    def emulated(self) -> bool:
        """Whether a bridge with emulated boards is running."""
        return bool(self._services[PUT_BACK].found)

    def look_for_bridges(self) -> None:
        """Find all running bridges now, so that a later stop request reaches them sooner."""
        for stop in self._stops.values():
            stop.look()

    def ask(self, action: str) -> Answer:
        """Send the request `action` to the bridge, and return the bridge's answer."""
        return (self._stops if action in STOPS else self._services)[action].call()


_STEP = 0.01  # [rad] of a slider
_START, _STOP = 'Start controller', 'Stop controller: the bridge holds the arm'


class ViewControls:
    """Folders of the page with joint sliders, and a button for a controller.

    This class checks all values from the browser again, because a message can contain any number.

    Parameters
    ----------
    server
        Server of the page.
    panel
        Panel that shows the result of a click.
    motion, controller
        Objects that publish goals and run a controller.
    names, limits
        Names of the n joints, and their position limits (n, 2) [rad].
    """

    def __init__(
        self,
        server: viser.ViserServer,
        panel: ViewPanel,
        motion: PageMotion,
        controller: PageController,
        names: Sequence[str],
        limits: Array,
    ) -> None:
        self._panel, self._motion, self._controller = panel, motion, controller
        self._limits = limits
        self._posture: Array | None = None
        gui = server.gui
        with gui.add_folder('Control'):
            self._choice = gui.add_dropdown('controller', controllers())
            self._button = gui.add_button(_START)
            self._button.on_click(lambda _: self._toggle())
            self._words = gui.add_html('')
        with gui.add_folder('Move by sliders', expand_by_default=False):
            self._share = gui.add_slider('speed limit', 0.05, 1.0, 0.05, 0.25)
            self._sliders = [
                gui.add_slider(name, float(low), float(high), _STEP, float(np.clip(0.0, low, high)))
                for name, (low, high) in zip(names, limits, strict=True)
            ]
            gui.add_button('Move to slider values').on_click(lambda _: self._go())
            gui.add_button('Set sliders to the present joint angles').on_click(
                lambda _: self._take_posture()
            )

    def show(self, posture: Array | None) -> None:
        """Show whether a controller is running, and the last line of its output.

        Parameters
        ----------
        posture
            (n,) present joint angles [rad], or None if unknown.
        """
        if self._posture is None and posture is not None:
            self._posture = posture
            self._take_posture()
        self._posture = posture if posture is not None else self._posture
        self._button.label = _STOP if self._controller.runs else _START
        self._button.disabled = self._controller.is_ending
        self._words.content = indented(self._controller.last_output())

    def _toggle(self) -> None:
        controller = self._controller
        if controller.runs:
            controller.end()
            self._panel.show_result(True, controller.name, 'is ending')
            return
        try:
            controller.start(self._choice.value, self._speed_share())
        except (ValueError, RuntimeError, OSError) as error:
            self._panel.show_result(False, 'not started:', str(error))
        else:
            self._panel.show_result(True, controller.name, 'is starting')

    def _go(self) -> None:
        goal = [slider.value for slider in self._sliders]
        low, high = self._limits.T
        if not (np.all(np.isfinite(goal)) and np.all(goal >= low) and np.all(goal <= high)):
            done, text = False, 'a slider is outside the position limits of its joint'
        elif self._posture is None:
            done, text = False, 'no joint angles received yet: start a bridge'
        else:
            done, text = self._motion.go(self._posture, goal, self._speed_share())
        self._panel.show_result(done, 'Move' if done else 'not sent:', text)

    def _take_posture(self) -> None:
        if self._posture is None:
            return
        for slider, angle, (low, high) in zip(
            self._sliders, self._posture.tolist(), self._limits, strict=True
        ):
            slider.value = float(np.clip(angle, low, high))  # type: ignore[misc]

    def _speed_share(self) -> float:
        share = float(self._share.value)
        return float(np.clip(share, 0.05, 1.0)) if np.isfinite(share) else 0.05
