"""Monitoring of the supply voltage of a board."""

from __future__ import annotations

from math import inf

from aerarm_ros.description.arm_config import PowerStageConfig

# Consecutive readings beyond a limit that rule out noise: 10 ms at 1 kHz.
_IN_ROW = 10  # decision 81
# A warning appears at this fraction inside the limits; it stays for this time [s], to be read.
_WARNING_SHARE = 0.05
_SHOWN = 5.0


class SupplyWatch:
    """Warns near the limits of a board's supply voltage, and requests a stop beyond the limits.

    The voltage of a supply that cannot absorb braking energy rises with each braking, so a stop
    must end the motion. At a low voltage the boards would switch off and drop the arm, while an
    arm that was stopped and damped before sinks slowly.

    Parameters
    ----------
    name
        Name of the board.
    stage
        Voltage limits of the supply.

    Attributes
    ----------
    voltage
        Last reading [V], 0 before the first.
    lowest, highest
        Extremes of all readings [V].
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
        """Process a voltage reading [V], a time [s] after the previous one."""
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
        """Return the voltage reason why the arm has to stop, or ''."""
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
        """Return the warning about the supply voltage, or ''."""
        return self._warning

    def _warn(self, text: str) -> None:
        self._warning = f'the supply of {self._name} had {text}'
        self._warned_for = _SHOWN
