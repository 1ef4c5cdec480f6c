"""Topics of the node `base_reaction`: the arm's load on the drone, contact, and energy."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from geometry_msgs.msg import AccelStamped, PointStamped
from numpy.typing import NDArray
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.control.base.rotor_wrench import RotorWrench
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.compensation import Fade
from aerarm_ros.description.drone_urdf import BODY_LINK
from aerarm_ros.energy.energy_model import BalanceMeter, EnergyBalance, EnergyModel
from aerarm_ros.flight.arm_load import ArmForecast, ArmLoad, ArmLoadModel, at_drone_centre
from aerarm_ros.flight.contact_estimator import (
    DURATION,
    FADE_STEP,
    ContactEstimator,
    ContactObserver,
)
from aerarm_ros.flight.flight_state import SET_BACK
from aerarm_ros.motion.signals import ArmState, JointReference
from aerarm_ros.ros.controllers.controller_parameters import load_share
from aerarm_ros.ros.controllers.state_node import StateNode
from aerarm_ros.ros.messages import fill, inertia_message, seconds, wrench_message
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.states.flight_stream import RotorCommands, checked_odometry
from aerarm_ros.ros.states.state_stream import base_header, decoded_odometry

MOUNT, CENTRE = 'mount', 'centre'
LOAD_PARAMETERS = grouped(
    'Feed-forward for the drone',
    Parameter('load_rate', 250.0, 'publishing rate of the feed-forward topics', 'Hz', 1.0, 500.0),
    Parameter('lead', 0.0, (
        'preview time: time from the newest joint state to the motion that the feed-forward '
        'describes. Set it to the lag of the rotors plus the delay of the connection to the '
        'drone'
    ), 's', 0.0, 0.09, live=True),
    Parameter('measured_motion', True, (
        'whether the node uses the measured joint motion if planned_motion is missing and the '
        'motors hold the arm. Set this parameter to false with world_control, which makes the '
        'arm react to the drone, so that the feed-forward would close a feedback loop'
    )),
    Parameter('acceleration_at', MOUNT, (
        'reference point of feedforward_acceleration, in body axes: the base_link of the arm '
        "('mount'), or the centre of mass of the drone ('centre')"
    ), choices=(MOUNT, CENTRE)),
)  # fmt: skip

_FADE = 0.2  # [s] in which the published motion fades to zero if no joint states arrive
_FADE_STEP = 0.01  # [s] between two messages of the fading motion


class LoadTopics:
    """Publish the arm's load on the drone as feed-forward, in five topics.

    The topics are centre of mass, inertia, wrench of the weight, wrench of the motion, and
    acceleration. The stamp of a message is the time to which the load applies: the stamp of the
    newest joint state plus the preview time `lead`.

    Parameters
    ----------
    owner
        Node with the parameters `LOAD_PARAMETERS`.
    """

    def __init__(self, owner: StateNode) -> None:
        node, arm, values = owner.node, owner.arm, owner.values
        self._publish = owner.answers.publish
        self._model = ArmLoadModel(arm.robot)
        arm.load(self._model.dynamics, values)
        self._names = arm.config.joint_names
        self.forecast = ArmForecast(arm.config.n, values.lead, values.measured_motion)
        self._drone = arm.drone
        self._base, self._body = arm.robot.base_link, arm.robot.full_name(BODY_LINK)
        self._at_centre = values.acceleration_at == CENTRE
        if self._at_centre and self._drone is None:
            raise ValueError(
                "acceleration_at 'centre' needs the centre of mass of the drone: set drone_file"
            )
        self._period = 1.0 / values.load_rate - 0.5e-3  # joint states arrive with jitter
        self._due = -np.inf
        self._sent: tuple[int, ArmLoad] | None = None
        self._fade = Fade(_FADE, share=1.0)
        self._silent_since = 0.0
        self._com = topics.ARM_COM.publisher(node)
        self._inertia = topics.ARM_INERTIA.publisher(node)
        self._weight = topics.WEIGHT_WRENCH.publisher(node)
        self._motion = topics.MOTION_WRENCH.publisher(node)
        self._acceleration = topics.FEEDFORWARD_ACCELERATION.publisher(node)

    def add(self, stamp_ns: int, measured: JointReference) -> None:
        """Process the joint motion measured at `stamp_ns`; publish if one period has passed."""
        now = 1e-9 * stamp_ns
        about_ns = stamp_ns + round(1e9 * self.forecast.lead)
        if self._has_faded_after(about_ns):
            return
        self._fade.share = 1.0
        if self._due - 2.0 * self._period < now < self._due:  # earlier: the clock was set back
            return
        self._due = now + self._period
        motion = self.forecast.motion(now, measured)
        self._send(about_ns, self._model.evaluate(motion))

    def fade(self) -> float | None:
        """Publish the motion's wrench and acceleration, which fade to zero without joint states.

        Returns
        -------
        float or None
            Time until the next step [s], None if the motion has faded to zero.
        """
        now = time.monotonic()
        if self._sent is None or self._fade.share == 0.0:
            return None
        step = 0.0 if self._fade.share == 1.0 else now - self._silent_since
        self._silent_since = now
        stamp_ns, load = self._sent
        self._fade.update(max(step, 1e-6), is_on=False)
        stamp_ns += round(1e9 * step)
        self._sent = stamp_ns, load
        self._send_motion(stamp_ns, load)
        return _FADE_STEP

    def take_plan(self, message: JointTrajectory, _: float) -> None:
        """Process the planned motion of a controller; raises RejectedInputError."""
        points, names = message.points, list(message.joint_names)
        if sorted(names) != sorted(self._names):
            return  # the controller of another arm published this plan
        order = [names.index(name) for name in self._names]
        columns = [
            np.array([[*getattr(point, what)] for point in points], dtype=float)
            for what in ('positions', 'velocities', 'accelerations')
        ]
        if all(column.ndim == 2 and column.shape[1] == len(order) for column in columns):
            columns = [column[:, order] for column in columns]
        times = np.array([seconds(point.time_from_start) for point in points])
        self.forecast.offer(seconds(message.header.stamp), times, *columns)

    def _has_faded_after(self, stamp_ns: int) -> bool:
        """Return whether a joint state is older than the last message of the fading motion.

        A joint state can be older if the bridge was delayed before it published the joint state.
        """
        if self._sent is None or self._fade.share == 1.0:
            return False
        return 0 < self._sent[0] - stamp_ns < 1e9 * SET_BACK

    def _send(self, stamp_ns: int, load: ArmLoad) -> None:
        self._sent = stamp_ns, load
        header = base_header(stamp_ns, self._base)
        centre = PointStamped(header=header)
        fill(centre.point, load.com)
        self._publish(self._com, centre)
        self._publish(self._inertia, inertia_message(header, load.mass, load.com, load.inertia))
        self._publish(self._weight, wrench_message(header, load.weight))
        self._send_motion(stamp_ns, load)

    def _send_motion(self, stamp_ns: int, load: ArmLoad) -> None:
        load = load._replace(motion=self._fade.share * load.motion)
        header = base_header(stamp_ns, self._base)
        self._publish(self._motion, wrench_message(header, load.motion))
        if self._drone is None:
            return
        acceleration = load.acceleration(self._drone)
        if self._at_centre:
            acceleration = at_drone_centre(acceleration, self._drone)
            header = base_header(stamp_ns, self._body)
        message = AccelStamped(header=header)
        fill(message.accel.linear, acceleration[:3])
        fill(message.accel.angular, acceleration[3:])
        self._publish(self._acceleration, message)


PUBLISHED = 'published'
BANDWIDTH = 'contact_bandwidth'
CONTACT_PARAMETERS = grouped(
    'Contact of the drone',
    Parameter(BANDWIDTH, 1.0,
        'cutoff frequency of the first-order low-pass that smooths contact_wrench',
        'Hz', 0.05, 20.0, live=True),
)  # fmt: skip
_PERIOD_NS = 2_000_000  # [ns] between two checks for odometry and rotor commands


class ContactTopic:
    """Subscribe to the drone's odometry and rotor commands, and publish the contact wrench.

    Without a drone file this object does not subscribe and does not publish.

    Parameters
    ----------
    owner
        Node with the parameters `CONTACT_PARAMETERS`.
    """

    def __init__(self, owner: StateNode) -> None:
        node, arm, values = owner.node, owner.arm, owner.values
        self._reject, self._act = owner.reject, owner.act
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
        self._commands = RotorCommands(node, self._names, self._reject)
        self._publisher = topics.CONTACT_WRENCH.publisher(node)

    def add(self, stamp_ns: int, state: ArmState) -> None:
        """Process a joint state with its stamp [ns], and publish the contact wrench."""
        estimator = self._estimator
        if estimator is None:
            return
        estimator.offer_joints(1e-9 * stamp_ns, state.q, state.dq)
        if 0 <= stamp_ns - self._looked_ns < _PERIOD_NS:
            return
        self._looked_ns = stamp_ns
        # Odometry first, because the measured motion results from earlier commands.
        raw = self._odometry.take_newest()
        odometry = None if raw is None else decoded_odometry(raw[0], self._reject)
        if (command := self._commands.newest()) is not None:
            self._try(partial(estimator.offer_rotors, self._names, command[1], 1e-9 * command[0]))
        if odometry is not None:
            sample = checked_odometry(odometry, self._reject)[1]
            if sample is not None:
                self._try(partial(estimator.offer_odometry, sample))
        self._publish(estimator.update())

    def fade(self) -> float | None:
        """Publish the contact wrench, which fades to zero without joint states.

        Returns
        -------
        float or None
            Time until the next step [s], None if the wrench has faded to zero.
        """
        if self._estimator is None or (report := self._estimator.fade(FADE_STEP)) is None:
            return None
        self._publish(report)
        return FADE_STEP

    def set_bandwidth(self, bandwidth: float) -> None:
        """Set the cutoff frequency [Hz] of the low-pass for the contact wrench."""
        if self._estimator is not None:
            self._estimator.observer.bandwidth = bandwidth

    def problem(self) -> str:
        """Return which input of the contact estimate is missing, or an empty string."""
        if self._estimator is None or not self._count:
            return ''
        problem = self._estimator.problem()
        return problem and f'contact_wrench: {problem}'

    def describe(self) -> dict[str, object]:
        """Return for /diagnostics whether `contact_wrench` is published, or why it is not."""
        if self._estimator is None:
            text = 'mass and rotors of the drone are unknown: set drone_file'
        else:
            text = self._estimator.problem() or PUBLISHED
        return {'contact': text}

    def _publish(self, report: tuple[float, NDArray[np.float64]] | None) -> None:
        if report is None:
            return
        stamp, wrench = report
        self._count += 1
        header = base_header(round(1e9 * stamp), self._frame)
        self._publisher.publish(wrench_message(header, wrench))

    def _on_zero(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        estimator, problem = self._estimator, str(self.describe()['contact'])
        response.success = estimator is not None and problem == PUBLISHED
        response.message = f'contact_wrench is not published: {problem}'
        if estimator is not None and response.success:
            zero = estimator.zero
            self._act(lambda _: zero.begin())
            response.message = (
                f'hover without contact for {DURATION:g} s: the node now estimates the bias of '
                'contact_wrench, and afterwards subtracts it'
            )
        return response

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except RejectedInputError as error:
            self._reject(str(error))


ROWS = (*EnergyBalance.PARTS, 'recovered')
_PERIOD = 0.1  # [s]


class EnergyTopic:
    """Add up the energy of the arm's drives by cause, and publish the sums at 10 Hz.

    The message has one row per cause and one column per joint. All rows but the last add up to the
    energy from the supply. The last row is the energy that the supply received from the drives.

    Parameters
    ----------
    owner
        Node with the parameters `MODEL_PARAMETERS`.

    Raises
    ------
    ValueError
        If a parameter cannot be used.
    """

    def __init__(self, owner: StateNode) -> None:
        arm, values = owner.arm, owner.values
        model = EnergyModel(
            arm.config, arm.robot, values.rotor_inertia or None, load_share(values, arm.robot)
        )
        arm.load(model.dynamics, values)
        self._meter = BalanceMeter(model)
        self._resistances = {
            f'{joint.name} resistance [ohm]': joint.motor.resistance_text
            for joint in arm.config.joints
        }
        self._due = -np.inf
        self._publisher, joints = topics.ENERGY.publisher(owner.node), arm.config.joint_names
        rows, columns, n = 'cause: ' + ' '.join(ROWS), 'joint: ' + ' '.join(joints), len(joints)
        self._layout = MultiArrayLayout(
            dim=[
                MultiArrayDimension(label=rows, size=len(ROWS), stride=len(ROWS) * n),
                MultiArrayDimension(label=columns, size=n, stride=n),
            ]
        )

    def add(self, now: float, state: ArmState) -> None:
        """Process the joint state of the time `now` [s]; publish if one period has passed."""
        self._meter.add(now, state)
        if self._due - 2.0 * _PERIOD < now < self._due:  # earlier: the clock was set back
            return
        self._due = now + _PERIOD - 0.5e-3  # joint states arrive with jitter
        total = self._meter.total
        joules = np.vstack([total.parts, total.recovered])
        self._publisher.publish(
            Float64MultiArray(layout=self._layout, data=joules.ravel().tolist())
        )

    def describe(self) -> dict[str, object]:
        """Return the energy by cause and each winding resistance's source, for /diagnostics."""
        total = self._meter.total
        report: dict[str, object] = {
            f'{name} [J]': round(float(value), 2)
            for name, value in zip(total.PARTS, total.parts.sum(axis=1), strict=True)
        }
        return {
            'duration of the energy measurement [s]': round(total.seconds, 2),
            'supplied energy [J]': round(float(total.supplied.sum()), 2),
            **report,
            'skipped gaps': self._meter.gaps,
            **self._resistances,
        }
