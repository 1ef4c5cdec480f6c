"""How warm an emulated motor really gets."""

from __future__ import annotations

import numpy as np

from aerarm_ros.description.joint_config import JointConfig
from aerarm_ros.description.motor_config import MotorConfig

ROOM = 25.0  # [degC]
CRITICAL = 130.0
"""Temperature of a winding at which an emulated board reports its error [degC]."""
# Copper resistance vanishes, by extrapolation, at this temperature [degC] (IEC 60034-1).
_ABSENT = -234.5
# Of the way from copper to housing: thermal resistance and heat capacity on the copper's side.
_COPPER_RESISTANCE, _COPPER_CAPACITY = 0.12, 0.35
# Losses in the stator's iron at this speed [rad/s] are this share of the continuous copper loss.
_IRON_SPEED, _IRON_SHARE = 150.0, 0.1
# Made motors differ from what is known of them by up to this share: thermal resistances, heat
# capacities, resistance of the copper.
_SPREAD = 0.1
_COPPER_SPREAD = 0.05
_SHORTEST = 5.0  # steps in the shortest time constant, for a stable explicit integration


class EmulatedHeat:
    """Three bodies in a row: copper, stator iron, housing; the air beyond them has 25 degC.

    It shares no code with the estimator of `hardware.heat`: there are more bodies, iron losses,
    another numerical method (explicit midpoint) and, with a seed, other parameters.

    Parameters
    ----------
    motor
        Its data, as the configuration states them.
    seed
        Of the deviations; None for a motor as stated.

    Attributes
    ----------
    temperatures
        Of copper, iron and housing [degC].
    """

    def __init__(self, motor: MotorConfig, seed: int | None = None) -> None:
        self.temperatures = [ROOM, ROOM, ROOM]
        draw = [0.0] * 6
        if seed is not None:
            draw = np.random.default_rng(seed).uniform(-1.0, 1.0, 6).tolist()
        off = [1.0 + _SPREAD * value for value in draw]
        data = motor.thermal_or_guess
        self._cold = motor.resistance * (1.0 + _COPPER_SPREAD * draw[5])
        hottest = data.temperature_max
        hot = motor.resistance * (hottest - _ABSENT) / (ROOM - _ABSENT)
        steady_loss = 1.5 * hot * data.continuous_current**2
        whole = (hottest - ROOM) / steady_loss
        inner, outer = (1.0 - data.housing_share) * whole, data.housing_share * whole
        store = data.winding_time / inner
        self._conductance = (
            1.0 / (off[0] * _COPPER_RESISTANCE * inner),
            1.0 / (off[0] * (1.0 - _COPPER_RESISTANCE) * inner),
            1.0 / (off[1] * outer),
        )
        self._capacity = (
            off[2] * _COPPER_CAPACITY * store,
            off[3] * (1.0 - _COPPER_CAPACITY) * store,
            off[4] * data.housing_time / outer,
        )
        self._iron = _IRON_SHARE * steady_loss / _IRON_SPEED**2
        self._longest = self._capacity[0] / (_SHORTEST * self._conductance[0])

    @classmethod
    def of_joint(cls, joint: JointConfig, arm_seed: int | None) -> EmulatedHeat:
        """Return the heat of a joint's motor in the emulated arm of a seed; None: as stated."""
        if arm_seed is None:
            return cls(joint.motor)
        return cls(joint.motor, 2 * (1000 * arm_seed + joint.board) + joint.channel)

    @property
    def copper(self) -> float:
        """Temperature of the copper [degC]."""
        return self.temperatures[0]

    @property
    def resistance(self) -> float:
        """Resistance of a phase at the copper's temperature [ohm]."""
        return self._cold * (self.temperatures[0] - _ABSENT) / (ROOM - _ABSENT)

    def warm(self, temperature: float) -> None:
        """Bring the whole motor to a temperature [degC]."""
        self.temperatures = [temperature, temperature, temperature]

    def step(self, square: float, speed: float, duration: float) -> None:
        """Go on by a duration [s] with a mean squared current [A^2] and a speed [rad/s]."""
        steps = int(duration / self._longest) + 1
        dt = duration / steps
        for _ in range(steps):
            half = self._moved(self._slopes(square, speed), 0.5 * dt)
            before, self.temperatures = self.temperatures, half
            slopes = self._slopes(square, speed)
            self.temperatures = before
            self.temperatures = self._moved(slopes, dt)

    def _moved(self, slopes: tuple[float, float, float], dt: float) -> list[float]:
        return [t + dt * slope for t, slope in zip(self.temperatures, slopes, strict=True)]

    def _slopes(self, square: float, speed: float) -> tuple[float, float, float]:
        copper, iron, housing = self.temperatures
        inside = self._conductance[0] * (copper - iron)
        through = self._conductance[1] * (iron - housing)
        away = self._conductance[2] * (housing - ROOM)
        loss = 1.5 * self.resistance * square
        return (
            (loss - inside) / self._capacity[0],
            (self._iron * speed * speed + inside - through) / self._capacity[1],
            (through - away) / self._capacity[2],
        )
