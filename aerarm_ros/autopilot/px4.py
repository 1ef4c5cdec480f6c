"""PX4's conventions (axes, normalized torque, gains), and its set points against the arm's motion.

PX4's world is north-east-down, its body forward-right-down; ROS's are east-north-up and
forward-left-up (REP 103, REP 105).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.control.base.base_motion import attitude_ned_frd_to_enu_flu, frd_to_flu
from aerarm_ros.control.checks import non_negative_number, positive
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_control import FlightGains, PositionLoop
from aerarm_ros.flight.flight_state import FlightState, FlightTarget, yaw_of
from aerarm_ros.motion.signals import Array

_WORLD = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_BODY = np.array([1.0, -1.0, -1.0])
_NO_TORQUE = 1e-3  # smallest entry of a rotor in PX4's mixer

VISION, GPS = SENSORS = 'vision', 'gps'
"""Position sources of the autopilot: odometry, as from motion capture, or a GPS receiver."""


def ned(vector: npt.ArrayLike) -> Array:
    """Convert a vector (3,) between east-north-up and north-east-down axes."""
    return np.asarray(_WORLD @ np.asarray(vector, dtype=float))


def frd_rotation(rotation: Array) -> Array:
    """Convert a rotation matrix (3, 3) between ROS axes (FLU in ENU) and PX4's (FRD in NED)."""
    return np.asarray((_WORLD @ rotation) * _BODY)


def heading(yaw: float) -> float:
    """Convert a heading [rad] between ROS (from east, counterclockwise) and PX4 (from north)."""
    return float(np.arctan2(np.cos(yaw), np.sin(yaw)))


def vehicle_attitude(message: Any) -> Array:
    """Return the attitude (x, y, z, w) of a px4_msgs/VehicleAttitude, FLU in ENU axes."""
    w, x, y, z = (float(value) for value in message.q)
    return attitude_ned_frd_to_enu_flu([x, y, z, w])


def torque_unit(drone: DroneConfig) -> Array:
    """Return the moment [Nm] about each body axis for PX4's normalized torque 1, (3,).

    The scaling is that of ControlAllocationPseudoInverse (SYS_CTRL_ALLOC). Roll and pitch are both
    scaled by the smaller of `T_max sqrt(n_x Sx2 / 2)` and `T_max sqrt(n_y Sy2 / 2)`. T_max is the
    largest thrust of a rotor. Sx2 is the sum of the squared lever arms of the rotors about the x
    axis, and n_x the number of rotors with such a lever arm. Yaw is scaled by the largest entry of
    the mixer's yaw column.

    Raises
    ------
    ValueError
        If the rotors give no moment about one of the axes.
    """
    effectiveness = drone.allocation * drone.column('thrust_max')
    if np.linalg.matrix_rank(effectiveness[3:]) < 3:
        raise ValueError(
            'the rotors of the drone file produce no moment about one axis of the drone: check '
            'positions and axes of the rotors'
        )
    mixer = np.linalg.pinv(effectiveness)[:, 3:]
    tilt = mixer[:, :2]
    turning = np.maximum(np.count_nonzero(np.abs(tilt) > _NO_TORQUE, axis=0), 1)
    scale = float(np.sqrt(np.square(tilt).sum(axis=0) * 2.0 / turning).max())
    return np.array([1.0 / scale, 1.0 / scale, 1.0 / float(mixer[:, 2].max())])


def hover_share(drone: DroneConfig, body: MassProperties) -> float:
    """Return the hover thrust divided by the largest total thrust of all rotors.

    Raises
    ------
    ValueError
        If the share is not between 10 and 80 %.
    """
    lift = float(np.abs(drone.allocation[2]) @ drone.column('thrust_max'))
    hover = body.mass * GRAVITY / lift
    if not 0.1 <= hover <= 0.8:
        raise ValueError(
            f'the drone hovers at {100.0 * hover:.0f} % of its largest thrust, but PX4 '
            '(MPC_THR_HOVER) and ArduPilot (MOT_THST_HOVER) accept 10 to 80 %: check mass and '
            'thrust_max in the drone file'
        )
    return hover


def force_unit(drone: DroneConfig) -> Array:
    """Return the force [N] along each body axis for PX4's normalized thrust 1, (3,).

    ControlAllocationPseudoInverse scales its mixer by one over the mean nonzero entry of a column.
    An axis without entries has the unit of the body's z axis.
    """
    mixer = np.abs(np.linalg.pinv(drone.allocation * drone.column('thrust_max'))[:, :3])
    counts = np.count_nonzero(mixer > 1e-7, axis=0)
    means = np.where(counts > 0, mixer.sum(axis=0) / np.maximum(counts, 1), 0.0)
    return np.array(1.0 / np.where(means > 0.0, means, means[2]))


@dataclass(frozen=True)
class Px4Gains:
    """Gains of PX4's attitude and rate loops, by PX4's names, with PX4's defaults of 2026.

    Attributes
    ----------
    mc_att_p, mc_yaw_p : float
        Angular velocity per attitude error [1/s]: MC_ROLL_P and MC_PITCH_P, or MC_YAW_P.
    mc_rate_k : float
        Common factor of the next two gains: MC_ROLLRATE_K and MC_PITCHRATE_K [-].
    mc_rate_p, mc_rate_i : float
        Normalized torque (`torque_unit`) per angular velocity error and its integral.
    mc_yawrate_p : float
        Normalized torque per angular velocity error about the vertical.

    Raises
    ------
    ValueError
        If a gain is negative, or a proportional gain is not positive.
    """

    mc_att_p: float = 4.0
    mc_yaw_p: float = 2.8
    mc_rate_k: float = 1.0
    mc_rate_p: float = 0.15
    mc_rate_i: float = 0.2
    mc_yawrate_p: float = 0.2

    def __post_init__(self) -> None:
        """Check that proportional gains are positive, and that no other value is negative."""
        for name, value in vars(self).items():
            check = positive if name.endswith(('_p', '_p_acc', '_k')) else non_negative_number
            check(name, value)


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


def position_target(target: FlightTarget, mask: int) -> tuple[str, dict[str, Any]]:
    """Return name and fields of the MAVLink message with position, velocity and acceleration.

    `mask` is the message's type mask.
    """
    x, y, z = ned(target.position).tolist()
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
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward
    ) -> tuple[str, dict[str, Any]]:
        """Return message name and fields of the MAVLink set point, without its time stamp.

        `dt` [s] is the time since the last message.
        """
        if self._is_full:
            return self._attitude(state, target, dt, arm)
        fed = self._acceleration.update(arm, state.rotation, dt)
        led = target._replace(acceleration=target.acceleration + fed)
        mask = TAKES_YAW if self._holds_heading else _TAKES_YAW_RATE
        return position_target(led, mask)

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
