"""Fly the drone that carries the arm, by odometry and IMU, and compensate the arm's motion.

The node replaces an autopilot in emulation and on test benches. Set points arrive on
flight_set_point or flight_trajectory. Without set points the drone hovers at the position of the
first odometry message. The node feeds forward arm_inertia and base_wrench_motion from the node
base_reaction.
"""

import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from trajectory_msgs.msg import MultiDOFJointTrajectory

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.autopilot.firmware_flight import FirmwareFlight
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.flight.flight_estimator import FlightEstimator
from aerarm_ros.flight.flight_state import FlightTarget, OdometrySample
from aerarm_ros.ros.diagnostics import PERIOD, DiagnosticsPublisher, Rejections
from aerarm_ros.ros.executors import BackgroundExecutor, create_steady_timer
from aerarm_ros.ros.flight.flight_inputs import (
    ArmTopics,
    FlightTargets,
    load_flown_drone,
    to_target,
)
from aerarm_ros.ros.flight.flight_parameters import (
    FLIGHT_PARAMETERS,
    arm_feed_forward,
    flight_control,
)
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import (
    ARM_FILES,
    DRONE_FILE,
    REAL_TIME_PARAMETERS,
    prepare_thread,
)
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.process_end import StopSignals, print_answer
from aerarm_ros.ros.states.flight_stream import FlightStream

NAME = 'flight_control'
_WAIT = 0.1  # [s]
_NAP = 1e-3  # [s]
_STEP_MAX = 0.05  # [s] longest interval over which an integral grows in one step
_PUBLISHED = 5e-3  # [s] between two forecasts of base_reaction

PARAMETERS = ParameterTable(*ARM_FILES, DRONE_FILE, *FLIGHT_PARAMETERS, *REAL_TIME_PARAMETERS)


class FlightControlNode:
    """Node that answers every odometry message with the thrust of each rotor.

    Without odometry the node levels the drone by the IMU's attitude, and the drone sinks slowly.
    Without odometry and IMU the node sends no command, so the rotors stop. After a permanent jump
    of the odometry the drone hovers at its present position, because older set points refer to the
    frame before the jump.

    Attributes
    ----------
    parameters
        Parameters of the node.
    make_law
        Function that returns the control law for parameters, drone and mass properties.
    """

    parameters = PARAMETERS
    make_law = staticmethod(flight_control)

    def __init__(self) -> None:
        self.status = 0
        self.node = rclpy.create_node(NAME)
        self.values = values = self.parameters.declare(self.node, self._on_parameter)
        config, drone, body = load_flown_drone(values)
        self._law = self.make_law(values, drone, body)
        self._arm = arm_feed_forward(values, drone, body)
        self._estimator = FlightEstimator(drone)
        self._thrust_max = drone.column('thrust_max')
        self._cdr = JointStateCdr(drone.rotor_names)
        self._targets = FlightTargets()
        self._jumps = 0
        self._time = 0.0
        self._doing = 'waiting for odometry'
        self._thrust = np.zeros(drone.n)
        self._error = np.zeros(3)
        self._answers = self._late = 0
        self._reported = 0, 0  # commands and late forecasts at the last report
        self._waits_for_arm = True
        self._rejections = Rejections(self.node)
        self._requests: deque[Callable[[], None]] = deque()
        self._stopping = False
        self._stream = FlightStream(self.node, self._rejections.add)
        self._publisher = topics.ROTOR_COMMAND.publisher(self.node)
        topics.FLIGHT_SET_POINT.subscription(self.node, self._on_set_point)
        topics.FLIGHT_TRAJECTORY.subscription(self.node, self._on_trajectory)
        ArmTopics(self.node, self._arm, self._requests.append)
        self._diagnostics = DiagnosticsPublisher(self.node, config.name)
        create_steady_timer(self.node, PERIOD, self._report)

    def run(self) -> None:
        """Control the drone until SIGINT, SIGTERM, SIGHUP or a shutdown."""
        with StopSignals(self._on_stop), BackgroundExecutor(self.node):
            prepare_thread(self.values, self.node.get_logger())
            while not self._stopping and rclpy.ok():
                if self._is_settling():
                    continue
                if self._stream.wait(_WAIT):
                    self._take()
                else:
                    self._note_silence()
        print_answer(
            f'{NAME}: {self._answers} commands sent, {self._rejections.count} inputs rejected'
        )

    def close(self) -> None:
        """Destroy the node."""
        self._stream.destroy()
        self.node.destroy_node()

    def _is_settling(self) -> bool:
        """Advance the start of the autopilot firmware; return whether the start is unfinished."""
        law = self._law
        if not isinstance(law, FirmwareFlight) or not law.is_settling:
            return False
        law.settle()
        self._doing = law.problem
        return True

    def _take(self) -> None:
        samples, odometry = self._stream.imu_samples(), self._stream.newest_odometry()
        for sample in samples:
            self._try(partial(self._estimator.offer_imu, sample))
        if odometry is not None:
            self._take_odometry(*odometry)
        elif self._targets.target is not None and 'odometry' in self._estimator.missing():
            self._fly(round((self._estimator.stamp or 0.0) * 1e9))

    def _take_odometry(self, stamp_ns: int, sample: OdometrySample | None) -> None:
        if self._stream.answers.again():
            return
        if sample is not None and not self._stream.answers.is_resent:
            self._try(partial(self._estimator.offer_odometry, sample))
        self._take_requests()
        self._wait_for_arm()
        self._fly(stamp_ns)

    def _wait_for_arm(self) -> None:
        """Wait for a late arm forecast; after a time-out, do not wait until one is on time."""
        if not self._is_forecast_late():
            self._waits_for_arm = True
            return
        deadline = time.monotonic() + (self.values.arm_wait if self._waits_for_arm else 0.0)
        while time.monotonic() < deadline and not self._stopping:
            time.sleep(_NAP)
            self._take_requests()
            if not self._is_forecast_late():
                return
        self._waits_for_arm = False
        self._late += 1

    def _take_requests(self) -> None:
        while self._requests:
            self._try(self._requests.popleft())

    def _is_forecast_late(self) -> bool:
        """Return whether the forecast of the arm's motion is late."""
        now = self._estimator.stamp
        return now is not None and self._arm.is_late(now)

    def _fly(self, stamp_ns: int) -> None:
        """Send the rotor command that answers the odometry stamped `stamp_ns` [ns]."""
        now = self._estimator.stamp
        if now is None:
            return
        dt, self._time = min(max(now - self._time, 0.0), _STEP_MAX), now
        state = self._estimator.state()
        if state is not None:
            target = self._targets.at(now)
            if target is None or self._estimator.jumps != self._jumps:
                self._jumps = self._estimator.jumps
                target = FlightTarget.here(state)
                self._targets.hold(target)
            self._error = target.position - state.position
            self._thrust = self._law.update(state, target, dt, self._arm.at(now))
            self._doing = ''
        elif self._targets.target is not None and (attitude := self._estimator.attitude_alone()):
            self._thrust = self._law.level(attitude, dt)
            self._doing = (
                'odometry is missing, so the node only keeps the drone level by the IMU, and the '
                'drone sinks: check the odometry topic'
            )
        else:
            self._note_silence()
            return
        if self._law.problem:
            self._doing = self._law.problem
            return
        answer = self._cdr.pack(stamp_ns, effort=self._thrust)
        self._stream.answers.publish(self._publisher, answer)
        self._answers += 1

    def _note_silence(self) -> None:
        if self._targets.target is not None:
            self._doing = (
                'neither odometry nor IMU data arrive, so the rotors stop: check both topics'
            )

    # Callbacks.

    def _on_set_point(self, message: PoseStamped) -> None:
        self._requests.append(lambda: self._targets.hold(to_target(message, self._stream.frame)))

    def _on_trajectory(self, message: MultiDOFJointTrajectory) -> None:
        self._requests.append(
            lambda: self._targets.go_along(
                message, self._stream.frame, self._targets.target, self._time, self._time
            )
        )

    def _on_parameter(self, name: str, value: Any) -> None:
        attribute = {'feed_posture': 'use_posture', 'feed_motion': 'use_motion'}.get(name, 'lead')
        self._requests.append(lambda: setattr(self._arm, attribute, value))

    def _report(self) -> None:
        missing = self._estimator.missing()
        forecast_problem = self._forecast_problem()
        problem = self._doing or self._rejections.recent
        if not problem and missing:
            problem = f'{" and ".join(missing)} silent'
        problem = problem or forecast_problem
        values: dict[str, object] = {
            'commands': self._answers,
            'rejected inputs': self._rejections.count,
            'late arm forecasts': self._late,
            'position error [m]': f'{np.linalg.norm(self._error):.3f}',
            'largest thrust [%]': f'{100.0 * (self._thrust / self._thrust_max).max():.0f}',
        }
        self._diagnostics.report(problem, values)

    def _forecast_problem(self) -> str:
        """Return why most arm forecasts since the last report were unusable, or an empty string."""
        answers, late = self._reported
        self._reported = self._answers, self._late
        if not self._late - late > 0.5 * (self._answers - answers):
            return ''
        return (
            'forecasts of the arm motion are late or missing, so the drone compensates this motion '
            'late or not at all: check base_reaction, and set its parameter lead to '
            f'{self._arm.preview + _PUBLISHED:.3f} s or more'
        )

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except RejectedInputError as error:
            self._rejections.add(str(error))

    def _on_stop(self) -> None:
        self._stopping = True


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, FlightControlNode, args, PARAMETERS, __doc__)
