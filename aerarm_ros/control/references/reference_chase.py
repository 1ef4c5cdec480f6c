"""Joint reference that follows another reference with limited velocity and acceleration."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from aerarm_ros.control.checks import JointLimits
from aerarm_ros.motion.signals import Array, JointReference


class MotionLimit(NamedTuple):
    """Limits of a streamed joint motion, whose further path is unknown.

    Attributes
    ----------
    acceleration_max : (n,) ndarray
        Largest acceleration of each joint [rad/s^2].
    turning : (n,) ndarray
        Rotation of the drone per velocity of each joint [-], without a moment of its rotors.
    turn_max : float
        Largest magnitude of `turning dq` [rad/s].
    """

    acceleration_max: Array
    turning: Array
    turn_max: float

    def within(self, dq: Array, ddq: Array, rate: float) -> Array:
        """Return joint accelerations (n,) that keep the drone's rotation below its limit.

        Parameters
        ----------
        dq, ddq : (n,) ndarray
            Velocity [rad/s] and wanted acceleration [rad/s^2].
        rate : float
            Rate of the approach [1/s].
        """
        turn, change = float(self.turning @ dq), float(self.turning @ ddq)
        low, high = rate * (-self.turn_max - turn), rate * (self.turn_max - turn)
        beyond = change - min(max(change, low), high)
        if beyond == 0.0:
            return ddq
        part: Array = self.turning * (beyond / float(self.turning @ self.turning))
        return ddq - part


# Rates [1/s] at which the velocity reaches its goal, and at which the position does.
_VELOCITY_RATE, _POSITION_RATE = 20.0, 5.0
_SHARE = 0.4  # of the joints' own acceleration limits
_BRAKE_SHARE = 0.5  # of the acceleration, for braking at the followed reference
_BRAKE_TIME = 0.4  # [s] in which each joint can brake
_JOINED = 1e-4, 2e-3  # [rad], [rad/s] at which the followed reference is reached
_LIMIT_MARGIN = 1e-3  # [rad]
_REFRESHED = 0.01  # [s] after which limits are computed again; they take 0.1 ms of the loop


class ReferenceChase:
    """Follows a joint reference, delayed where velocity and acceleration limits require it.

    With the largest acceleration a of a joint, the joint aims at the followed velocity plus an
    approach from which it can brake::

        dq_w  = dq_r + sign(e) min(5 |e|, sqrt(a |e| / 2)),    e = q_r - q,    |dq_w| <= a 0.4 s
        ddq   = ddq_r + 20 (dq_w - dq),                        |ddq| <= a

    Far from the reference, `dq_r` and `ddq_r` fade. ddq loses the part that turns the drone faster
    than `MotionLimit.turn_max`. A joint that must brake for this reason, or before a position
    limit, does so beyond a.

    Parameters
    ----------
    limits : JointLimits
        Limits of the joints.
    limit : callable
        Returns the limits for position (n,) [rad], velocity (n,) [rad/s] and the joints' own
        acceleration limits (n,) [rad/s^2], such as `RotorGovernor.motion_limits`.

    Attributes
    ----------
    is_behind : bool
        Whether the result differs from the followed reference.
    """

    def __init__(
        self, limits: JointLimits, limit: Callable[[Array, Array, Array], MotionLimit]
    ) -> None:
        self._limits, self._limit = limits, limit
        self.start(JointReference.at_rest(np.zeros(limits.n)))

    def start(self, reference: JointReference) -> None:
        """Start exactly at a reference."""
        self._now = reference
        self.is_behind = False
        self._present: MotionLimit | None = None
        self._age = 0.0

    def update(self, followed: JointReference, dt: float, is_limited: bool) -> JointReference:
        """Return the limited reference; the previous call was `dt` [s] before.

        Parameters
        ----------
        followed : JointReference
            Followed reference, (n,) each.
        is_limited : bool
            Whether the followed reference may exceed the limits.
        """
        self._age += dt
        if not self.is_behind and not (is_limited and self._is_beyond(followed)):
            self._now = followed
            return followed
        q, dq, _ = self._now
        ddq = self._acceleration(followed, q, dq)
        self._now = JointReference(q + dt * (dq + (0.5 * dt) * ddq), dq + dt * ddq, ddq)
        position, velocity = _JOINED
        near = np.abs(followed.q - self._now.q) < position
        near &= np.abs(followed.dq - self._now.dq) < velocity
        self.is_behind = not near.all()
        return self._now

    def ahead(self, followed: JointReference, times: Array, is_limited: bool) -> JointReference:
        """Predict the limited references (M, n) at times (M,) [s] while a motion is followed.

        The first time is that of the last update.
        """
        kept = self._now, self.is_behind, self._present, self._age
        steps = np.diff(times, prepend=times[0]).tolist()
        rows = [
            self.update(JointReference(*row), step, is_limited)
            for step, row in zip(steps, zip(*followed, strict=True), strict=True)
        ]
        self._now, self.is_behind, self._present, self._age = kept
        return JointReference(*map(np.array, zip(*rows, strict=True)))

    def _bounds(self, q: Array, dq: Array) -> tuple[Array, Array, MotionLimit]:
        """Return acceleration and velocity limits (n,) of the joints, and the `MotionLimit`."""
        if self._present is None or self._age >= _REFRESHED:
            self._present = self._limit(q, dq, _SHARE * self._limits.acceleration_max)
            self._age = 0.0
        limit = self._present
        fastest = np.minimum(_BRAKE_TIME * limit.acceleration_max, self._limits.velocity_max)
        return limit.acceleration_max, fastest, limit

    def _is_beyond(self, followed: JointReference) -> bool:
        q, dq, ddq = followed
        acceleration, speed, limit = self._bounds(q, dq)
        beyond = (np.abs(ddq) > acceleration) | (np.abs(dq) > speed)
        return bool(beyond.any()) or abs(float(limit.turning @ dq)) > limit.turn_max

    def _acceleration(self, followed: JointReference, q: Array, dq: Array) -> Array:
        most, fastest, limit = self._bounds(q, dq)
        error = followed.q - q
        distance = np.abs(error)
        fed = np.maximum(1.0 - distance / (_BRAKE_TIME * fastest), 0.0)
        speed = np.minimum(_POSITION_RATE * distance, np.sqrt(_BRAKE_SHARE * most * distance))
        wanted = fed * np.clip(followed.dq, -fastest, fastest) + np.sign(error) * speed
        wanted = np.clip(wanted, -fastest, fastest)
        ddq = np.clip(fed * followed.ddq + _VELOCITY_RATE * (wanted - dq), -most, most)
        return self._within_positions(q, dq, limit.within(dq, ddq, _VELOCITY_RATE))

    def _within_positions(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return `ddq` limited so that no joint passes a position limit."""
        most = self._limits.acceleration_max
        left = np.maximum(self._limits.position_max - _LIMIT_MARGIN - q, 0.0)
        right = np.maximum(q - self._limits.position_min - _LIMIT_MARGIN, 0.0)
        high = _VELOCITY_RATE * (np.sqrt(most * left) - dq)
        low = _VELOCITY_RATE * (-np.sqrt(most * right) - dq)
        bounded: Array = np.clip(ddq, np.maximum(low, -most), np.minimum(high, most))
        return bounded
