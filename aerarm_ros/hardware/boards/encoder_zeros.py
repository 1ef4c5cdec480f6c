"""Whether it is known where the encoders count from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.command_buffer import Array
from aerarm_ros.model.drive_train import DriveTrain

# Of a motor turn: the rest posture has to be met so well for homing to find the right pulse.
REST_SHARE = 1.0 / 3.0
_TURN = 2.0 * np.pi


class EncoderZeros:
    """Remembers of each joint whether its angle can be believed, and where the arm rests.

    An incremental encoder counts from where its board was switched on. At first the configuration's
    zeros are assumed. Homing finds them, by pulses that come once a motor turn; which turn it is
    follows from the rest posture, for which somebody vouches who puts the arm there. A board that
    restarts, an encoder that jumps or one that stood still while its joint turned has lost its
    zero: then no limit and no load is known until the arm has been homed again.

    Parameters
    ----------
    config
        The arm.

    Attributes
    ----------
    rest
        (n,) motor angles of the rest posture [rad].
    """

    def __init__(self, config: ArmConfig) -> None:
        self.rest: Array = DriveTrain(config).joint_to_motor_position(
            np.array(config.rest_position)
        )
        self._names = config.joint_names
        self._rest_position = config.rest_position
        self._lost: dict[int, str] = {}
        self._is_homed = False

    @property
    def are_lost(self) -> bool:
        """Whether the zero of a joint is unknown."""
        return bool(self._lost)

    def lose(self, joints: Iterable[int], reason: str) -> None:
        """Note that the zeros of joints are unknown from now on; the first reason stays."""
        for joint in joints:
            self._lost.setdefault(joint, reason)

    def found(self) -> None:
        """Note that homing has found the zero of every joint."""
        self._lost.clear()
        self._is_homed = True

    @property
    def problem(self) -> str:
        """Which zeros are unknown, why, and the one way to know them again; '' if none is."""
        if not self._lost:
            return ''
        reasons = dict.fromkeys(self._lost.values())
        names = ', '.join(self._names[joint] for joint in sorted(self._lost))
        return (
            f'the zero of {names} is unknown ({", ".join(reasons)}): bring the arm to its rest '
            f'posture, {self._posture()}, and home it'
        )

    def refusal(self, motor_position: Array) -> str:
        """Return why an arm at motor angles (n,) [rad] may not be homed where it is, or ''.

        Only of zeros that homing has found, and that were not lost since.
        """
        if self._lost or not self._is_homed:
            return ''
        turns = np.abs(motor_position - self.rest) / _TURN
        away = [name for name, part in zip(self._names, turns, strict=True) if part > REST_SHARE]
        if not away:
            return ''
        return (
            f'{", ".join(away)} is not at the rest posture, {self._posture()}: homing would take '
            'another index pulse for the right one; bring the arm there first'
        )

    def vouched(self) -> str:
        """Return what homing takes the present posture for, in words."""
        return f'this is taken for the rest posture, {self._posture()}'

    def _posture(self) -> str:
        return _in_words(self._names, self._rest_position)


def _in_words(names: Sequence[str], angles: Sequence[float]) -> str:
    rows = zip(names, angles, strict=True)
    return ', '.join(f'{name} {angle:.4g}' for name, angle in rows) + ' rad'
