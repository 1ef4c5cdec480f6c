"""Base class of nodes that add accelerations for the arm's motion to an autopilot's set points."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import numpy as np
import rclpy
from rclpy.qos import qos_profile_sensor_data

from aerarm_ros.autopilot.ardupilot import ArduPilotLoop, moment_unit
from aerarm_ros.autopilot.mavlink_autopilot import ARDUPILOT, PX4
from aerarm_ros.autopilot.px4 import Px4Gains, torque_unit
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.control.base.base_motion import rotation_matrix
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.diagnostics import PERIOD, DiagnosticsPublisher, Rejections
from aerarm_ros.ros.executors import create_steady_timer, run_until_stopped
from aerarm_ros.ros.flight.flight_inputs import ClockedArm, load_flown_drone
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES, DRONE_FILE

_ATTITUDE_AGE = 0.2  # [s]


FEED_PARAMETERS = (
    Parameter('feed_lead', 0.03, 'delay from sending a set point to its effect on the drone; '
                                 'the preview time `lead` of base_reaction must be at least as '
                                 'large', 's', 0.0, 0.06,
              live=True),
)  # fmt: skip
LOOP_PARAMETERS = grouped(
    "The autopilot's loops, for the anticipatory tilt",
    Parameter('attitude_gain', Px4Gains.mc_att_p,
        "autopilot's gain from attitude error to angular velocity (PX4: MC_ROLL_P, whose "
        'default this is; ArduPilot: ATC_ANG_RLL_P); 0: no anticipatory tilt', '1/s', 0.0, 50.0),
    Parameter('rate_gain', Px4Gains.mc_rate_k * Px4Gains.mc_rate_p,
        "autopilot's gain from angular velocity error to normalised torque (PX4: MC_ROLLRATE_K "
        'times MC_ROLLRATE_P; ArduPilot: ATC_RAT_RLL_P). drone_file defines the unit of '
        "torque; 0 ignores the arm's inertia and moment",
        's/rad', 0.0, 10.0),
    Parameter('integral_rate', Px4Gains.mc_rate_i / Px4Gains.mc_rate_p,
        "autopilot's integral gain divided by its proportional gain in rate control (PX4: "
        'MC_ROLLRATE_I / MC_ROLLRATE_P; ArduPilot: ATC_RAT_RLL_I / ATC_RAT_RLL_P)',
        '1/s', 0.0, 50.0),
)  # fmt: skip
FIRMWARE_PARAMETERS = (
    Parameter('firmware', PX4, 'firmware of the autopilot; the set points follow the rules of '
                               'this firmware',
              choices=(PX4, ARDUPILOT)),
    *grouped(
        "ArduCopter's position loop",
        Parameter('position_p', ArduPilotLoop.position_p, 'PSC_POSXY_P', '1/s', 0.0, 20.0),
        Parameter('velocity_p', ArduPilotLoop.velocity_p, 'PSC_VELXY_P', '1/s', 0.0, 20.0),
        Parameter('velocity_i', ArduPilotLoop.velocity_i, 'PSC_VELXY_I', '1/s^2', 0.0, 20.0),
    ),
)  # fmt: skip


def ardupilot_loop(values: SimpleNamespace) -> ArduPilotLoop:
    """Return ArduCopter's position loop with the gains in the values of `FIRMWARE_PARAMETERS`."""
    return ArduPilotLoop(values.position_p, values.velocity_p, values.velocity_i)


def ardupilot_moment_unit(drone: DroneConfig, warn: Callable[[str], object]) -> float:
    """Return ArduCopter's unit of moment [Nm]; warn and return 0 if it has no matching frame."""
    try:
        return moment_unit(drone)
    except ValueError as error:
        warn(f'the anticipatory tilt ignores inertia and moment: {error}')
        return 0.0


def set_point_acceleration(
    values: SimpleNamespace, torque: float, yaw_gain: float = 0.0
) -> SetPointAcceleration:
    """Return the calculator of set point accelerations for the values of `LOOP_PARAMETERS`.

    `torque` is the autopilot's unit of torque [Nm], 0 if unknown. `yaw_gain` has the same meaning
    as in `SetPointAcceleration`.
    """
    return SetPointAcceleration(
        values.attitude_gain, values.rate_gain * torque, values.integral_rate, yaw_gain
    )


def set_point_parameters(
    set_points: str, output: str, attitude: str, *others: Parameter
) -> ParameterTable:
    """Return the parameters of a set point node with the given default topics, and `others`."""
    return ParameterTable(
        *ARM_FILES,
        DRONE_FILE,
        Parameter('set_point_topic', set_points, 'input topic of set points'),
        Parameter('output_topic', output, 'output topic of set points with the added acceleration'),
        Parameter('attitude_topic', attitude, "topic of the drone's attitude"),
        *others,
        Parameter('rate', 100.0, 'rate at which the node re-sends the newest set point',
        'Hz', 10.0, 500.0),
        Parameter('set_point_timeout', 0.5, 'age above which the node no longer re-sends a set '
                                            'point, so that the autopilot detects the missing '
                                            'set points', 's', 0.05, 10.0),
        *FEED_PARAMETERS,
        *LOOP_PARAMETERS,
    )  # fmt: skip


class SetPointNode:
    """Republish set points with the acceleration for the arm's motion, until they are too old.

    If no attitude arrives for 0.2 s, or the arm's forecast is missing, the node republishes set
    points unchanged. The arm's time is that of `joint_states`, or of this computer's clock if no
    joint states arrive. The node publishes a warning on /diagnostics if the arm's time is more than
    0.2 s ahead, or too late for an acceleration.

    Parameters
    ----------
    parameters : ParameterTable
        Table of `set_point_parameters`.
    package : str
        ROS package with the messages.
    advice : str
        Recovery hint if the package is missing.

    Raises
    ------
    ValueError
        If the package is not installed, or no drone is given.
    """

    def __init__(self, name: str, parameters: ParameterTable, package: str, advice: str) -> None:
        if find_spec(package) is None:
            raise ValueError(f'{package} is not installed: {advice}')
        self.status = 0
        self.node = rclpy.create_node(name)
        self.values = values = parameters.declare(self.node, self._on_parameter)
        config, drone, body = load_flown_drone(values)
        self._acceleration = set_point_acceleration(values, self.moment_unit(drone))
        self._set_point: Any = None
        self._set_point_time = self._attitude_time = -np.inf
        self._rotation = np.eye(3)
        self._rejections = Rejections(self.node)
        self._sent = 0
        self._added = np.zeros(3)
        self._last = time.monotonic()
        set_point, attitude = self.message_types()
        self._publisher = self.node.create_publisher(set_point, values.output_topic, 1)
        for kind, topic, act in (
            (set_point, values.set_point_topic, self._on_set_point),
            (attitude, values.attitude_topic, self._on_attitude),
        ):
            self.node.create_subscription(kind, topic, act, qos_profile_sensor_data)
        self._arm = ClockedArm(self.node, drone, body, values.feed_lead, self._rejections.add)
        self._diagnostics = DiagnosticsPublisher(self.node, config.name)
        create_steady_timer(self.node, 1.0 / values.rate, self._send)
        create_steady_timer(self.node, PERIOD, self._report)

    # Methods for each autopilot to override.

    def message_types(self) -> tuple[Any, Any]:
        """Return the ROS message types of the autopilot's set points and attitudes."""
        raise NotImplementedError

    def attitude(self, message: Any) -> Array:
        """Return the attitude in a message: quaternion (x, y, z, w) from FLU body to ENU axes."""
        raise NotImplementedError

    def moment_unit(self, drone: DroneConfig) -> float:
        """Return the roll moment [Nm] that the autopilot's normalized torque 1 causes, or 0."""
        return float(torque_unit(drone)[0])

    def publish(self, set_point: Any, now_ns: int) -> None:
        """Publish a set point to the autopilot."""
        self._publisher.publish(set_point)

    def with_acceleration(self, set_point: Any, acceleration: Array, now_ns: int) -> Any:
        """Return a copy of a set point with an added acceleration (3,) [m/s^2], east-north-up.

        Raises RejectedInputError if the set point accepts no acceleration.
        """
        raise NotImplementedError

    def run(self) -> None:
        """Republish set points until a stop signal or a shutdown of the ROS context."""
        run_until_stopped(self.node)

    def close(self) -> None:
        """Destroy the node."""
        self.node.destroy_node()

    def _send(self) -> None:
        now, now_ns = time.monotonic(), self.node.get_clock().now().nanoseconds
        dt, self._last = now - self._last, now
        arm = self._arm.now()
        added = np.zeros(3)
        if now - self._attitude_time < _ATTITUDE_AGE:
            added = self._acceleration.update(arm, self._rotation, dt)
        if now - self._set_point_time > self.values.set_point_timeout:
            return
        try:
            self.publish(self.with_acceleration(self._set_point, added, now_ns), now_ns)
        except RejectedInputError as error:
            self._rejections.add(str(error))
            self.publish(self._set_point, now_ns)
        else:
            self._added = added
        self._sent += 1

    def _on_set_point(self, message: Any) -> None:
        self._set_point, self._set_point_time = message, time.monotonic()

    def _on_attitude(self, message: Any) -> None:
        quaternion = self.attitude(message)
        if not 0.9 < float(np.linalg.norm(quaternion)) < 1.1:  # also rejects NaN
            self._rejections.add(
                'attitude rejected: a value is NaN, or the quaternion is not a unit quaternion'
            )
            return
        self._rotation = rotation_matrix(quaternion / np.linalg.norm(quaternion))
        self._attitude_time = time.monotonic()

    def _on_parameter(self, _: str, value: Any) -> None:
        self._arm.set_lead(value)

    def _report(self) -> None:
        now, values = time.monotonic(), self.values
        arm_problem, problem = self._arm.problem(), self._rejections.recent
        if now - self._set_point_time > values.set_point_timeout:
            problem = f'no set points on {values.set_point_topic}, so the node publishes none'
        elif now - self._attitude_time > _ATTITUDE_AGE:
            problem = f'no attitude on {values.attitude_topic}, so the node adds no acceleration'
        elif arm_problem:
            problem = arm_problem
        report = {'sent': self._sent, 'added [m/s^2]': f'{np.linalg.norm(self._added):.2f}'}
        self._diagnostics.report(problem, report)
