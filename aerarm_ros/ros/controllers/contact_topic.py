"""What touches drone or arm, on a topic."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics.raw_reader import RawReader
from aerarm_ros.contact.contact_estimator import FADE_STEP, ContactEstimator
from aerarm_ros.contact.contact_observer import ContactObserver
from aerarm_ros.contact.contact_zero import DURATION
from aerarm_ros.control.base.rotor_wrench import RotorWrench
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.ros.controllers.controller_parameters import ControlledArm
from aerarm_ros.ros.controllers.load_topics import wrench_message
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.states.base_header import base_header
from aerarm_ros.ros.states.flight_stream import checked_odometry, newest_odometry
from aerarm_ros.ros.states.rotor_commands import RotorCommands

TOLD = 'told'
BANDWIDTH = 'contact_bandwidth'
CONTACT_PARAMETERS = grouped(
    'What touches the drone',
    Parameter(BANDWIDTH, 1.0, 'of contact_wrench, first order', 'Hz', 0.05, 20.0, live=True),
)
_PERIOD_NS = 2_000_000  # between two looks at what came


class ContactTopic:
    """Hears odometry and rotor commands, and publishes the wrench of the contact.

    Of a drone that is not known nothing is heard and nothing published.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions.
    arm
        The arm, and the drone that carries it.
    values
        Of `CONTACT_PARAMETERS` and `ARM_PARAMETERS`.
    reject
        Called with the reason why an input is not used.
    act
        Runs an action in the loop's thread, with the time there.
    """

    def __init__(
        self,
        node: Node,
        arm: ControlledArm,
        values: SimpleNamespace,
        reject: Callable[[str], None],
        act: Callable[[Callable[[float], None]], None],
    ) -> None:
        self._reject, self._act = reject, act
        node.create_service(Trigger, '~/zero_contact', self._on_zero)
        self._frame = arm.robot.base_link
        self._looked_ns = 0
        self._count = 0
        self._estimator: ContactEstimator | None = None
        drone = arm.drone
        if drone is None:
            return
        whole = arm.whole_body(values, drone)
        rotors = RotorWrench(drone, values.imu_hold_time, values.rotor_latency)
        observer = ContactObserver(drone, whole, getattr(values, BANDWIDTH))
        self._estimator = ContactEstimator(drone, observer, rotors, values.imu_hold_time)
        self._names = drone.rotor_names
        self._odometry = RawReader(node, topics.ODOMETRY)
        self._commands = RotorCommands(node, self._names, reject)
        topic = topics.CONTACT_WRENCH
        self._publisher = node.create_publisher(topic.type, topic.name, topic.offered)

    def add(self, stamp_ns: int, state: ArmState) -> None:
        """Take the joints' state at a stamp [ns], and publish what is new by then."""
        estimator = self._estimator
        if estimator is None:
            return
        estimator.offer_joints(1e-9 * stamp_ns, state.q, state.dq)
        if 0 <= stamp_ns - self._looked_ns < _PERIOD_NS:
            return
        self._looked_ns = stamp_ns
        # Odometry first: the commands that made it were sent before.
        odometry = newest_odometry(self._odometry, self._reject)
        if (command := self._commands.newest()) is not None:
            self._try(partial(estimator.offer_rotors, self._names, command[1], 1e-9 * command[0]))
        if odometry is not None:
            sample = checked_odometry(odometry, self._reject)[1]
            if sample is not None:
                self._try(partial(estimator.offer_odometry, sample))
        self._publish(estimator.update())

    def fade(self) -> float | None:
        """Let the last estimate fade, as no states come; return until when [s], None if it has."""
        if self._estimator is None or (told := self._estimator.fade(FADE_STEP)) is None:
            return None
        self._publish(told)
        return FADE_STEP

    def set_bandwidth(self, bandwidth: float) -> None:
        """Change the bandwidth [Hz]."""
        if self._estimator is not None:
            self._estimator.observer.bandwidth = bandwidth

    def problem(self) -> str:
        """Return what has gone missing since contact was told of last, '' if nothing has."""
        if self._estimator is None or not self._count:
            return ''
        problem = self._estimator.problem()
        return problem and f'contact_wrench: {problem}'

    def describe(self) -> dict[str, object]:
        """Tell whether contact is told of, and why not."""
        if self._estimator is None:
            text = "the drone's mass and rotors are not known: give drone_file"
        else:
            text = self._estimator.problem() or TOLD
        return {'contact': text}

    def _publish(self, told: tuple[float, NDArray[np.float64]] | None) -> None:
        if told is None:
            return
        stamp, wrench = told
        self._count += 1
        header = base_header(round(1e9 * stamp), self._frame)
        self._publisher.publish(wrench_message(header, wrench))

    def _on_zero(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        estimator, problem = self._estimator, str(self.describe()['contact'])
        response.success = estimator is not None and problem == TOLD
        response.message = f'contact_wrench is not told: {problem}'
        if estimator is not None and response.success:
            zero = estimator.zero
            self._act(lambda _: zero.begin())
            response.message = (
                f'what contact_wrench tells is averaged for {DURATION:g} s and subtracted from '
                'then on: hover, and let nothing touch the drone meanwhile'
            )
        return response

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except RejectedInputError as error:
            self._reject(str(error))
