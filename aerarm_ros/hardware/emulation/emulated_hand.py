"""A person's hand that turns one joint of an emulated arm while its motors are off."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

_SPEED = 0.6  # [rad/s]
_STIFFNESS = 150.0  # [Nm/rad]
_DAMPING = 3.0  # [Nms/rad]
_STRENGTH = 12.0  # [Nm] at most
_ERROR = 0.01  # [rad] a hand places a joint against a mark or a set square so well
_SETTLING = 0.5  # [s]


def parse_turn(text: str, names: Sequence[str]) -> tuple[int, float]:
    """Read JOINT:ANGLE and return the joint's number and the angle [rad].

    Parameters
    ----------
    text
        As a user writes it.
    names
        Joints of the arm; a prefix that they share may be left out.

    Raises
    ------
    ValueError
        If there is no such joint, or the angle is not a number.
    """
    name, _, number = text.strip().rpartition(':')
    joints = [i for i, known in enumerate(names) if name and known.endswith(name)]
    try:
        angle = float(number)
    except ValueError:
        joints = []
    if len(joints) != 1 or not isfinite(angle):
        listed = ', '.join(names)
        raise ValueError(f'{text!r} is not JOINT:ANGLE with one of {listed} and an angle [rad]')
    return joints[0], angle


class EmulatedHand:
    """Turns a joint slowly to an angle, misses it a little, and lets go.

    Parameters
    ----------
    joint
        Number of the joint.
    start, target
        Angles [rad] where the joint is and where it shall be.
    seed
        Of the error of placement.
    """

    def __init__(self, joint: int, start: float, target: float, seed: int = 0) -> None:
        self.joint = joint
        miss = float(np.random.default_rng([seed, joint]).uniform(-_ERROR, _ERROR))
        self._reference = start
        self._target = target + miss
        self._left = self.duration = abs(self._target - start) / _SPEED + _SETTLING

    @property
    def is_done(self) -> bool:
        """Whether the joint has been let go."""
        return self._left <= 0.0

    def effort(self, q: float, dq: float, duration: float) -> float:
        """Return the torque [Nm] on the joint at q [rad], dq [rad/s], and go on for a time [s]."""
        self._left -= duration
        step = _SPEED * duration
        away = self._target - self._reference
        self._reference += min(max(away, -step), step)
        effort = _STIFFNESS * (self._reference - q) - _DAMPING * dq
        return min(max(effort, -_STRENGTH), _STRENGTH)
