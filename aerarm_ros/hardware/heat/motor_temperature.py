"""Estimates the temperatures of one motor from its current."""

from math import exp, inf, sqrt

from aerarm_ros.description.motor_config import COPPER, RATED_AMBIENT, MotorConfig

_COPPER_REFERENCE = 20.0  # [degC] of `COPPER`
# A resistance that a board reports is used within these multiples of the configuration's.
_PLAUSIBLE = (0.5, 2.0)
# No load lasts longer than this [s] in the forecast; it is halved this often, to 0.2 ms.
_HORIZON = 3600.0
_HALVINGS = 24


class MotorTemperature:
    """Two thermal nodes: the winding with its stator, and the housing with its mount.

    Copper loss ``3/2 R i^2`` (thesis section 4.1, amplitude of the phase current) enters the
    winding; it leaves through ``R_wh`` into the housing and through ``R_ha`` into the air. The sum
    of both follows from the continuous current, with which the winding just reaches its largest
    temperature, at 25 degC; ``tau_w = R_wh C_w``, ``tau_h = R_ha C_h``. This is the two-body model
    that motor manufacturers state, for example maxon in "The selection of high-precision
    microdrives", with winding and motor time constants.

    The resistance is the larger one of what the board reports and of what copper makes of the
    configuration's: a board may report a constant of its firmware. If a bench has measured the
    resistance, the first one that the board reports shows a motor that is warm already.

    Plain numbers, not arrays: for four motors that is faster.

    Parameters
    ----------
    motor
        Resistance and thermal data.
    ambient
        Temperature of the air [degC].
    start
        Temperature of winding and housing at first [degC].

    Attributes
    ----------
    winding, housing
        Estimated temperatures [degC].
    """

    __slots__ = (
        '_ambient',
        '_capacity_housing',
        '_capacity_winding',
        '_hottest',
        '_is_measured',
        '_reported',
        '_resistance',
        '_to_ambient',
        '_to_housing',
        'housing',
        'winding',
    )

    def __init__(self, motor: MotorConfig, ambient: float, start: float) -> None:
        thermal = motor.thermal_or_guess
        self._ambient = ambient
        self._resistance = motor.resistance
        self._reported = 0.0
        self.winding = self.housing = max(start, ambient)
        self._hottest = hottest = thermal.temperature_max
        self._is_measured = motor.resistance_std is not None
        loss = 1.5 * self.resistance(hottest) * thermal.continuous_current**2
        total = (hottest - RATED_AMBIENT) / loss
        self._to_ambient = thermal.housing_share * total
        self._to_housing = total - self._to_ambient
        self._capacity_winding = thermal.winding_time / self._to_housing
        self._capacity_housing = thermal.housing_time / self._to_ambient

    def resistance(self, temperature: float) -> float:
        """Return the resistance of a phase [ohm] at a temperature of the winding [degC]."""
        grown = 1.0 + COPPER * (temperature - _COPPER_REFERENCE)
        rated = 1.0 + COPPER * (RATED_AMBIENT - _COPPER_REFERENCE)
        return max(self._reported, self._resistance * grown / rated)

    def report(self, resistance: float) -> None:
        """Take the resistance [ohm] that the board reports; 0 for none."""
        low, high = _PLAUSIBLE
        ratio = resistance / self._resistance
        self._reported = resistance if low < ratio < high else 0.0
        if self._reported and self._is_measured:
            # Once: the motor may be warmer than it was supposed to be at the start.
            self._is_measured = False
            grown = (ratio - 1.0) / COPPER * (1.0 + COPPER * (RATED_AMBIENT - _COPPER_REFERENCE))
            self.winding = max(self.winding, min(RATED_AMBIENT + grown, self._hottest))

    def update(self, square: float, duration: float) -> None:
        """Go on by a duration [s] with a mean squared current [A^2].

        The step is implicit (backward Euler), so that any duration is stable.
        """
        loss = 1.5 * self.resistance(self.winding) * square
        a = duration / (self._capacity_winding * self._to_housing)
        b = duration / (self._capacity_housing * self._to_housing)
        c = duration / (self._capacity_housing * self._to_ambient)
        warmed = self.winding + duration * loss / self._capacity_winding
        aired = self.housing + c * self._ambient
        self.housing = (aired * (1.0 + a) + b * warmed) / ((1.0 + a) * (1.0 + b + c) - a * b)
        self.winding = (warmed + a * self.housing) / (1.0 + a)

    def time_until(self, temperature: float, square: float) -> float:
        """Return the time [s] to a temperature [degC] at a squared current [A^2]; inf for never.

        The solution of the two linear equations, with the resistance at that temperature.
        """
        if self.winding >= temperature:
            return 0.0
        loss = 1.5 * self.resistance(temperature) * square
        steady_housing = self._ambient + loss * self._to_ambient
        steady = steady_housing + loss * self._to_housing
        if steady <= temperature:
            return inf
        out = 1.0 / (self._capacity_winding * self._to_housing)
        into = 1.0 / (self._capacity_housing * self._to_housing)
        away = into + 1.0 / (self._capacity_housing * self._to_ambient)
        root = sqrt((out - away) ** 2 + 4.0 * out * into)
        slow, fast = 0.5 * (root - out - away), 0.5 * (-root - out - away)
        winding, housing = self.winding - steady, self.housing - steady_housing
        rate = out * (housing - winding)
        first = (rate - fast * winding) / (slow - fast)
        second = winding - first
        low, high = 0.0, _HORIZON
        if steady + first * exp(slow * high) + second * exp(fast * high) < temperature:
            return inf
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            reached = steady + first * exp(slow * middle) + second * exp(fast * middle)
            if reached < temperature:
                low = middle
            else:
                high = middle
        return high
