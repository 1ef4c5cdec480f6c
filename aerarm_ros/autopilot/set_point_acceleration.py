"""Acceleration in the set points of an autopilot that compensates the arm's motion."""

import numpy as np
import pinocchio as pin

from aerarm_ros.control.checks import non_negative_number
from aerarm_ros.description.drone_config import GRAVITY
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_state import yaw_of
from aerarm_ros.model.inertia import cross
from aerarm_ros.motion.signals import Array

_UP = np.array([0.0, 0.0, 1.0])
_TURN_MAX = 0.5  # [rad] largest correction of the heading
_LIFT_MIN = 0.3  # of the weight; less lift would need a larger tilt
_LEAN_MAX = 0.35  # [rad] largest tilt in addition to that of the force


class SetPointAcceleration:
    """Feedforward of the arm's motion for an autopilot that accepts only an acceleration.

    The acceleration against the force f of the joints' motion is `-f / m`; the autopilot's hover
    thrust carries the weight. PX4 (MPC_ACC_DECOUPLE) and ArduCopter tilt the drone by `atan(a / g)`
    for a horizontal acceleration a, whatever the vertical thrust T is. The horizontal acceleration
    is therefore multiplied by `m g / T`, so that the tilted thrust has the horizontal part `m a`.
    The autopilot tilts with the delay of its attitude loop, and accepts no
    moment. If the gains of its attitude and angular-velocity
    loops are known, the set point adds the tilt `delta`, the inverse of these loops::

        delta = (w + (J dw/dt + M) / k) / p

    with the angular velocity w of the fed-forward force's direction, the inertia J, and the moment
    M by which the rotors balance the arm's weight and motion. The gain p is the angular velocity
    per attitude error, and k the moment per error of the angular velocity. The integral of the
    autopilot's loops compensates a constant M.

    Parameters
    ----------
    attitude_gain : float
        Gain p of the autopilot's attitude loop [1/s]; 0 if unknown.
    rate_gain : float
        Gain k of the autopilot's angular-velocity loop [Nm s/rad]; 0 if unknown.
    integral_rate : float
        Integral gain of the angular-velocity loop, divided by k [1/s].
    yaw_gain : float
        Moment about the vertical per error of the heading [Nm/rad], only for `turn`.
    ignores_lift : bool
        Whether the tilt for an acceleration does not depend on the vertical thrust.

    Raises
    ------
    ValueError
        If a value is negative.
    """

    def __init__(
        self,
        attitude_gain: float = 0.0,
        rate_gain: float = 0.0,
        integral_rate: float = 0.0,
        yaw_gain: float = 0.0,
        ignores_lift: bool = True,
    ) -> None:
        self._ignores_lift = ignores_lift
        self._attitude_gain = non_negative_number('attitude_gain', attitude_gain)
        self._rate_gain = non_negative_number('rate_gain', rate_gain)
        self._integral_rate = non_negative_number('integral_rate', integral_rate)
        self._yaw_gain = non_negative_number('yaw_gain', yaw_gain)
        self._lasting: Array | None = None

    def update(self, arm: FeedForward, rotation: Array, dt: float) -> Array:
        """Return the set point's acceleration (3,) [m/s^2], in world axes with z up.

        Parameters
        ----------
        arm : FeedForward
        rotation : (3, 3) ndarray
            Attitude of the body, forward-left-up, in the world.
        dt : float
            Time since the last call [s].
        """
        level = pin.exp3(yaw_of(rotation) * _UP)
        tilt = -arm.wrench[:3] / _lift(arm)
        if self._attitude_gain > 0.0:
            tilt = tilt + cross(self._lean(arm, dt), _UP)
        per_tilt = GRAVITY if self._ignores_lift else _lift(arm) / arm.body.mass
        x, y, _ = per_tilt * level @ tilt
        return np.array([x, y, -arm.wrench[2] / arm.body.mass])

    def turn(self, arm: FeedForward, dt: float) -> Array:
        """Return the attitude offset (3,) [rad] that makes the autopilot produce a moment M.

        The offset is in level axes. The offset applies only to a drone with tilted rotors, which
        produces a horizontal force without tilting.
        """
        if self._attitude_gain == 0.0 or self._rate_gain == 0.0:
            return np.zeros(3)
        body = arm.body
        thrust = body.mass * GRAVITY * _UP - arm.wrench[:3]
        about_centre = arm.wrench[3:] - cross(body.centre, arm.wrench[:3])
        moment = self._passing(cross(body.centre, thrust) - about_centre, dt)
        turn = _bounded(moment / (self._rate_gain * self._attitude_gain))
        if self._yaw_gain > 0.0:
            turn[2] = min(max(moment[2] / self._yaw_gain, -_TURN_MAX), _TURN_MAX)
        return turn

    def _lean(self, arm: FeedForward, dt: float) -> Array:
        """Return the additional anticipatory tilt `delta` (3,) [rad], in level axes."""
        body, lift = arm.body, _lift(arm)
        # Derivatives of the tilt u = -f / T, with T' = -f_z', or 0 at the smallest lift.
        is_free = lift > _LIFT_MIN * body.mass * GRAVITY
        falling, bending = is_free * arm.force_rate[2], is_free * arm.force_curvature[2]
        tilt = -arm.wrench[:3] / lift
        speed = (tilt * falling - arm.force_rate) / lift
        rate = cross(_UP, speed)
        if self._rate_gain > 0.0:
            change = tilt * bending + 2.0 * speed * falling
            spin = cross(_UP, change - arm.force_curvature) / lift
            about_centre = arm.wrench[3:] - cross(body.centre, arm.wrench[:3])
            moment = cross(body.centre, lift * _UP) - about_centre
            rate = rate + (body.inertia @ spin + self._passing(moment, dt)) / self._rate_gain
        return _bounded(rate / self._attitude_gain)

    def _passing(self, moment: Array, dt: float) -> Array:
        """Return the varying part (3,) of a moment, which the integral cannot compensate."""
        if self._lasting is None:
            self._lasting = moment
        share = 1.0 - np.exp(-self._integral_rate * dt)
        self._lasting = self._lasting + share * (moment - self._lasting)
        return moment - self._lasting


def _lift(arm: FeedForward) -> float:
    """Return the vertical thrust [N] that balances weight and the vertical force of the arm."""
    weight = arm.body.mass * GRAVITY
    return float(max(weight - arm.wrench[2], _LIFT_MIN * weight))


def _bounded(turn: Array) -> Array:
    """Return a rotation vector (3,) without its vertical component, limited to 0.35 rad."""
    tilt = turn * [1.0, 1.0, 0.0]
    return np.asarray(tilt * min(1.0, _LEAN_MAX / max(float(np.linalg.norm(tilt)), 1e-9)))
