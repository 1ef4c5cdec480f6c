"""PX4's cascade of loops, from a set point to thrust and moment."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from aerarm_ros.autopilot.px4 import Px4Gains, frd_rotation, heading, ned, torque_unit
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.control.base.base_motion import frd_to_flu, quaternion
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_control import Allocation
from aerarm_ros.flight.flight_state import FlightState, FlightTarget, yaw_of
from aerarm_ros.model.inertia import cross
from aerarm_ros.motion.signals import Array

_INTEGRAL_MAX = GRAVITY  # [m/s^2] of the velocity's
_RATE_INTEGRAL_MAX = 0.3  # MC_RR_INT_LIM
_YAW_WEIGHT = 0.4  # MC_YAW_WEIGHT
_VELOCITY_CUTOFF = 5.0  # [Hz] MPC_VELD_LP, of the derivative of the velocity
_SPIN_CUTOFF = 20.0  # [Hz] IMU_DGYRO_CUTOFF, of the angular acceleration


def _low_pass_share(cutoff: float, dt: float) -> float:
    """Return the share of a new value in a first-order low-pass filter with a cut-off [Hz]."""
    return float(1.0 - np.exp(-2.0 * np.pi * cutoff * dt))


class Px4SetPoint(NamedTuple):
    """The fields of px4_msgs/TrajectorySetpoint that its position loop reads, north-east-down.

    Attributes
    ----------
    position : (3,) ndarray
        [m]
    yaw : float
        From north to the right [rad]; NaN leaves the heading to itself.
    velocity, acceleration : (3,) ndarray
        [m/s], [m/s^2]; NaN where there is none.
    """

    position: Array
    yaw: float
    velocity: Array
    acceleration: Array


class Px4State(NamedTuple):
    """Where the vehicle is, north-east-down, its body forward-right-down.

    Attributes
    ----------
    position, velocity : (3,) ndarray
        [m], [m/s]
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
    """Position P, velocity PID, attitude P on the quaternion, angular velocity PID.

    As in PX4's modules mc_pos_control (PositionControl.cpp), mc_att_control (AttitudeControl.cpp,
    Brescianini, Hehn and D'Andrea 2013) and mc_rate_control; the acceleration of a set point is
    added behind the velocity's PID, and the hover thrust stands for the weight.

    Parameters
    ----------
    gains : Px4Gains
    hover_thrust : float
        As a share of the largest thrust: what PX4's estimator has found.
    """

    def __init__(self, gains: Px4Gains, hover_thrust: float) -> None:
        self._gains = g = gains
        self._hover_thrust = hover_thrust
        self._position_p = np.array([g.mpc_xy_p, g.mpc_xy_p, g.mpc_z_p])
        self._velocity_p = np.array([g.mpc_xy_vel_p_acc, g.mpc_xy_vel_p_acc, g.mpc_z_vel_p_acc])
        self._velocity_i = np.array([g.mpc_xy_vel_i_acc, g.mpc_xy_vel_i_acc, g.mpc_z_vel_i_acc])
        self._velocity_d = np.array([g.mpc_xy_vel_d_acc, g.mpc_xy_vel_d_acc, g.mpc_z_vel_d_acc])
        self._rate_p = np.array([*[g.mc_rate_k * g.mc_rate_p] * 2, g.mc_yawrate_p])
        self._rate_i = np.array([*[g.mc_rate_k * g.mc_rate_i] * 2, g.mc_yawrate_i])
        self._rate_d = np.array([*[g.mc_rate_k * g.mc_rate_d] * 2, 0.0])
        self.reset()

    def reset(self) -> None:
        """Forget integrals and derivatives."""
        self._push, self._moment = np.zeros(3), np.zeros(3)
        self._velocity: Array | None = None
        self._rate: Array | None = None
        self._yaw_torque: float | None = None
        self._acceleration, self._spin = np.zeros(3), np.zeros(3)

    def update(self, state: Px4State, wanted: Px4SetPoint, dt: float) -> tuple[float, Array]:
        """Return normalised thrust and torque (3,), forward-right-down.

        `dt` is the time since the last update [s].
        """
        thrust = self._thrust(state, wanted, dt)
        # Without one it takes the heading that is, so that only its angular velocity is damped.
        yaw = yaw_of(state.rotation) if np.isnan(wanted.yaw) else wanted.yaw
        return float(np.linalg.norm(thrust)), self._torque(state, thrust, yaw, dt)

    def _thrust(self, state: Px4State, wanted: Px4SetPoint, dt: float) -> Array:
        """Return the thrust (3,) in the world, as a share of the largest."""
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
        """Return the angular velocity that is asked for, in body axes [rad/s]."""
        tilt = _between(rotation[:, 2], wanted[:, 2])  # the shortest way for the thrust
        reduced = tilt @ rotation
        # What is left is a turn about the body's z.
        left = reduced.T @ wanted
        turn = np.arctan2(left[1, 0], left[0, 0])
        around = pin.exp3(np.array([0.0, 0.0, _YAW_WEIGHT * turn]))
        error = _sine_vector(rotation.T @ (reduced @ around))
        gains = self._gains
        rates: Array = error * [gains.mc_att_p, gains.mc_att_p, gains.mc_yaw_p / _YAW_WEIGHT]
        return rates


def _attitude(down: Array, yaw: float) -> Array:
    """Return the attitude whose z axis is `down` and whose heading is `yaw` [rad]."""
    side = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    x = cross(side, down)
    x /= np.linalg.norm(x)
    return np.column_stack([x, cross(down, x), down])


def _between(start: Array, end: Array) -> Array:
    """Return the rotation that turns one unit vector to another by the shortest way."""
    return np.array(pin.Quaternion.FromTwoVectors(start, end).toRotationMatrix())


def _sine_vector(rotation: Array) -> Array:
    """Return twice the quaternion's vector part of a rotation, its scalar part positive."""
    x, y, z, w = quaternion(rotation)
    vector: Array = np.copysign(2.0, w) * np.array([x, y, z])
    return vector


_SINK = 0.97  # share of the weight that is lifted where the height is not known


class Px4Flight:
    """`Px4Loops` on a drone's rotors, used as a `FlightControl`.

    All that reaches the loops of the arm is the acceleration of a set point: neither its weight's
    moment nor its inertia. The hover thrust is that of drone and arm at rest.

    Parameters
    ----------
    drone : DroneConfig
    body : MassProperties
        Of drone and arm at rest.
    gains : Px4Gains
    knows_loops : bool
        Whether the loops' gains serve to lean ahead.
    holds_heading : bool
        Whether set points have a heading; else it is left to itself.

    Attributes
    ----------
    problem : str
        As a `FlightControl` has it.
    """

    problem = ''

    def __init__(
        self,
        drone: DroneConfig,
        body: MassProperties,
        gains: Px4Gains,
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
        self._acceleration = SetPointAcceleration()
        if knows_loops:
            rate_gain = gains.mc_rate_k * gains.mc_rate_p * float(self._torque_unit[0])
            lasting = gains.mc_rate_i / gains.mc_rate_p
            self._acceleration = SetPointAcceleration(gains.mc_att_p, rate_gain, lasting)

    def reset(self) -> None:
        """Forget integrals."""
        self._loops.reset()

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward | None = None
    ) -> Array:
        """Return the thrusts (n,) [N] that lead to the target, after a step of `dt` [s]."""
        wanted = target.acceleration
        if arm is not None:
            wanted = wanted + self._acceleration.update(arm, state.rotation, dt)
        yaw = heading(target.yaw) if self._holds_heading else np.nan
        set_point = Px4SetPoint(ned(target.position), yaw, ned(target.velocity), ned(wanted))
        return self._thrusts(state, set_point, dt)

    def level(self, state: FlightState, dt: float) -> Array:
        """Return the thrusts (n,) [N] of a drone that knows its attitude only: level, sinking."""
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
