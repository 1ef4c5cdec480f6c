"""Forward set points to an autopilot over MAVLink, with feedforward of the arm's motion.

The node is for vehicles without MAVROS and without a DDS agent. Set points arrive repeatedly on
flight_set_point, or once on flight_trajectory. The node publishes the autopilot's odometry, imu and
rotor_command for the arm. Only the services ~/arm, ~/disarm and ~/offboard arm the autopilot or
change its mode; for ArduCopter, ~/offboard requests the guided mode.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.autopilot.ardupilot import ArduPilotSetPoints, motors_of
from aerarm_ros.autopilot.mavlink import Message
from aerarm_ros.autopilot.mavlink_autopilot import ARDUPILOT, MavlinkAutopilot
from aerarm_ros.autopilot.mavlink_line import open_line
from aerarm_ros.autopilot.px4 import Px4Gains, Px4SetPoints, torque_unit
from aerarm_ros.control.base.base_motion import quaternion
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.drone_urdf import BODY_LINK, IMU_LINK
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.ros.diagnostics import PERIOD, DiagnosticsPublisher, Rejections
from aerarm_ros.ros.executors import create_steady_timer
from aerarm_ros.ros.flight.flight_inputs import (
    ClockedArm,
    FlightTargets,
    load_flown_drone,
    to_target,
)
from aerarm_ros.ros.flight.set_point_node import (
    FEED_PARAMETERS,
    FIRMWARE_PARAMETERS,
    LOOP_PARAMETERS,
    ardupilot_loop,
    ardupilot_moment_unit,
    set_point_acceleration,
)
from aerarm_ros.ros.messages import imu_message, odometry_message
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES, DRONE_FILE
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.process_end import StopSignals
from aerarm_ros.ros.states.state_stream import base_header

NAME = 'mavlink_feedforward'
_LISTEN = 0.002  # [s] longest wait for data on the MAVLink line
_REPLY = 2.0  # [s] for which a service waits for the autopilot's answer
_WORLD = 'odom'
_OUTPUTS = 'ACTUATOR_OUTPUT_STATUS', 'SERVO_OUTPUT_RAW'

PARAMETERS = ParameterTable(
    *ARM_FILES,
    DRONE_FILE,
    *grouped(
        'The autopilot',
        Parameter('connection', 'udp:14540', 'connection to the autopilot: udp:PORT (listen on '
                                             'this computer), udp:0.0.0.0:PORT (listen on all '
                                             'networks), udp:HOST:PORT (send first) or '
                                             'serial:DEVICE:BAUD'),
        Parameter('imu_rate', 200.0,
            'rate at which the node requests HIGHRES_IMU messages from the autopilot; 0 for '
            'none', 'Hz', 0.0, 1000.0),
        Parameter('state_rate', 100.0,
            'rate at which the node requests attitude and position messages from the autopilot',
            'Hz', 10.0, 500.0),
        Parameter('output_rate', 100.0,
            'rate of motor output messages that the node requests (ACTUATOR_OUTPUT_STATUS, from '
            'ArduPilot SERVO_OUTPUT_RAW) for rotor_command; 0 for none', 'Hz', 0.0, 500.0),
        Parameter('output_range', [1000.0, 2000.0],
            'output values of the autopilot at which a rotor stops and at which it gives '
            'thrust_max. The thrust must rise linearly between them: set THR_MDL_FAC (PX4) or '
            'MOT_THST_EXPO (ArduPilot) to 0', '', 0.0, 20000.0),
        Parameter('output_channels', [],
            'number of the autopilot output (from 1) of each rotor, in the order of the drone '
            "file. If empty: the first outputs of PX4, or those of ArduPilot's motors for this "
            'frame', '', 1, 32, element=int),
    ),
    *FIRMWARE_PARAMETERS,
    *grouped(
        'Set points',
        Parameter('rate', 100.0, 'rate of set points', 'Hz', 10.0, 500.0),
        Parameter('set_point_timeout', 0.5, 'age above which the node no longer sends a set '
                                            'point, so that the autopilot detects the missing '
                                            'set points; 0: no limit', 's',
                  0.0, 60.0),
        Parameter('hold_heading', True, 'whether set points contain the heading; if false, the '
                                        'autopilot does not control the heading'),
    ),
    *FEED_PARAMETERS,
    *LOOP_PARAMETERS,
    Parameter('yaw_gain', round(Px4Gains.mc_yaw_p * Px4Gains.mc_yawrate_p, 6),
        'normalized torque per heading error of PX4 (MC_YAW_P times MC_YAWRATE_P), for drones with '
        'tilted rotors', '1/rad', 0.0, 50.0, group=LOOP_PARAMETERS[0].group),
)  # fmt: skip


class MavlinkFeedforward:
    """Node that forwards set points to an autopilot over a MAVLink connection.

    Raises
    ------
    ValueError
        If the connection cannot be opened, drone_file is empty, or output_channels is invalid.
    """

    def __init__(self) -> None:
        self.status = 0
        self.node = rclpy.create_node(NAME)
        self.values = values = PARAMETERS.declare(self.node, self._on_parameter)
        config, drone, body = load_flown_drone(values)
        self._channels = _channels(values, drone)
        self._line = open_line(values.connection)
        rates = {'attitude': values.state_rate, 'place': values.state_rate,
                 'imu': values.imu_rate, 'outputs': values.output_rate}  # fmt: skip
        self._autopilot = MavlinkAutopilot(self._line, rates)
        self._rejections = Rejections(self.node)
        self._arm = ClockedArm(self.node, drone, body, values.feed_lead, self._rejections.add)
        self._set_points = self._create_set_points(drone)
        self._thrust_max = drone.column('thrust_max')
        self._cdr = JointStateCdr(drone.rotor_names)
        self._targets = FlightTargets()
        self._target_time = -np.inf
        self._logged = ''
        self._sent = 0
        self._answered: Future | None = None  # of the request that waits for the autopilot
        self._answer_by = np.inf
        self._is_stopping = False
        self._last = time.monotonic()
        self._make_topics()
        self._diagnostics = DiagnosticsPublisher(self.node, config.name)
        create_steady_timer(self.node, 1.0 / values.rate, self._send)
        create_steady_timer(self.node, PERIOD, self._report)

    def _make_topics(self) -> None:
        node = self.node
        for topic, take in (
            (topics.FLIGHT_SET_POINT, self._on_set_point),
            (topics.FLIGHT_TRAJECTORY, self._on_trajectory),
        ):
            topic.subscription(node, take)
        self._odometry, self._imu, self._rotors = (
            topic.publisher(node) for topic in (topics.ODOMETRY, topics.IMU, topics.ROTOR_COMMAND)
        )
        group = MutuallyExclusiveCallbackGroup()
        for name in ('arm', 'disarm', 'offboard'):
            act = partial(self._on_request, getattr(self._autopilot, name))
            node.create_service(Trigger, f'~/{name}', act, callback_group=group)

    def _create_set_points(self, drone: DroneConfig) -> Px4SetPoints | ArduPilotSetPoints:
        values = self.values
        if values.firmware == ARDUPILOT:
            unit = ardupilot_moment_unit(drone, self.node.get_logger().warning)
            acceleration = set_point_acceleration(values, unit)
            return ArduPilotSetPoints(ardupilot_loop(values), acceleration, values.hold_heading)
        tilts = values.attitude_gain > 0.0
        torque = torque_unit(drone) if tilts else np.zeros(3)
        yaw_gain = values.yaw_gain * float(torque[2])
        acceleration = set_point_acceleration(values, float(torque[0]), yaw_gain)
        return Px4SetPoints(drone, None, acceleration, values.hold_heading)

    def run(self) -> None:
        """Forward set points until a signal (SIGINT, SIGTERM, SIGHUP) or a shutdown."""
        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        with StopSignals(self._on_stop):
            while not self._is_stopping and rclpy.ok():
                self._listen(_LISTEN)
                executor.spin_once(timeout_sec=0.0)

    def close(self) -> None:
        """Destroy the node and close the MAVLink connection."""
        self.node.destroy_node()
        self._line.close()

    def _listen(self, patience: float) -> None:
        """Receive messages from the autopilot, and publish their contents as ROS messages."""
        try:
            messages = self._line.messages(patience)
        except OSError as error:
            raise ValueError(
                f'the connection {self.values.connection!r} to the autopilot failed '
                f'({error.strerror}): check that the device is plugged in'
            ) from None
        now = time.monotonic()
        for message in messages:
            if self._autopilot.take(message, now):
                self._publish(message, now)
        self._autopilot.tick(now)
        if self._answered is not None and (self._autopilot.reply or now > self._answer_by):
            self._answered.set_result(None)

    def _publish(self, message: Message, now: float) -> None:
        stamp_ns = self._arm.clock.now_ns()
        if message.name == 'LOCAL_POSITION_NED' and (state := self._autopilot.state(now)):
            pose = state.position, quaternion(state.rotation)
            twist = state.rotation.T @ state.velocity, state.rate
            header = base_header(stamp_ns, _WORLD)
            self._odometry.publish(odometry_message(header, BODY_LINK, *pose, *twist))
        elif message.name == 'HIGHRES_IMU' and (reading := self._autopilot.imu):
            attitude = self._autopilot.attitude if self._autopilot.has_attitude(now) else None
            self._imu.publish(imu_message(base_header(stamp_ns, IMU_LINK), attitude, *reading))
        elif message.name in _OUTPUTS and self._autopilot.outputs is not None:
            low, high = self.values.output_range
            shares = (self._autopilot.outputs[self._channels] - low) / (high - low)
            thrust = np.clip(shares, 0.0, 1.0) * self._thrust_max
            self._rotors.publish(self._cdr.pack(stamp_ns, effort=thrust))

    def _send(self) -> None:
        now = time.monotonic()
        dt, self._last = now - self._last, now
        arm = self._arm.now()
        state, target = self._autopilot.state(now), self._wanted(now)
        if target is None or self._link_problem(now):
            self._set_points.reset()
            # A path must not go on while the autopilot does not follow it.
            self._targets.hold(self._targets.target)
            return
        if state is None:  # Without the vehicle's axes the arm's feedforward cannot be added.
            state = FlightState(np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3))
            arm = FeedForward.at_rest(arm.body)
            if self._set_points.needs_state:
                return
        name, values = self._set_points.message(state, target, dt, arm)
        self._autopilot.set_point(name, now, **values)
        self._sent += 1

    def _link_problem(self, now: float) -> str:
        """Return why the node must not send set points to the autopilot, or an empty string."""
        found, wanted = self._autopilot.firmware, self.values.firmware
        if not self._autopilot.is_linked(now):
            return (
                f'no heartbeat from the autopilot on {self.values.connection}: check the connection'
            )
        if found != wanted:
            return (
                f'the autopilot reports the firmware {found}, but the parameter firmware is '
                f'{wanted}: correct the parameter'
            )
        return ''

    def _wanted(self, now: float) -> FlightTarget | None:
        """Return the present target of the drone, or None without a valid set point."""
        if self._targets.is_path:
            self._target_time = now  # the drone hovers at its end
        patience = self.values.set_point_timeout
        if patience and now - self._target_time > patience:
            return None
        return self._targets.at(now)

    # Callbacks.

    def _on_set_point(self, message: PoseStamped) -> None:
        def act() -> None:
            self._targets.hold(to_target(message, _WORLD))
            self._target_time = time.monotonic()

        self._try(act)

    def _on_trajectory(self, message: MultiDOFJointTrajectory) -> None:
        now = time.monotonic()
        state = self._autopilot.state(now)
        start, stamp_now = state and FlightTarget.here(state), 1e-9 * self._arm.clock.now_ns()
        self._try(partial(self._targets.go_along, message, _WORLD, start, now, stamp_now))

    async def _on_request(
        self, ask: Callable[[], None], _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        if problem := self._link_problem(time.monotonic()):
            response.message = problem
            return response
        if self._answered is not None:
            response.message = (
                "an earlier request still waits for the autopilot's answer: call again later"
            )
            return response
        ask()
        self._answered, self._answer_by = Future(), time.monotonic() + _REPLY
        await self._answered  # set points continue meanwhile
        self._answered = None
        response.success = self._autopilot.reply == 'accepted'
        response.message = (
            self._autopilot.reply or f'the autopilot did not answer within {_REPLY:g} s'
        )
        if not response.success and self._autopilot.text:
            response.message += f': {self._autopilot.text}'
        return response

    def _on_parameter(self, _: str, value: Any) -> None:
        self._arm.set_lead(value)

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except RejectedInputError as error:
            self._rejections.add(str(error))

    def _problem(self, now: float) -> str:
        """Return the most important problem for /diagnostics, or an empty string."""
        arm_problem = self._arm.problem()
        if problem := self._link_problem(now):
            return problem
        if silent := self._autopilot.silent(now):
            return f'the autopilot does not send {", ".join(silent)}'
        if recent := self._rejections.recent:
            return recent
        if self._wanted(now) is None:
            return 'no set points received, so the node sends none to the autopilot'
        return arm_problem

    def _report(self) -> None:
        now, autopilot = time.monotonic(), self._autopilot
        problem = self._link_problem(now)
        if problem != self._logged:
            self._logged = problem
            log = self.node.get_logger()
            if problem:
                log.warning(problem)
            else:
                log.info(f'connected to {autopilot.firmware}, mode {autopilot.mode}')
        values: dict[str, object] = {
            'armed': autopilot.is_armed,
            'mode': autopilot.mode,
            'sent': self._sent,
            'damaged frames': self._line.damaged,
            'rejected inputs': self._rejections.count,
            "autopilot's last warning": autopilot.text,
        }
        self._diagnostics.report(self._problem(now), values)

    def _on_stop(self) -> None:
        self._is_stopping = True


def _channels(values: Any, drone: DroneConfig) -> list[int]:
    """Return the autopilot output index of each rotor; raise ValueError for invalid parameters."""
    given, count = list(values.output_channels), drone.n
    most = 16 if values.firmware == ARDUPILOT else 32
    if not given and values.firmware == ARDUPILOT and values.output_rate > 0.0:
        try:
            given = (np.argsort(motors_of(drone)) + 1).tolist()
        except ValueError as error:
            raise ValueError(f'{error}, or set output_channels') from None
    given = given or list(range(1, count + 1))
    low, high = [*values.output_range, 0.0, 0.0][:2]
    is_known = len(set(given)) == len(given) == count and all(0 < x <= most for x in given)
    if not is_known or len(values.output_range) != 2 or not high > low:
        raise ValueError(
            f'output_channels is {given} and output_range {list(values.output_range)}: set '
            f'{count} different numbers from 1 to {most}, one per rotor, and two increasing numbers'
        )
    return [channel - 1 for channel in given]


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, MavlinkFeedforward, args, PARAMETERS, __doc__)
