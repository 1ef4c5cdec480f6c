"""Model of PX4's cascaded control loops, from a set point to thrust and torque."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from flying.firmware_program import Px4AllGains

from aerarm_ros.autopilot.px4 import frd_rotation, heading, ned, tilt_ahead, torque_unit
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.control.base.base_motion import frd_to_flu, quaternion
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_control import Allocation
from aerarm_ros.flight.flight_state import FlightState, FlightTarget, yaw_of
from aerarm_ros.model.inertia import cross
from aerarm_ros.motion.signals import Array

_INTEGRAL_MAX = GRAVITY  # [m/s^2] largest integral action of the velocity loop
_RATE_INTEGRAL_MAX = 0.3  # MC_RR_INT_LIM
_YAW_WEIGHT = 0.4  # MC_YAW_WEIGHT
_VELOCITY_CUTOFF = 5.0  # [Hz] MPC_VELD_LP, of the derivative of the velocity
_SPIN_CUTOFF = 20.0  # [Hz] IMU_DGYRO_CUTOFF, of the angular acceleration


def _low_pass_share(cutoff: float, dt: float) -> float:
    """Return the weight of the new sample in a discrete first-order low-pass filter."""
    return float(1.0 - np.exp(-2.0 * np.pi * cutoff * dt))


class Px4SetPoint(NamedTuple):
    """Set point of PX4's position loop in north-east-down axes.

    Attributes
    ----------
    position : (3,) ndarray
        Desired position [m].
    yaw : float
        Heading, clockwise from north [rad]; NaN for no heading control.
    velocity, acceleration : (3,) ndarray
        Desired velocity [m/s] and acceleration [m/s^2]; NaN if not given.
    """

    position: Array
    yaw: float
    velocity: Array
    acceleration: Array


class Px4State(NamedTuple):
    """State of the drone in PX4's axes: world north-east-down, body forward-right-down.

    Attributes
    ----------
    position, velocity : (3,) ndarray
        Position [m] and velocity [m/s] of the vehicle.
    rotation : (3, 3) ndarray
        Body to world.
    rate : (3,) ndarray
        Angular velocity in body axes [rad/s].
    """

    position: Array
    velocity: Array
    rotation: Array
    rate: Array


class Px4Loops:
    """PX4's cascaded loops: position P, velocity PID, attitude P, angular velocity PID.

    The loops are those of PX4's modules mc_pos_control (PositionControl.cpp), mc_att_control
    (AttitudeControl.cpp, Brescianini, Hehn and D'Andrea 2013) and mc_rate_control. The
    acceleration of a set point is added after the velocity's PID. The hover thrust carries the
    weight.

    Parameters
    ----------
    hover_thrust : float
        Result of PX4's hover thrust estimator, as a fraction of the largest thrust.
    """

    def __init__(self, gains: Px4AllGains, hover_thrust: float) -> None:
        self._gains = g = gains
        self._hover_thrust = hover_thrust
        self._position_p = np.array([g.mpc_xy_p, g.mpc_xy_p, g.mpc_z_p])
        self._velocity_p = np.array([g.mpc_xy_vel_p_acc, g.mpc_xy_vel_p_acc, g.mpc_z_vel_p_acc])
        self._velocity_i = np.array([g.mpc_xy_vel_i_acc, g.mpc_xy_vel_i_acc, g.mpc_z_vel_i_acc])
        self._velocity_d = np.array([g.mpc_xy_vel_d_acc, g.mpc_xy_vel_d_acc, g.mpc_z_vel_d_acc])
        self._rate_p = np.array([*[g.mc_rate_k * g.mc_rate_p] * 2, g.mc_yawrate_p])
        self._rate_i = np.array([*[g.mc_rate_k * g.mc_rate_i] * 2, g.mc_yawrate_i])
        self._rate_d = np.array([*[g.mc_rate_k * g.mc_rate_d] * 2, 0.0])
        self._push, self._moment = np.zeros(3), np.zeros(3)
        self._velocity: Array | None = None
        self._rate: Array | None = None
        self._yaw_torque: float | None = None
        self._acceleration, self._spin = np.zeros(3), np.zeros(3)

    def update(self, state: Px4State, wanted: Px4SetPoint, dt: float) -> tuple[float, Array]:
        """Return PX4's normalized thrust, and normalized torque (3,) in FRD axes.

        `dt` is the time since the last update [s].
        """
        thrust = self._thrust(state, wanted, dt)
        # Without a heading PX4 uses the present one, so that only the yaw rate is damped.
        yaw = yaw_of(state.rotation) if np.isnan(wanted.yaw) else wanted.yaw
        return float(np.linalg.norm(thrust)), self._torque(state, thrust, yaw, dt)

    def _thrust(self, state: Px4State, wanted: Px4SetPoint, dt: float) -> Array:
        """Return the commanded thrust vector (3,) in NED axes, relative to the largest thrust."""
        error = wanted.position - state.position
        velocity = self._position_p * error + np.nan_to_num(wanted.velocity)
        if self._velocity is not None and dt > 0.0:
            slope = (state.velocity - self._velocity) / dt
            share = _low_pass_share(_VELOCITY_CUTOFF, dt)
            self._acceleration = self._acceleration + share * (slope - self._acceleration)
        self._velocity = state.velocity
        off = velocity - state.velocity
        feedback = self._velocity_p * off + self._push - self._velocity_d * self._acceleration
        acceleration = feedback + np.nan_to_num(wanted.acceleration)
        push = self._push + dt * self._velocity_i * off
        self._push = np.clip(push, -_INTEGRAL_MAX, _INTEGRAL_MAX)
        along = np.array([-acceleration[0], -acceleration[1], GRAVITY])
        sideways = float(np.linalg.norm(along[:2]))
        steepest = GRAVITY * np.tan(self._gains.tilt_max)
        if sideways > steepest:
            along[:2] *= steepest / sideways
        body_z = along / np.linalg.norm(along)
        lift = acceleration[2] * self._hover_thrust / GRAVITY - self._hover_thrust
        collective = min(lift / body_z[2], -self._gains.thrust_min)
        return np.asarray(max(collective, -1.0) * body_z)

    def _torque(self, state: Px4State, thrust: Array, yaw: float, dt: float) -> Array:
        wanted = _attitude(-thrust / np.linalg.norm(thrust), yaw)
        rates = self._rates(state.rotation, wanted)
        off = rates - state.rate
        if self._rate is not None and dt > 0.0:
            slope = (state.rate - self._rate) / dt
            share = _low_pass_share(_SPIN_CUTOFF, dt)
            self._spin = self._spin + share * (slope - self._spin)
        self._rate = state.rate
        torque = self._rate_p * off + self._moment - self._rate_d * self._spin
        moment = self._moment + dt * self._rate_i * off
        self._moment = np.clip(moment, -_RATE_INTEGRAL_MAX, _RATE_INTEGRAL_MAX)
        if self._yaw_torque is not None and self._gains.mc_yaw_tq_cutoff > 0.0:
            share = _low_pass_share(self._gains.mc_yaw_tq_cutoff, dt)
            torque[2] = self._yaw_torque + share * (torque[2] - self._yaw_torque)
        self._yaw_torque = float(torque[2])
        return np.clip(torque, -1.0, 1.0)

    def _rates(self, rotation: Array, wanted: Array) -> Array:
        """Return the desired angular velocity (3,) [rad/s] in body axes."""
        tilt = _between(rotation[:, 2], wanted[:, 2])  # the shortest rotation of the thrust
        reduced = tilt @ rotation
        # The remaining rotation is about the body's z.
        left = reduced.T @ wanted
        turn = np.arctan2(left[1, 0], left[0, 0])
        around = pin.exp3(np.array([0.0, 0.0, _YAW_WEIGHT * turn]))
        error = _sine_vector(rotation.T @ (reduced @ around))
        gains = self._gains
        rates: Array = error * [gains.mc_att_p, gains.mc_att_p, gains.mc_yaw_p / _YAW_WEIGHT]
        return rates


def _attitude(down: Array, yaw: float) -> Array:
    """Return the rotation (3, 3) whose z axis is `down` and whose heading is `yaw` [rad]."""
    side = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    x = cross(side, down)
    x /= np.linalg.norm(x)
    return np.column_stack([x, cross(down, x), down])


def _between(start: Array, end: Array) -> Array:
    """Return the smallest rotation (3, 3) that turns one unit vector into another."""
    return np.array(pin.Quaternion.FromTwoVectors(start, end).toRotationMatrix())


def _sine_vector(rotation: Array) -> Array:
    """Return twice the vector part (3,) of a rotation's quaternion whose scalar is positive."""
    x, y, z, w = quaternion(rotation)
    vector: Array = np.copysign(2.0, w) * np.array([x, y, z])
    return vector


_SINK = 0.97  # lifted fraction of the weight without a known height


class Px4Flight:
    """Flight control by a model of PX4's loops (`Px4Loops`), instead of `FlightControl`.

    The only feedforward of the arm is the acceleration of a set point. The loops receive neither
    the moment of the arm's weight nor its inertia. The hover thrust is that of drone and arm at
    rest.

    Parameters
    ----------
    body : MassProperties
        Mass properties of drone and arm at rest.
    knows_loops : bool
        Whether set points tilt the drone ahead of the arm's force, by the inverse of the loops.
    holds_heading : bool
        Whether set points contain a heading; without one PX4 does not control the heading.

    Attributes
    ----------
    problem : str
        Reason why the rotors must not be commanded, as in `FlightControl`.
    """

    problem = ''

    def __init__(
        self,
        drone: DroneConfig,
        body: MassProperties,
        gains: Px4AllGains,
        knows_loops: bool = True,
        holds_heading: bool = True,
    ) -> None:
        self._holds_heading = holds_heading
        self._allocation = Allocation(drone)
        most = drone.column('thrust_max')
        matrix = np.abs(self._allocation.matrix)
        self._thrust_max = float(matrix[2] @ most)
        self._torque_unit = torque_unit(drone)
        self._body = body
        self._loops = Px4Loops(gains, body.mass * GRAVITY / self._thrust_max)
        self._acceleration = tilt_ahead(gains, drone) if knows_loops else SetPointAcceleration()

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward | None = None
    ) -> Array:
        """Return the rotors' thrusts (n,) [N] that move the drone to the target."""
        wanted = target.acceleration
        if arm is not None:
            wanted = wanted + self._acceleration.update(arm, state.rotation, dt)
        yaw = heading(target.yaw) if self._holds_heading else np.nan
        set_point = Px4SetPoint(ned(target.position), yaw, ned(target.velocity), ned(wanted))
        return self._thrusts(state, set_point, dt)

    def level(self, state: FlightState, dt: float) -> Array:
        """Return thrusts (n,) [N] for a level descent, used if the position is unknown."""
        sinking = np.array([0.0, 0.0, (1.0 - _SINK) * GRAVITY])
        here = Px4SetPoint(
            ned(state.position), heading(yaw_of(state.rotation)), np.zeros(3), sinking
        )
        return self._thrusts(state, here, dt)

    def _thrusts(self, state: FlightState, wanted: Px4SetPoint, dt: float) -> Array:
        vehicle = Px4State(
            ned(state.position),
            ned(state.velocity),
            frd_rotation(state.rotation),
            frd_to_flu(state.rate),
        )
        thrust, moment = self._loops.update(vehicle, wanted, dt)
        force = np.array([0.0, 0.0, thrust * self._thrust_max])
        wrench = np.concatenate([force, frd_to_flu(moment * self._torque_unit)])
        return self._allocation.thrusts(wrench)
