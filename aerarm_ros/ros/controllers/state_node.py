"""Base class of controllers and estimators, which process joint states in a loop."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Duration
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_msgs_py.topics import Topic
from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.base.free_base_estimator import FreeBaseEstimator
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.motion.signals import ArmState, JointReference
from aerarm_ros.ros.controllers.controller_parameters import (
    ARM_PARAMETERS,
    LOOP_PARAMETERS,
    PAYLOAD,
    ControlledArm,
    payload_problem,
)
from aerarm_ros.ros.diagnostics import WaitingNotice, rejection
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import prepare_thread
from aerarm_ros.ros.process.process_end import StopSignals, print_answer
from aerarm_ros.ros.states.state_diagnostics import StateDiagnostics
from aerarm_ros.ros.states.state_stream import StateStream, base_header

HORIZON = 0.1
"""Duration of a published plan [s], longer than the 30 ms lag of a drone's rotors and link."""
_POINT_PERIOD = 0.02  # [s] short enough for quintic interpolation between points
_PERIOD_NS = 10_000_000  # [ns] between two plans

_TIMES = np.linspace(0.0, HORIZON, round(HORIZON / _POINT_PERIOD) + 1)
_SECOND = 1_000_000_000


class Attendant:
    """Base class of objects that a controller calls after each command, or instead of one."""

    def update(self) -> None:
        """Do work after the controller has sent a command; called in the loop's thread."""
        raise NotImplementedError

    def give_up(self, reason: str) -> None:
        """React to a joint state that gets no command; called in the loop's thread."""

    def destroy(self) -> None:
        """Destroy entities that do not end with the node; called once, when the node ends."""


class PlanTopic(Attendant):
    """Publish the motion that a controller plans for the next 0.1 s, at 100 Hz.

    The plan does not delay the command, because it is published after the command.

    Parameters
    ----------
    node
        Owner of the publisher.
    joint_names
        Joint names in the order of all arrays.
    stamp_ns
        Returns the stamp of the newest joint state [ns], None before the first.
    ahead
        Returns the references (M, n) at the times (M,) after the newest joint state [s], None if
        the references are unknown.
    """

    def __init__(
        self,
        node: Node,
        joint_names: Sequence[str],
        stamp_ns: Callable[[], int | None],
        ahead: Callable[[NDArray[np.float64]], JointReference | None],
    ) -> None:
        self._stamp_ns = stamp_ns
        self._ahead = ahead
        self._published_ns = -_PERIOD_NS
        self._publisher = topics.PLANNED_MOTION.publisher(node)
        self._message = JointTrajectory(joint_names=list(joint_names))
        self._message.points = [
            JointTrajectoryPoint(time_from_start=Duration(nanosec=round(time * _SECOND)))
            for time in _TIMES.tolist()
        ]

    def update(self) -> None:
        """Publish the plan if one period has passed and the topic has subscribers."""
        stamp_ns = self._stamp_ns()
        if stamp_ns is None or 0 <= stamp_ns - self._published_ns < _PERIOD_NS:
            return
        self._published_ns = stamp_ns
        if not self._publisher.get_subscription_count():
            return  # The computation of a plan takes a tenth of the loop's time.
        plan = self._ahead(_TIMES)
        if plan is None:
            return
        message = self._message
        message.header = base_header(stamp_ns, '')
        for point, q, dq, ddq in zip(message.points, *map(np.ndarray.tolist, plan), strict=True):
            point.positions, point.velocities, point.accelerations = q, dq, ddq
        self._publisher.publish(message)


def state_node_parameters(*parameters: Parameter) -> ParameterTable:
    """Return the given parameters together with the parameters that all state nodes share."""
    return ParameterTable(*ARM_PARAMETERS, *LOOP_PARAMETERS, *parameters)


# [ns] Two joint states with a longer interval between their stamps are not consecutive.
_GAP_NS = 5_000_000


class StateNode:
    """Process joint states in a loop: update the base motion, then call `answer`.

    The loop runs in the thread that calls `run`. An executor in another thread serves topics,
    parameters and diagnostics. This executor queues its inputs, and the loop processes them between
    two joint states. Therefore only the loop's thread uses the ROS-free objects.

    Parameters
    ----------
    name
        Node name.
    parameters
        Parameters of the node, made by `state_node_parameters`.

    Attributes
    ----------
    node, values, arm, base
        The ROS node, the values of its parameters, the arm, and the estimator of the base motion.
    answers
        Messages that the node publishes in answer to joint states.
    state, stamp_ns
        The newest joint state, None before the first, and the stamp of this joint state [ns]. The
        stamps are the node's only clock, because an emulated arm has its own time.
    status
        Exit status after `run`.

    Raises
    ------
    ValueError
        If a parameter or a file cannot be used.
    """

    answers_every_state = True  # False for a node that publishes at another rate
    takes_odometry = False
    states_waiting = 1  # queue length; above 1 the node also processes delayed joint states

    def __init__(self, name: str, parameters: ParameterTable) -> None:
        self.status = 0
        self.state: ArmState | None = None
        self.stamp_ns = 0
        self._state_arrival = 0.0  # arrival of the newest state on the monotonic clock [s]
        self._requests: deque[Callable[[float], None]] = deque()
        self._stopping = False
        self.node = rclpy.create_node(name)
        self.values = parameters.declare(self.node, self._on_parameter, self._parameter_problem)
        self.arm = ControlledArm.from_parameters(self.values)
        self.base = self.arm.base(self.values)
        self.build()
        self._stream = StateStream(
            self.node,
            self.arm.config.joint_names,
            self.reject,
            self._rotor_names(),
            self.states_waiting,
            self.base.uses_imu,
            self.takes_odometry,
            self.answers_every_state,
        )
        self.answers = self._stream.answers
        self.diagnostics = StateDiagnostics(
            self.node,
            self._stream,
            self.warning,
            self.describe,
            self.arm.config.name,
            WaitingNotice(time.monotonic()),
            self.answers_every_state,
        )
        self.connect()

    # Methods for derived nodes to override.

    def build(self) -> None:
        """Create the objects that do not need ROS; raise ValueError for invalid parameters."""

    def connect(self) -> None:
        """Create publishers and subscriptions."""

    def take_imu(self, sample: ImuSample, now: float) -> None:
        """Process an IMU sample that arrived at time `now` [s]; may raise RejectedInputError."""
        self.base.offer(sample, now)

    def take_odometry(self, message: Odometry, now: float) -> None:
        """Process odometry that arrived at time `now` [s]; may raise RejectedInputError."""

    def answer(self, stamp_ns: int, state: ArmState) -> None:
        """Process a joint state; after publishing an answer to it, call `count_answer`."""
        raise NotImplementedError

    def silence(self, silent_for: float) -> float:
        """Handle missing joint states, and return the time until the next call [s].

        Parameters
        ----------
        silent_for
            Time since the newest joint state arrived [s], which exceeds state_timeout.
        """
        return float(self.values.state_timeout)

    def leave(self) -> None:
        """Do the last work before the node ends; the executor still spins."""

    def on_parameter(self, name: str, value: Any) -> None:
        """Apply a live parameter's new value; called in the loop's thread, may raise ValueError."""

    def check_parameter(self, name: str, value: Any) -> None:
        """Raise ValueError if a live parameter's new value is invalid; callable from any thread."""

    def warning(self) -> str:
        """Return the warning for /diagnostics, or an empty string."""
        return self.base.problem(self.stamp_ns * 1e-9)

    def describe(self) -> dict[str, object]:
        """Return the values for /diagnostics."""
        return {'base motion': self.base.status(self.stamp_ns * 1e-9)}

    # Methods for derived nodes to call.

    def listen(self, topic: Topic, act: Callable[[Any, float], None]) -> None:
        """Subscribe to a topic; the loop's thread calls `act(message, now)`.

        If `act` raises RejectedInputError, the node reports the rejection of the message.
        """

        def store(message: Any) -> None:
            self._requests.append(lambda now: act(message, now))

        topic.subscription(self.node, store)

    def act(self, action: Callable[[float], None]) -> None:
        """Run a function in the loop's thread before the next joint state is answered."""
        self._requests.append(action)

    def advertise(self, topic: Topic) -> Any:
        """Create a publisher of the topic, and return it."""
        return topic.publisher(self.node)

    def since_state_ns(self) -> int:
        """Return the time since the publication of the newest joint state [ns], in real time."""
        return self._stream.latency_ns()

    def count_answer(self, latency_ns: int | None = None) -> None:
        """Count the newest joint state as answered, with `latency_ns` or the latency until now."""
        self.diagnostics.latency.add(self.since_state_ns() if latency_ns is None else latency_ns)

    def reject(self, reason: str) -> None:
        """Count and log a rejected input."""
        self.diagnostics.add_rejection(reason)
        self.node.get_logger().warning(rejection(reason), throttle_duration_sec=1.0)

    # The loop.

    def run(self) -> None:
        """Process joint states until a stop signal or a shutdown of the ROS context."""
        with StopSignals(self._on_stop), BackgroundExecutor(self.node):
            prepare_thread(self.values, self.node.get_logger())
            patience = self.values.state_timeout
            while not self._stopping and rclpy.ok():
                if self._stream.wait(patience):
                    self._take()
                silent_for = time.monotonic() - self._state_arrival
                patience = self.values.state_timeout
                if silent_for > patience:
                    patience = self.silence(silent_for)
            if rclpy.ok():
                self.leave()
        print_answer(f'{self.node.get_name()}: {self.diagnostics.account()}')

    def close(self) -> None:
        """Destroy the node."""
        self._stream.destroy()
        self.node.destroy_node()

    def _take(self) -> None:
        newest = self._stream.newest_state()
        samples = self._stream.imu_samples()
        thrusts = self._stream.rotor_command()
        before_ns, stamp_ns = self.stamp_ns, newest[0] if newest is not None else self.stamp_ns
        odometry = self._stream.odometry()
        if odometry is not None and before_ns:
            self._try(partial(self.take_odometry, odometry), before_ns)
        late = []
        for sample, lead_ns in samples:
            if lead_ns <= 0 or round(1e9 * sample.stamp) >= stamp_ns:
                # Messages of two topics may overtake each other, so compare the stamps too.
                late.append(sample)
            else:
                self._offer(sample, _arrival(before_ns, stamp_ns, lead_ns))
        if newest is not None:
            self._state_arrival = time.monotonic()
            self.stamp_ns, self.state = newest
            while self._requests:
                self._try(self._requests.popleft(), stamp_ns)
            if not self.answers.again():
                self.answer(stamp_ns, self.state)
        for sample in late:
            self._offer(sample, stamp_ns)
        if thrusts is not None and isinstance(self.base, FreeBaseEstimator):
            lead_ns, command = thrusts
            came_ns = _arrival(before_ns, stamp_ns, lead_ns)
            self._try(partial(self.base.rotors.offer, *command), came_ns)

    def _rotor_names(self) -> tuple[str, ...]:
        """Return the names of the rotors whose commands the base-motion estimator needs."""
        drone = self.arm.drone if isinstance(self.base, FreeBaseEstimator) else None
        return () if drone is None else drone.rotor_names

    def _offer(self, sample: ImuSample, now_ns: int) -> None:
        self._try(partial(self.take_imu, sample), now_ns)

    def _try(self, action: Callable[[float], None], now_ns: int) -> None:
        try:
            action(now_ns * 1e-9)
        except RejectedInputError as error:
            self.reject(str(error))

    # Callbacks.

    def _parameter_problem(self, changes: Mapping[str, Any]) -> str:
        for name, value in changes.items():
            try:
                if name == PAYLOAD and not payload_problem(changes):
                    self.arm.check_base(self.values, value)
                self.check_parameter(name, value)
            except ValueError as error:
                return f'parameter {name}: {error}'
        return payload_problem(changes)

    def _on_parameter(self, name: str, value: Any) -> None:
        def change(_: float) -> None:
            try:
                if name == PAYLOAD:
                    self.arm.carry(value)
                else:
                    self.on_parameter(name, value)
            except ValueError as error:
                raise RejectedInputError(f'parameter {name}: {error}') from None

        self._requests.append(change)

    def _on_stop(self) -> None:
        self._stopping = True


def _arrival(before_ns: int, stamp_ns: int, lead_ns: int) -> int:
    """Return the arrival time of an IMU sample on the clock of the joint states [ns].

    The clocks of drone, arm and host may differ, so the arrival time is the stamp of the joint
    state before the sample. After a gap, for example a pause of this process, many samples follow
    one joint state. Then the arrival time is the stamp of the new joint state minus the interval
    that this host measured between both arrivals.

    Parameters
    ----------
    before_ns, stamp_ns
        Stamps of the previous and of the new joint state [ns].
    lead_ns
        Time from the arrival of the sample to the arrival of the new joint state [ns].
    """
    if stamp_ns - before_ns <= _GAP_NS:
        return before_ns
    return max(before_ns, stamp_ns - lead_ns)
