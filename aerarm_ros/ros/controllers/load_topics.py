"""What a drone may be fed forward of its arm, on topics."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
from geometry_msgs.msg import AccelStamped, PointStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_ros.control.compensation.fade import Fade
from aerarm_ros.description.drone_urdf import BODY_LINK
from aerarm_ros.flight.arm_forecast import ArmForecast
from aerarm_ros.flight.arm_load import ArmLoad, at_drone_centre
from aerarm_ros.flight.arm_load_model import ArmLoadModel
from aerarm_ros.flight.stamped_values import SET_BACK
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.ros.controllers.controller_parameters import ControlledArm
from aerarm_ros.ros.controllers.inertia_message import inertia_message
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.states.base_header import base_header

MOUNT, CENTRE = 'mount', 'centre'
LOAD_PARAMETERS = grouped(
    'What the drone may feed forward',
    Parameter('load_rate', 250.0, 'how often it is published', 'Hz', 1.0, 500.0),
    Parameter('lead', 0.0, 'how far ahead of the newest state it is, by planned_motion where that '
              "comes: the rotors' lag and the delay of the link", 's', 0.0, 0.09, live=True),
    Parameter('acceleration_at', MOUNT, "whose acceleration: that of the arm's base_link, or of "
              "the drone's centre of mass, in body axes", choices=(MOUNT, CENTRE)),
)  # fmt: skip

_FADE = 0.2  # [s] in which the motion of an arm that fell silent becomes none
_FADE_STEP = 0.01  # [s]


class LoadTopics:
    """Publishes mass properties, weight, the motion's wrench and the acceleration against it.

    Each message is stamped with the time that it is about: the state's, `lead` later.

    Parameters
    ----------
    node
        Owner of the publishers.
    arm
        The arm.
    values
        Of `LOAD_PARAMETERS`.
    """

    def __init__(self, node: Node, arm: ControlledArm, values: SimpleNamespace) -> None:
        self._model = ArmLoadModel(arm.robot)
        arm.load(self._model.dynamics, values)
        self._names = arm.config.joint_names
        self.forecast = ArmForecast(arm.config.n, values.lead)
        self._drone = arm.drone
        self._base, self._body = arm.robot.base_link, arm.robot.full_name(BODY_LINK)
        self._at_centre = values.acceleration_at == CENTRE
        if self._at_centre and self._drone is None:
            raise ValueError("acceleration_at 'centre' needs the drone: give drone_file")
        self._period = 1.0 / values.load_rate - 0.5e-3  # states come with jitter
        self._due = -np.inf
        self._sent: tuple[int, ArmLoad] | None = None
        self._fade = Fade(_FADE, share=1.0)
        self._silent_since = 0.0

        def advertise(topic: Topic) -> Any:
            return node.create_publisher(topic.type, topic.name, topic.offered)

        self._com, self._inertia = advertise(topics.ARM_COM), advertise(topics.ARM_INERTIA)
        self._weight = advertise(topics.WEIGHT_WRENCH)
        self._motion = advertise(topics.MOTION_WRENCH)
        self._acceleration = advertise(topics.FEEDFORWARD_ACCELERATION)

    def add(self, stamp_ns: int, measured: JointReference) -> None:
        """Take the motion measured at a stamp [ns], and publish if it is due."""
        now = 1e-9 * stamp_ns
        about_ns = stamp_ns + round(1e9 * self.forecast.lead)
        if self._has_faded_after(about_ns):
            return
        self._fade.share = 1.0
        if self._due - 2.0 * self._period < now < self._due:  # else the clock may be set back
            return
        self._due = now + self._period
        motion = self.forecast.motion(now, measured)
        self._send(about_ns, self._model.evaluate(motion))

    def repeat(self) -> None:
        """Publish the last once more, its motion as far as it has faded."""
        if self._sent is not None:
            self._send(*self._sent)

    def fade(self) -> float | None:
        """Let the last motion fade, as no states come; return until when [s], None if it has.

        Mass and weight stay: the arm is still there.
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
        """Take what a controller plans; raises RejectedInputError."""
        points, names = message.points, list(message.joint_names)
        if sorted(names) != sorted(self._names):
            return  # of another arm's controller
        order = [names.index(name) for name in self._names]
        columns = [
            np.array([[*getattr(point, what)] for point in points], dtype=float)
            for what in ('positions', 'velocities', 'accelerations')
        ]
        if all(column.ndim == 2 and column.shape[1] == len(order) for column in columns):
            columns = [column[:, order] for column in columns]
        durations = [point.time_from_start for point in points]
        times = np.array([duration.sec + 1e-9 * duration.nanosec for duration in durations])
        begin = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.forecast.offer(begin, times, *columns)

    def _has_faded_after(self, stamp_ns: int) -> bool:
        """Return whether a state tells of a time for which the motion was told as fading.

        A bridge that was held up between measuring and publishing sends such a state afterwards.
        """
        if self._sent is None or self._fade.share == 1.0:
            return False
        return 0 < self._sent[0] - stamp_ns < 1e9 * SET_BACK

    def _send(self, stamp_ns: int, load: ArmLoad) -> None:
        self._sent = stamp_ns, load
        header = base_header(stamp_ns, self._base)
        self._com.publish(_point_message(header, load.com))
        self._inertia.publish(inertia_message(header, load.mass, load.com, load.inertia))
        self._weight.publish(wrench_message(header, load.weight))
        self._send_motion(stamp_ns, load)

    def _send_motion(self, stamp_ns: int, load: ArmLoad) -> None:
        load = load._replace(motion=self._fade.share * load.motion)
        header = base_header(stamp_ns, self._base)
        self._motion.publish(wrench_message(header, load.motion))
        if self._drone is None:
            return
        acceleration = load.acceleration(self._drone)
        if self._at_centre:
            acceleration = at_drone_centre(acceleration, self._drone)
            header = base_header(stamp_ns, self._body)
        message = AccelStamped(header=header)
        _fill(message.accel.linear, acceleration[:3])
        _fill(message.accel.angular, acceleration[3:])
        self._acceleration.publish(message)


def wrench_message(header: Header, wrench: NDArray[np.float64]) -> WrenchStamped:
    """Return the message of a force [N] and moment [Nm], (6,)."""
    message = WrenchStamped(header=header)
    _fill(message.wrench.force, wrench[:3])
    _fill(message.wrench.torque, wrench[3:])
    return message


def _point_message(header: Header, point: NDArray[np.float64]) -> PointStamped:
    message = PointStamped(header=header)
    _fill(message.point, point)
    return message


def _fill(message: Any, vector: NDArray[np.float64]) -> None:
    message.x, message.y, message.z = vector.tolist()
