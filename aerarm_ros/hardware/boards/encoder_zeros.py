"""Whether it is known where the encoders count from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.command_buffer import Array
from aerarm_ros.model.drive_train import DriveTrain

# Of a motor turn: the home configuration has to be met so well for homing to find the right pulse.
REST_SHARE = 1.0 / 3.0
_TURN = 2.0 * np.pi


class EncoderZeros:
    """Remembers of each joint whether its zero is known, and the home configuration.

    An incremental encoder counts from where its board was switched on, so its zero is unknown at
    first. Homing finds it, by pulses that come once a motor turn; which turn it is follows from the
    home configuration, to which the user brings the arm. A board that restarts, an encoder that
    jumps or one that stood still while its joint turned has lost its zero: then no limit and no
    load is known until the arm has been homed again.

    An absolute encoder knows its angle whenever its board is switched on: the configuration's zero
    holds at first, and again after a restart.

    Parameters
    ----------
    config
        The arm.
    encoders
        Kind of the encoders of boards whose configuration does not say it: the frame profile's.

    Attributes
    ----------
    rest
        (n,) motor angles of the home configuration [rad].
    absolute
        n flags: whether the joint's encoder is absolute.
    names
        n names of the joints.
    changes
        How often a zero became known or unknown.
    """

    def __init__(self, config: ArmConfig, encoders: str = 'incremental') -> None:
        self.rest: Array = DriveTrain(config).joint_to_motor_position(
            np.array(config.rest_position)
        )
        self.names = config.joint_names
        self.changes = 0
        self._rest_position = config.rest_position
        self.absolute = config.absolute_encoders(encoders)
        self._lost: dict[int, str] = {}
        self.restarted(range(config.n), 'not homed since the bridge started')

    @property
    def are_lost(self) -> bool:
        """Whether the zero of a joint is unknown."""
        return bool(self._lost)

    @property
    def known(self) -> list[bool]:
        """Whether the zero of each of n joints is known."""
        return [joint not in self._lost for joint in range(len(self.names))]

    @property
    def unknown(self) -> list[str]:
        """Names of the joints whose zero is unknown."""
        return [self.names[joint] for joint in sorted(self._lost)]

    def known_only(self, q: Array) -> Array:
        """Return joint positions (n,) [rad] with NaN where the zero is unknown."""
        if not self._lost:
            return q
        known = q.copy()
        known[list(self._lost)] = np.nan
        return known

    def restarted(self, joints: Iterable[int], reason: str) -> None:
        """Note that the boards of joints were switched on, and read absolute encoders again."""
        joints = list(joints)
        self.found(joint for joint in joints if self.absolute[joint])
        self.lose((joint for joint in joints if not self.absolute[joint]), reason)

    def lose(self, joints: Iterable[int], reason: str) -> None:
        """Note that the zeros of joints are unknown from now on; the first reason stays."""
        for joint in joints:
            self.changes += joint not in self._lost
            self._lost.setdefault(joint, reason)

    def explain(self, joints: Iterable[int], reason: str) -> None:
        """Note why zeros that are unknown still are."""
        self._lost.update((joint, reason) for joint in joints if joint in self._lost)

    def found(self, joints: Iterable[int] | None = None) -> None:
        """Note that the zero of joints is known, of every joint if not given."""
        for joint in range(len(self.names)) if joints is None else joints:
            self.changes += self._lost.pop(joint, None) is not None

    @property
    def problem(self) -> str:
        """Which zeros are unknown, why, and the one way to know them again; '' if none is."""
        if not self._lost:
            return ''
        reasons = dict.fromkeys(self._lost.values())
        return (
            f'the zero of {", ".join(self.unknown)} is unknown ({", ".join(reasons)}): bring the '
            f"arm to its home configuration, {self._posture()}, and home it ('arm home')"
        )

    def refusal(self, motor_position: Array) -> str:
        """Return why an arm at motor angles (n,) [rad] may not be homed where it is, or ''.

        Each joint whose zero is known has to be at its home configuration; of the others only the
        user knows it.
        """
        turns = (np.abs(motor_position - self.rest) / _TURN).tolist()
        rows = zip(self.names, turns, self.known, strict=True)
        away = [name for name, part, known in rows if known and part > REST_SHARE]
        if not away:
            return ''
        return (
            f'{", ".join(away)} is not at the home configuration, {self._posture()}: homing would '
            'take another index pulse for the right one; bring the arm there first'
        )

    def expected(self, motor_position: Array) -> Array:
        """Return where homing takes the motors to be (n,) [rad]: absolute ones where they say."""
        return np.where(self.absolute, motor_position, self.rest)

    def vouched(self) -> str:
        """Return what homing takes the present posture for, in words."""
        return f'this is taken for the home configuration, {self._posture()}'

    def _posture(self) -> str:
        return _in_words(self.names, self._rest_position)


def _in_words(names: Sequence[str], angles: Sequence[float]) -> str:
    rows = zip(names, angles, strict=True)
    return ', '.join(f'{name} {angle:.4g}' for name, angle in rows) + ' rad'
