"""Homing from its request to its end."""

from __future__ import annotations

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.arm_measurements import ArmMeasurements
from aerarm_ros.hardware.boards.homing import Homing


class ZeroSearch:
    """Starts `Homing` at once, or as soon as the motors are aligned, and runs it.

    Parameters
    ----------
    config
        The arm.
    state
        What its boards report.
    """

    def __init__(self, config: ArmConfig, state: ArmMeasurements) -> None:
        self._config = config
        self._state = state
        self._homing: Homing | None = None
        self._waits = False

    @property
    def is_on(self) -> bool:
        """Whether the zeros are searched, or will be."""
        return self._waits or self._homing is not None

    def begin(self) -> None:
        """Begin now, at the rest posture."""
        self._homing = Homing(self._config, self._state.reported_position, self._state.index_toggle)

    def wait(self) -> None:
        """Begin with the next update: the zeros are already known to a third of a motor turn."""
        self._waits = True

    def end(self) -> None:
        """Search no more."""
        self._homing, self._waits = None, False

    def update(self) -> Homing:
        """Take the last measurements, with aligned motors; return what homing says."""
        state = self._state
        homing = self._homing
        if homing is None:
            homing = self._homing = Homing(
                self._config, state.reported_position, state.index_toggle, state.motor_position
            )
            self._waits = False
        homing.update(state.reported_position, state.index_toggle, state.interval)
        return homing
