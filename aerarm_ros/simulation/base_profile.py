"""Prescribed motion of the arm's base, for simulations."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import cos, pi, radians, sin
from typing import NamedTuple

import numpy as np

from aerarm_ros.motion.polynomial_path import smooth_step
from aerarm_ros.motion.signals import Array


class BaseState(NamedTuple):
    """Pose, velocity and acceleration of the arm's base.

    Attributes
    ----------
    position, velocity, acceleration : (3,) ndarray
        Motion of the base's origin in the world [m], [m/s], [m/s^2].
    quaternion : (4,) ndarray
        (w, x, y, z), base to world.
    angular_velocity, angular_acceleration : (3,) ndarray
        Angular velocity [rad/s] and acceleration [rad/s^2] in base axes.
    """

    position: Array
    quaternion: Array
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array


@dataclass(frozen=True, eq=False)
class BaseProfile:
    """Base motion with a constant tilt, an oscillating rotation and an oscillating translation.

    The rotation is about one axis, so angular velocity and acceleration are those of the angle.
    All oscillations grow smoothly from rest within `ramp`.

    Attributes
    ----------
    axis : (3,) ndarray
        Unit vector of the rotation.
    tilt, swing : float
        Constant and oscillating part of the angle [rad].
    shift : (3,) ndarray
        Amplitude of the oscillating position [m].
    frequency, shift_frequency : float
        Frequencies of the oscillating angle and of the oscillating position [Hz].
    ramp : float
        Time in which the oscillations grow to their amplitude [s].
    """

    axis: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    tilt: float = 0.0
    swing: float = 0.0
    shift: Array = field(default_factory=lambda: np.zeros(3))
    frequency: float = 0.5
    shift_frequency: float = 0.7
    ramp: float = 2.0

    def evaluate(self, time: float) -> BaseState:
        """Return the state of the base at `time` [s]; the base is at rest before time zero."""
        angle, rate, spin = self._oscillation(time, self.frequency)
        offset, speed, surge = self._oscillation(time, self.shift_frequency)
        half = 0.5 * (self.tilt + self.swing * angle)
        quaternion = np.empty(4)
        quaternion[0], quaternion[1:] = cos(half), sin(half) * self.axis
        return BaseState(
            self.shift * offset,
            quaternion,
            self.shift * speed,
            self.swing * rate * self.axis,
            self.shift * surge,
            self.swing * spin * self.axis,
        )

    def _oscillation(self, time: float, frequency: float) -> tuple[float, float, float]:
        """Return a sine whose amplitude grows to 1, and its first two derivatives."""
        step = smooth_step(time / self.ramp)
        grown, growth = float(step.value), float(step.slope) / self.ramp
        bend = float(step.curvature) / self.ramp**2
        w = 2.0 * pi * frequency
        s, c = sin(w * time), cos(w * time)
        return (
            grown * s,
            growth * s + grown * w * c,
            bend * s + 2.0 * growth * w * c - grown * w**2 * s,
        )


STILL, TILTED, MOVING = 'still', 'tilted', 'moving'

BASE_PROFILES: Mapping[str, BaseProfile] = {
    STILL: BaseProfile(),
    TILTED: BaseProfile(axis=np.array([0.8, 0.6, 0.0]), tilt=radians(20.0)),
    # 30 degrees at 0.5 Hz about the roll axis, with a sway.
    MOVING: BaseProfile(swing=radians(30.0), shift=np.array([0.1, 0.15, 0.1])),
}
'Base motions by name: still, tilted by 20 degrees, or swinging by 30 degrees with sway.'
