"""ArduCopter's frames and gains for a drone, and its set points against the arm's motion."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from aerarm_ros.autopilot.px4 import TAKES_YAW, position_target
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.control.checks import non_negative_number
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.motion.signals import Array


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


# Angle [deg] of each motor from the front, clockwise, and whether its propeller turns clockwise
# (`AP_MotorsMatrix.cpp`, frame type X); by number of rotors, with the frame's class.
FRAMES: dict[int, tuple[int, list[tuple[float, bool]]]] = {
    4: (1, [(45, False), (-135, False), (-45, True), (135, True)]),
    6: (2, [(90, True), (-90, False), (-30, True), (150, False), (30, False), (-150, True)]),
}
_NEAR = 10.0  # [deg] largest deviation of a rotor from its place in the frame


@dataclass(frozen=True)
class ArduPilotSetup:
    """Gains of ArduCopter.

    Attributes
    ----------
    att_p : float
        ATC_ANG_RLL_P and ATC_ANG_PIT_P, angular velocity per attitude error [1/s].
    rate_p, rate_i, rate_d : float
        ATC_RAT_RLL_P and so on: fraction of the largest roll moment per error of the angular
        velocity [s/rad], its integral and its derivative.
    loop : ArduPilotLoop
        Gains of the position loop.
    """

    att_p: float = 6.5
    rate_p: float = 0.4
    rate_i: float = 0.4
    rate_d: float = 0.006
    loop: ArduPilotLoop = ArduPilotLoop()

    def rate_gain(self, drone: DroneConfig) -> float:
        """Return the roll or pitch loop's moment per angular velocity error [Nm s/rad]."""
        return self.rate_p * moment_unit(drone)

    def tilt_ahead(self, drone: DroneConfig) -> SetPointAcceleration:
        """Return a `SetPointAcceleration` whose anticipatory tilt cancels the lag of the loops."""
        return SetPointAcceleration(self.att_p, self.rate_gain(drone), self.rate_i / self.rate_p)


def moment_unit(drone: DroneConfig) -> float:
    """Return the mean roll and pitch moment [Nm] for ArduCopter's normalized command 1.

    Raises
    ------
    ValueError
        If ArduCopter's frame of type X does not have the drone's rotors.
    """
    rotors = [drone.rotors[index] for index in motors_of(drone)]
    angles = np.radians([angle for angle, _ in FRAMES[drone.n][1]])
    shares = np.abs(np.array([np.sin(angles), np.cos(angles)]))  # of roll and pitch
    shares = 0.5 * shares / shares.max(axis=1, keepdims=True)
    levers = np.abs(np.array([rotor.position[:2] for rotor in rotors]).T[::-1])
    return float(((shares * levers) @ [rotor.thrust_max for rotor in rotors]).mean())


def motors_of(drone: DroneConfig) -> list[int]:
    """Return, for each of ArduPilot's motors in order, the number of the drone's rotor.

    Raises
    ------
    ValueError
        If ArduCopter's frame of type X does not have the drone's rotors.
    """
    frame = FRAMES.get(drone.n, (0, []))[1]
    found = []
    for angle, turns_clockwise in frame:
        for index, rotor in enumerate(drone.rotors):
            x, y = rotor.position[:2]
            off = (np.degrees(np.arctan2(-y, x)) - angle + 180.0) % 360.0 - 180.0
            is_level = rotor.axis[2] > 0.999
            if abs(off) < _NEAR and is_level and (rotor.moment_per_thrust > 0) == turns_clockwise:
                found.append(index)
    if not frame or len(found) != drone.n:
        raise ValueError(
            f'ArduPilot has no frame for {drone.name}: ArduPilot flies 4 or 6 level rotors in X '
            "form, each with the direction of ArduPilot's motor order; check position, axis and "
            'moment_per_thrust in the drone file'
        )
    return found


_TAKES_NO_YAW = 3 << 10  # POSITION_TARGET_TYPEMASK
_STEP_MAX = 0.05  # [s]
_LEVEL = np.array([1.0, 1.0, 0.0])


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
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward
    ) -> tuple[str, dict[str, Any]]:
        """Return message name and fields of the MAVLink set point, without its time stamp.

        `dt` [s] is the time since the last message.
        """
        moved = self._offset.update(self._acceleration.update(arm, state.rotation, dt), dt)
        led = FlightTarget(
            target.position + moved.offset,
            target.yaw,
            target.velocity + moved.speed,
            target.acceleration + moved.acceleration,
        )
        return position_target(led, TAKES_YAW if self._holds_heading else _TAKES_NO_YAW)
