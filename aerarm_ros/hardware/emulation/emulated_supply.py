"""The supply of one emulated board."""

from math import sqrt

_RESISTANCE = 0.05  # [ohm] battery and leads
_VOLTAGE = 24.0  # [V]


class EmulatedSupply:
    """A battery behind its leads, or a supply that cannot sink current and the board's capacitors.

    Attributes
    ----------
    source
        Voltage without a load [V].
    capacitance
        Of the board [F] if its supply takes no current back; 0 for a battery, which does.
    voltage
        At the board [V].
    """

    def __init__(self) -> None:
        self.source = self.voltage = _VOLTAGE
        self.capacitance = 0.0

    def step(self, power: float, duration: float) -> None:
        """Go on by a duration [s] with the power [W] that the motors take."""
        loaded = self.source - _RESISTANCE * power / self.source
        if not self.capacitance or power > 0.0 and self.voltage <= self.source:
            self.voltage = loaded
            return
        # No current flows back: what the motors give stays in the capacitors, C/2 V^2.
        stored = self.voltage**2 - 2.0 * power * duration / self.capacitance
        self.voltage = max(sqrt(max(stored, 0.0)), min(loaded, self.source))
