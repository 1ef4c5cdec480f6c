"""Set point messages for PX4 (MAVLink), with feedforward of the arm's motion."""

from typing import Any

import numpy as np
import pinocchio as pin

from aerarm_ros.autopilot.px4 import Px4Gains, force_unit, frd_rotation, heading, ned, torque_unit
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.control.base.base_motion import frd_to_flu
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_control import FlightGains, PositionLoop
from aerarm_ros.flight.flight_state import FlightState, FlightTarget, yaw_of
from aerarm_ros.motion.signals import Array

_UP = np.array([0.0, 0.0, 1.0])
_FRAME_LOCAL_NED = 1  # MAV_FRAME_LOCAL_NED
# Bits of POSITION_TARGET_TYPEMASK that ignore the yaw, or the yaw rate.
_TAKES_YAW_RATE, TAKES_YAW = 1 << 10, 1 << 11
_NO_RATES, _THRUST_BODY = 7, 32  # of ATTITUDE_TARGET_TYPEMASK
_STEP_MAX = 0.05  # [s]


def tilt_ahead(gains: Px4Gains, drone: DroneConfig) -> SetPointAcceleration:
    """Return a `SetPointAcceleration` whose anticipatory tilt cancels the lag of PX4's loops.

    Raises
    ------
    ValueError
        If the rotors give no moment about one of the axes.
    """
    unit = torque_unit(drone)
    rate_gain = gains.mc_rate_k * gains.mc_rate_p * float(unit[0])
    yaw_gain = gains.mc_yaw_p * gains.mc_yawrate_p * float(unit[2])
    lasting = gains.mc_rate_i / gains.mc_rate_p
    return SetPointAcceleration(gains.mc_att_p, rate_gain, lasting, yaw_gain)


def position_target(target: FlightTarget, mask: int, origin: Array) -> tuple[str, dict[str, Any]]:
    """Return name and fields of the MAVLink message with position, velocity and acceleration.

    `mask` is the message's type mask. `origin` (3,) is the origin of the target's frame in the
    autopilot's local frame, north-east-down [m].
    """
    x, y, z = (ned(target.position) + origin).tolist()
    vx, vy, vz = ned(target.velocity).tolist()
    ax, ay, az = ned(target.acceleration).tolist()
    return 'SET_POSITION_TARGET_LOCAL_NED', {
        'coordinate_frame': _FRAME_LOCAL_NED, 'type_mask': mask, 'x': x, 'y': y, 'z': z,
        'vx': vx, 'vy': vy, 'vz': vz, 'afx': ax, 'afy': ay, 'afz': az,
        'yaw': heading(target.yaw),
    }  # fmt: skip


class Px4SetPoints:
    """Creates set point messages for PX4, with feedforward of the arm's motion.

    A drone with rotors in one plane gets SET_POSITION_TARGET_LOCAL_NED with the acceleration of
    `SetPointAcceleration`; PX4 closes all loops. PX4's position loop would tilt a drone with tilted
    rotors, which should stay level. A drone with tilted rotors therefore gets SET_ATTITUDE_TARGET
    with `thrust_body`. The field `thrust_body` is the force of this package's own position loop
    plus the arm's feedforward. PX4 then closes only the loops of attitude and angular velocity.

    Parameters
    ----------
    gains : FlightGains, optional
        Gains of this package's own position loop.
    acceleration : SetPointAcceleration, optional
        Acceleration that compensates the arm's motion; by default without anticipatory tilt.
    holds_heading : bool
        Whether set points contain a heading; without one PX4 does not control the heading.

    """

    def __init__(
        self,
        drone: DroneConfig,
        gains: FlightGains | None = None,
        acceleration: SetPointAcceleration | None = None,
        holds_heading: bool = True,
    ) -> None:
        self._loop = PositionLoop(FlightGains() if gains is None else gains)
        self._acceleration = acceleration or SetPointAcceleration()
        self._holds_heading = holds_heading
        self._is_full = drone.is_fully_actuated
        self._force_unit = force_unit(drone)

    @property
    def needs_state(self) -> bool:
        """Whether `message` needs the drone's present position and attitude."""
        return self._is_full

    def reset(self) -> None:
        """Reset the integral of the position loop."""
        self._loop.reset()

    def message(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward, origin: Array
    ) -> tuple[str, dict[str, Any]]:
        """Return message name and fields of the MAVLink set point, without its time stamp.

        `dt` [s] is the time since the last message. `origin` (3,) is the origin of the target's
        frame in PX4's local frame, north-east-down [m].
        """
        if self._is_full:
            return self._attitude(state, target, dt, arm)
        fed = self._acceleration.update(arm, state.rotation, dt)
        led = target._replace(acceleration=target.acceleration + fed)
        mask = TAKES_YAW if self._holds_heading else _TAKES_YAW_RATE
        return position_target(led, mask, origin)

    def _attitude(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward
    ) -> tuple[str, dict[str, Any]]:
        body, feedback = arm.body, self._loop.update(state, target, min(dt, _STEP_MAX))
        level = pin.exp3(yaw_of(state.rotation) * _UP)
        force = body.mass * (target.acceleration + feedback + GRAVITY * _UP)
        in_body = frd_to_flu(state.rotation.T @ (force - level @ arm.wrench[:3]))
        thrust = np.clip(in_body / self._force_unit, -1.0, 1.0)
        turn = pin.exp3(self._acceleration.turn(arm, dt))
        rotation = frd_rotation(pin.exp3(target.yaw * _UP) @ turn)
        x, y, z, w = pin.Quaternion(rotation).coeffs().tolist()
        return 'SET_ATTITUDE_TARGET', {
            'type_mask': _THRUST_BODY | _NO_RATES, 'q': (w, x, y, z),
            'thrust_body': thrust.tolist(),
        }  # fmt: skip
