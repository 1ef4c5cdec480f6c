"""Set points for ArduCopter's position loop, with feedforward of the arm's motion."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from aerarm_ros.autopilot.px4_set_points import TAKES_YAW, position_target
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.control.checks import non_negative_number
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.motion.signals import Array

_TAKES_NO_YAW = 3 << 10  # POSITION_TARGET_TYPEMASK
_STEP_MAX = 0.05  # [s]
_LEVEL = np.array([1.0, 1.0, 0.0])


@dataclass(frozen=True)
class ArduPilotLoop:
    """Gains of ArduCopter's horizontal position loop, by default those of ArduCopter 4.7.

    Attributes
    ----------
    position_p : float
        PSC_POSXY_P, velocity per position error [1/s].
    velocity_p, velocity_i : float
        PSC_VELXY_P [1/s] and PSC_VELXY_I [1/s^2], acceleration per velocity error and its
        integral.

    Raises
    ------
    ValueError
        If a gain is negative.
    """

    position_p: float = 1.0
    velocity_p: float = 2.0
    velocity_i: float = 1.0

    def __post_init__(self) -> None:
        """Check that no gain of the position loop is negative."""
        for name, value in vars(self).items():
            non_negative_number(name, value)


class LoopMotion(NamedTuple):
    """Motion that is added to the user's set point, in world axes with z up.

    Attributes
    ----------
    offset, speed, acceleration : (3,) ndarray
        Offset [m] from the user's set point, and its derivatives.
    """

    offset: Array
    speed: Array
    acceleration: Array


class LoopOffset:
    """Moves the set point so that ArduCopter commands a given acceleration.

    ArduCopter takes position, velocity and acceleration of a set point for one motion that the
    drone shall follow (`AC_PosControl::input_pos_vel_accel_NE_m`). An acceleration next to a
    position at rest therefore has almost no effect: ArduCopter plans a motion back to the position.
    So the set point moves by the offset d for which ArduCopter's position loop commands the
    acceleration a while the drone stays where it is::

        d'' + kv (d' + kp d) + ki s = a,   s' = d' + kp d

    with the gains kp, kv and ki of `ArduPilotLoop`. Position, velocity and acceleration of this
    motion agree. ArduCopter controls the vertical acceleration by its accelerometer, which rejects
    the arm's vertical force, so the motion is horizontal.
    """

    def __init__(self, loop: ArduPilotLoop) -> None:
        self._loop = loop
        self._offset, self._speed, self._sum = np.zeros(3), np.zeros(3), np.zeros(3)

    def update(self, wanted: Array, dt: float) -> LoopMotion:
        """Advance by `dt` [s]; return the offset that causes an acceleration (3,) [m/s^2]."""
        loop, dt = self._loop, min(dt, _STEP_MAX)
        error = self._speed + loop.position_p * self._offset
        push = wanted * _LEVEL - loop.velocity_p * error - loop.velocity_i * self._sum
        self._sum = self._sum + dt * error
        self._speed = self._speed + dt * push
        self._offset = self._offset + dt * self._speed
        return LoopMotion(self._offset, self._speed, push)


class ArduPilotSetPoints:
    """Creates set point messages for ArduCopter, with the arm's feedforward by `LoopOffset`.

    Parameters
    ----------
    loop : ArduPilotLoop
        Gains of ArduCopter's position loop.
    acceleration : SetPointAcceleration
        Acceleration that compensates the arm's motion.
    holds_heading : bool
        Whether set points contain a heading.
    """

    needs_state = False

    def __init__(
        self, loop: ArduPilotLoop, acceleration: SetPointAcceleration, holds_heading: bool = True
    ) -> None:
        self._loop, self._acceleration = loop, acceleration
        self._holds_heading = holds_heading
        self.reset()

    def reset(self) -> None:
        """Reset the offset of the set point to zero."""
        self._offset = LoopOffset(self._loop)

    def message(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward, origin: Array
    ) -> tuple[str, dict[str, Any]]:
        """Return message name and fields of the MAVLink set point, without its time stamp.

        `dt` [s] is the time since the last message. `origin` (3,) is the origin of the target's
        frame in ArduPilot's local frame, north-east-down [m].
        """
        moved = self._offset.update(self._acceleration.update(arm, state.rotation, dt), dt)
        led = FlightTarget(
            target.position + moved.offset,
            target.yaw,
            target.velocity + moved.speed,
            target.acceleration + moved.acceleration,
        )
        return position_target(led, TAKES_YAW if self._holds_heading else _TAKES_NO_YAW, origin)
