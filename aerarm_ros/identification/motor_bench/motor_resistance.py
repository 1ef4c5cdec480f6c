"""Resistance of a motor's phase, from what the motor took or from what its board says."""

from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.motor_bench.motor_supply import MotorSupply

VOLTAGE, BOARD = 'voltage', 'board'

_DIVISIBLE = 0.004  # [A] some counts: below, power over current is no voltage
# [A] of a block's mean: the noise of currents, which is in what is fitted and in what it is fitted
# to, would pull a resistance towards zero where there is not much more than noise.
_LEAST_CURRENT = 0.1
_BLOCK = 0.1  # [s]: noise of two blocks is independent
_LEAST_BLOCKS = 6
_KNOWN = 0.3  # relative standard deviation beyond which nothing is known


@dataclass(frozen=True)
class MotorResistance:
    """Resistance of one phase.

    Attributes
    ----------
    ohm, std : float
        Value and its standard deviation [ohm].
    source : str
        'voltage': measured by the voltage that the board reports; 'board': taken over from the
        resistance that the board reports.
    """

    ohm: float
    std: float
    source: str


def find_resistance(supply: MotorSupply, board_uncertainty: float) -> MotorResistance | None:
    """Return a motor's resistance, None if nothing tells it.

    Parameters
    ----------
    supply : MotorSupply
    board_uncertainty : float
        Relative standard deviation of a resistance that a board reports [-].
    """
    stated = supply.reported
    for found in (_fit(supply), MotorResistance(stated, board_uncertainty * stated, BOARD)):
        if found is not None and 0.0 <= found.std < _KNOWN * found.ohm:  # not of NaN
            return found
    return None


def _fit(supply: MotorSupply) -> MotorResistance | None:
    """Fit ``u_q = R i_q + k omega_m``, thesis (4.1) over 3/2 i_q, by least squares."""
    divisible = np.abs(supply.current) > _DIVISIBLE
    current, speed = supply.current[divisible], supply.speed[divisible]
    voltage = supply.power[divisible] / (1.5 * current)
    numbers = np.floor(supply.time[divisible] / _BLOCK)
    _, block, count = np.unique(numbers, return_inverse=True, return_counts=True)
    sums = [np.bincount(block, weights=values) for values in (current, speed, voltage)]
    means = np.column_stack(sums) / count[:, np.newaxis]
    flowing = np.abs(means[:, 0]) > _LEAST_CURRENT
    if flowing.sum() < _LEAST_BLOCKS:
        return None
    rows = np.sqrt(count[flowing])[:, np.newaxis] * means[flowing]
    columns, rest = rows[:, :2], rows[:, 2]
    theta, _, rank, _ = np.linalg.lstsq(columns, rest, rcond=None)
    if rank < columns.shape[1]:
        return None
    residual = rest - columns @ theta
    variance = residual @ residual / (len(rest) - columns.shape[1])
    covariance = variance * np.linalg.inv(columns.T @ columns)
    return MotorResistance(float(theta[0]), float(np.sqrt(covariance[0, 0])), VOLTAGE)
