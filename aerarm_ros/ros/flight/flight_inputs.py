"""Decoding of a flight controller's messages: set points, trajectories and the arm's load."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
from geometry_msgs.msg import InertiaStamped, PoseStamped, WrenchStamped
from rclpy.node import Node
from trajectory_msgs.msg import MultiDOFJointTrajectory

from aerarm_msgs_py import topics
from aerarm_ros.control.base.base_motion import rotation_matrix
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import HOLD, ArmFeedForward, FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightPath, FlightTarget, yaw_of
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.messages import inertia_tensor, quaternion, seconds, vector, wrench
from aerarm_ros.ros.parameters.shared_parameters import load_arm, load_drone
from aerarm_ros.ros.states.arm_clock import ArmClock


def load_flown_drone(values: SimpleNamespace) -> tuple[ArmConfig, DroneConfig, MassProperties]:
    """Return the arm, the drone and their common mass properties in the home configuration.

    Parameters
    ----------
    values
        Values of `ARM_FILES` and `DRONE_FILE`.

    Raises
    ------
    ValueError
        If no drone is named, or a file cannot be used.
    """
    config, robot = load_arm(values)
    drone = load_drone(values, config, robot)
    if drone is None:
        raise ValueError(
            'parameter drone_file is empty: name the drone, for example config/drone.yaml'
        )
    arm = MovingBaseDynamics(robot).composite_inertia(np.array(config.rest_position))
    return config, drone, MassProperties.of(drone, *arm)


class ArmTopics:
    """Pass the arm's load from the node `base_reaction` to the flight controller's feedforward.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    arm
        Feedforward that receives the messages.
    act
        Runs an action in the loop's thread; the action may reject its input.
    """

    def __init__(
        self, node: Node, arm: ArmFeedForward, act: Callable[[Callable[[], None]], None]
    ) -> None:
        self._arm = arm
        self._act = act
        topics.ARM_INERTIA.subscription(node, self._on_inertia)
        topics.MOTION_WRENCH.subscription(node, partial(self._on_wrench, arm.offer_motion))
        topics.PLANNED_CONTACT.subscription(node, partial(self._on_wrench, arm.offer_contact))

    def _on_inertia(self, message: InertiaStamped) -> None:
        stamp, body = seconds(message.header.stamp), message.inertia
        com, inertia = vector(body.com), inertia_tensor(message)
        self._act(partial(self._arm.offer_inertia, stamp, body.m, com, inertia))

    def _on_wrench(self, offer: Callable[[float, Array], None], message: WrenchStamped) -> None:
        self._act(partial(offer, seconds(message.header.stamp), wrench(message)))


# [s] tolerated offset between the arm's time and this computer's, with preview and transport
_CLOCK_TOLERANCE = 0.2


class ClockedArm:
    """Feedforward of the arm for nodes that send set points, at present on the arm's clock.

    The arm's time is that of `joint_states`, or of this computer's clock if no joint states arrive.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    lead
        Delay from sending a set point to its effect [s].
    reject
        Called with the reason why a message of `base_reaction` is rejected.

    Attributes
    ----------
    clock
        Clock of the arm.
    """

    def __init__(
        self,
        node: Node,
        drone: DroneConfig,
        body: MassProperties,
        lead: float,
        reject: Callable[[str], None],
    ) -> None:
        self.clock = ArmClock(node)
        self._arm = ArmFeedForward(drone, body, lead=lead)
        self._reject = reject
        # Largest advance of the arm's time since the last report [s]; a late message decreases it.
        # None without a message.
        self._ahead: float | None = None
        ArmTopics(node, self._arm, self._offer)

    def now(self) -> FeedForward:
        """Return the feedforward for a set point that is sent now."""
        return self._arm.at(1e-9 * self.clock.now_ns())

    def set_lead(self, lead: float) -> None:
        """Set the delay from sending a set point to its effect [s]."""
        self._arm.lead = lead

    def problem(self) -> str:
        """Return why the forecasts since the last call are unusable, or an empty string."""
        ahead, self._ahead = self._ahead, None
        return '' if ahead is None else _time_problem(ahead, self._arm.lead)

    def _offer(self, action: Callable[[], None]) -> None:
        before = self._arm.newest
        try:
            action()
        except RejectedInputError as error:
            self._reject(str(error))
        newest = self._arm.newest
        if newest is not None and newest != before:
            ahead = newest - 1e-9 * self.clock.now_ns()
            self._ahead = ahead if self._ahead is None else max(self._ahead, ahead)


def _time_problem(ahead: float, lead: float) -> str:
    """Return why a forecast that ends `ahead` [s] from now is unusable, or an empty string.

    `lead` is the delay [s] that the forecast must cover.
    """
    if -_CLOCK_TOLERANCE <= ahead < lead - HOLD:
        return (
            f"the arm's forecast is {lead - ahead:.2f} s too short, so the node adds no "
            'acceleration: set the parameter lead of base_reaction above feed_lead, and run '
            'fake_hardware with -p pace:=real_time'
        )
    if abs(ahead) <= _CLOCK_TOLERANCE:
        return ''
    return (
        f"the arm's time is {abs(ahead):.1f} s {'ahead of' if ahead > 0.0 else 'behind'} this "
        "computer's clock, so the node adds no acceleration. Start fake_hardware with -p "
        'pace:=real_time, or synchronize the clocks of a real arm (chrony, PTP)'
    )


_LATEST, _EARLIEST = 1.0, 60.0  # [s] from now, bounds of a trajectory's start


class FlightTargets:
    """Target of the drone: the newest set point, or the present point of the newest trajectory.

    All times are those of one clock [s].

    Attributes
    ----------
    target
        Last target, None before the first.
    is_path
        Whether the target moves along a trajectory.
    """

    def __init__(self) -> None:
        self.target: FlightTarget | None = None
        self._path: tuple[float, FlightPath] | None = None

    @property
    def is_path(self) -> bool:
        """Whether the target moves along a trajectory."""
        return self._path is not None

    def hold(self, target: FlightTarget | None) -> None:
        """Set a constant target, and end a trajectory."""
        self.target, self._path = target, None

    def go_along(
        self, message: MultiDOFJointTrajectory, frame: str, start: FlightTarget | None,
        now: float, stamp_now: float,
    ) -> None:  # fmt: skip
        """Set a trajectory that begins at `start`; raises RejectedInputError.

        `stamp_now` is the present time of the clock of the message's stamp.
        """
        if start is None:
            raise RejectedInputError(
                'flight_trajectory rejected, because the position of the drone is unknown: check '
                "the odometry topic or the autopilot's position estimate, then send the trajectory "
                'again'
            )
        stamp = seconds(message.header.stamp)
        delay = stamp - stamp_now if stamp else 0.0
        if not -_LATEST < delay < _EARLIEST:
            raise RejectedInputError(
                f'flight_trajectory rejected, because its stamp is {delay:+.1f} s from now '
                f'(accepted: {-_LATEST:g} to {_EARLIEST:g} s): set the stamp to zero ("now"), or '
                'synchronize the clocks'
            )
        self._path = now + delay, to_path(message, frame, start)

    def at(self, now: float) -> FlightTarget | None:
        """Return the target at a time [s], None before the first."""
        if self._path is not None:
            self.target = self._path[1].at(now - self._path[0])
        return self.target


def to_target(message: PoseStamped, frame: str) -> FlightTarget:
    """Return the flight target of a set point in frame `frame`; raises RejectedInputError."""
    _require_frame('flight_set_point', message.header.frame_id, frame)
    place, turn = vector(message.pose.position), quaternion(message.pose.orientation)
    if not np.all(np.isfinite(place)):
        raise RejectedInputError(
            'flight_set_point rejected: its position is NaN or infinite; check its publisher'
        )
    return FlightTarget(place, _yaw('flight_set_point', turn))


def to_path(message: MultiDOFJointTrajectory, frame: str, start: FlightTarget) -> FlightPath:
    """Return the flight path of a trajectory message; raises RejectedInputError."""
    what, points = 'flight_trajectory', message.points
    _require_frame(what, message.header.frame_id, frame)
    if not points or any(len(point.transforms) != 1 for point in points):
        raise RejectedInputError(
            f'{what} rejected: each point needs the pose of one body (the drone)'
        )
    poses = [point.transforms[0] for point in points]
    return FlightPath(
        [seconds(point.time_from_start) for point in points],
        [vector(pose.translation) for pose in poses],
        [_yaw(what, quaternion(pose.rotation)) for pose in poses],
        _linear([point.velocities for point in points]),
        _linear([point.accelerations for point in points]),
        start,
    )


def _linear(rows: list[Any]) -> list[Array] | None:
    """Return the linear part of each point's twist, None if no point has a twist."""
    if not any(len(row) for row in rows):
        return None
    return [vector(row[0].linear) if len(row) else np.full(3, np.nan) for row in rows]


def _require_frame(what: str, given: str, frame: str) -> None:
    if given not in ('', frame):
        raise RejectedInputError(
            f'{what} rejected, because its frame is {given!r}: send it in the frame of '
            f'the odometry, {frame!r}'
        )


def _yaw(what: str, turn: Array) -> float:
    if not np.all(np.isfinite(turn)) or not 0.9 < np.linalg.norm(turn) < 1.1:
        raise RejectedInputError(
            f'{what} rejected: a value is NaN or infinite, or the quaternion is not a unit '
            'quaternion; check its publisher'
        )
    return yaw_of(rotation_matrix(turn / np.linalg.norm(turn)))
