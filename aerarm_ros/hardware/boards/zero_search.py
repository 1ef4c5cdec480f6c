"""Homing from its request to its end."""

from __future__ import annotations

from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.arm_measurements import ArmMeasurements
from aerarm_ros.hardware.boards.homing import Homing, motion_in_words, no_room
from aerarm_ros.hardware.gate.command_buffer import Array


class ZeroSearch:
    """Starts `Homing` at once, or as soon as the motors are aligned, and runs it.

    Parameters
    ----------
    config
        The arm.
    state
        What its boards report.
    pulse_offset
        (n,) or one for all, as of `Homing` [rad]; each search reads it.

    Attributes
    ----------
    problem
        Why this arm can never be homed, or ''.
    motion
        What homing does to the joints, in words.
    """

    def __init__(
        self, config: ArmConfig, state: ArmMeasurements, pulse_offset: ArrayLike = 0.0
    ) -> None:
        self.problem = no_room(config)
        self.motion = motion_in_words(config)
        self._config = config
        self._state = state
        self._pulse_offset = pulse_offset
        self._homing: Homing | None = None
        self._waits = False

    @property
    def is_on(self) -> bool:
        """Whether the zeros are searched, or will be."""
        return self._waits or self._homing is not None

    def begin(self, expected: Array) -> Homing:
        """Begin now, with the motors at these angles (n,) [rad], to within a third of a turn."""
        state = self._state
        homing = Homing(
            self._config,
            state.reported_position,
            state.index_toggle,
            expected,
            self._pulse_offset,
        )
        self._homing, self._waits = homing, False
        return homing

    def wait(self) -> None:
        """Begin with the next update: the zeros are already known to a third of a motor turn."""
        self._waits = True

    def end(self) -> None:
        """Search no more."""
        self._homing, self._waits = None, False

    def update(self) -> Homing:
        """Take the last measurements, with aligned motors; return what homing says."""
        state = self._state
        homing = self._homing or self.begin(state.motor_position)
        homing.update(state.reported_position, state.index_toggle)
        return homing
