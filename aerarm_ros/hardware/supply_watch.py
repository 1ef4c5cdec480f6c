"""Watch the supply voltage of a board."""

from __future__ import annotations

from math import inf

from aerarm_ros.description.arm_config import PowerStageConfig

# Answers in a row beyond a limit that are no noise: as many milliseconds at 1 kHz.
_IN_ROW = 10  # decision 81
# A warning comes at this share inside the limits, and stays for a time [s] that a person reads in.
_WARNING_SHARE = 0.05
_SHOWN = 5.0


class SupplyWatch:
    """Warns near the limits of the supply voltage, and asks for a stop beyond them.

    A supply that cannot take braking energy back rises with each braking: the stop ends the
    motion that does it. A low supply ends in boards that let the arm fall: a damped one sinks.

    Parameters
    ----------
    name
        Of the board.
    stage
        The limits.

    Attributes
    ----------
    voltage
        Last reading [V], 0 before the first.
    lowest, highest
        Of all readings [V].
    """

    def __init__(self, name: str, stage: PowerStageConfig) -> None:
        self.voltage = 0.0
        self.lowest, self.highest = inf, 0.0
        self._name = name
        self._stage = stage
        self._warn_below = (1.0 + _WARNING_SHARE) * stage.voltage_min
        self._warn_above = (1.0 - _WARNING_SHARE) * stage.voltage_max
        self._low_in_row = self._high_in_row = 0
        self._warning = ''
        self._warned_for = 0.0

    def update(self, voltage: float, duration: float) -> None:
        """Take a reading [V], a time [s] after the last."""
        self.voltage = voltage
        self.lowest, self.highest = min(self.lowest, voltage), max(self.highest, voltage)
        self._low_in_row = self._low_in_row + 1 if voltage < self._stage.voltage_min else 0
        self._high_in_row = self._high_in_row + 1 if voltage > self._stage.voltage_max else 0
        self._warned_for -= duration
        if voltage > self._warn_above:
            self._warn(f'{voltage:.1f} V, near its maximum of {self._stage.voltage_max:g} V')
        elif voltage < self._warn_below:
            self._warn(f'{voltage:.1f} V, near its minimum of {self._stage.voltage_min:g} V')
        elif self._warned_for <= 0.0:
            self._warning = ''

    def stop(self) -> str:
        """Return why the arm has to stop, or ''."""
        if self._high_in_row >= _IN_ROW:
            return (
                f'the supply of {self._name} has {self.voltage:.1f} V, above its limit of '
                f'{self._stage.voltage_max:g} V, because it does not absorb braking energy: use '
                'a battery or a braking resistor, or lower velocity_max'
            )
        if self._low_in_row >= _IN_ROW:
            return (
                f'the supply of {self._name} has {self.voltage:.1f} V, below its limit of '
                f'{self._stage.voltage_min:g} V: support the arm, charge the battery or check '
                'the leads; check profile_scales if the voltage is wrong'
            )
        return ''

    def warning(self) -> str:
        """Return the warning about the supply, or ''."""
        return self._warning

    def _warn(self, text: str) -> None:
        self._warning = f'the supply of {self._name} had {text}'
        self._warned_for = _SHOWN
