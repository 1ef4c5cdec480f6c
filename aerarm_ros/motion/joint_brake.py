"""Braking of joints each by itself, where no path is known to stop on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.path_stop import FADE, RISE, SHORTEST
from aerarm_ros.motion.polynomial_path import PolynomialPath


class JointBrake(NamedTuple):
    """Brakings of n joints from (M, n) or (n,) states: jerk-limited, each as short as it can be.

    The acceleration changes linearly to its strongest, stays, and fades linearly to zero. Signs
    are those of the motion: an acceleration against it is positive in `strongest`.

    Attributes
    ----------
    sign : ndarray
        Direction of the motion, -1, 0 or 1.
    speed, rising : ndarray
        Speed [rad/s] at the beginning, and its derivative then [rad/s^2].
    strongest : ndarray
        Largest deceleration [rad/s^2].
    rise, hold, fade : ndarray
        Durations of the three parts [s].
    """

    sign: FloatArray
    speed: FloatArray
    rising: FloatArray
    strongest: FloatArray
    rise: FloatArray
    hold: FloatArray
    fade: FloatArray

    @classmethod
    def of(cls, dq: FloatArray, ddq: FloatArray, acceleration_max: FloatArray) -> JointBrake:
        """Return the brakings from velocities [rad/s] and accelerations [rad/s^2]."""
        sign = np.where(dq == 0.0, np.sign(ddq), np.sign(dq))
        speed, rising = np.abs(dq), sign * ddq
        needed = np.maximum(speed / acceleration_max, SHORTEST)
        # A joint that still gets faster has more to change, and no more time for it.
        rise = RISE * needed / (1.0 + np.maximum(rising, 0.0) / acceleration_max)
        fade = FADE * needed
        # What ends without a part of constant deceleration, if that is weaker.
        strongest = np.minimum(acceleration_max, (2.0 * speed + rising * rise) / (rise + fade))
        left = speed + 0.5 * (rising - strongest) * rise - 0.5 * strongest * fade
        hold = np.where(strongest < acceleration_max, 0.0, left / acceleration_max)
        return cls(sign, speed, rising, strongest, rise, np.maximum(hold, 0.0), fade)

    @property
    def duration(self) -> FloatArray:
        """Time until each joint rests [s]."""
        duration: FloatArray = self.rise + self.hold + self.fade
        return duration

    @property
    def fastest(self) -> FloatArray:
        """Largest speed of each joint [rad/s]: it rises while an acceleration fades."""
        rising = np.maximum(self.rising, 0.0)
        change = np.maximum(rising + self.strongest, 1e-9)
        fastest: FloatArray = self.speed + 0.5 * self.rise * rising**2 / change
        return fastest

    @property
    def travel(self) -> FloatArray:
        """Signed travel of each joint until it rests [rad]."""
        return self.after(self.duration).q

    def after(self, time: FloatArray) -> JointReference:
        """Return travel, velocity and acceleration `time` [s] after the beginning."""
        # Each part in its own time; a part that has not begun adds nothing.
        t1 = np.minimum(time, self.rise)
        t2 = np.minimum(np.maximum(time - self.rise, 0.0), self.hold)
        t3 = np.minimum(np.maximum(time - self.rise - self.hold, 0.0), self.fade)
        change = -(self.strongest + self.rising) / self.rise
        risen = self.speed + t1 * (self.rising + 0.5 * t1 * change)
        held = risen - self.strongest * t2
        fading = self.strongest / self.fade
        travel = (
            t1 * (self.speed + t1 * (0.5 * self.rising + t1 * change / 6.0))
            + t2 * (risen - 0.5 * self.strongest * t2)
            + t3 * (held - t3 * (0.5 * self.strongest - t3 * fading / 6.0))
        )
        dq = held - t3 * (self.strongest - 0.5 * t3 * fading)
        ddq = np.where(time < self.rise, self.rising + t1 * change, t3 * fading - self.strongest)
        return JointReference(self.sign * travel, self.sign * dq, self.sign * ddq)


def brake(start: JointReference, acceleration_max: FloatArray) -> PolynomialPath:
    """Return the motion by which each joint brakes from `start`; it ends at rest."""
    braking = JointBrake.of(start.dq, start.ddq, acceleration_max)
    ends = np.cumsum([braking.rise, braking.hold, braking.fade], axis=0).ravel()
    times = np.unique(np.round(np.append(ends, 0.0), 6))[:, np.newaxis]
    travel, dq, ddq = braking.after(times)
    # The joints rest at the end exactly, not but for rounding.
    dq[-1] = ddq[-1] = 0.0
    return PolynomialPath.quintic(times[:, 0], start.q + travel, dq, ddq)
