"""Solver that fits joint coefficients so that simulated positions match measured positions."""

import numpy as np
from scipy.optimize import lsq_linear

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import JointModel
from aerarm_ros.identification.rollout import Rollout, RolloutWindows
from aerarm_ros.motion.signals import Array

_ROUNDS = 8
_SETTLED = 1e-3  # relative change of the cost at convergence
_SHORTEST = 0.05  # shortest Gauss-Newton step
# Errors within one window are correlated, so a window counts as this number of independent
# samples.
_INDEPENDENT = 2.0


def solve_output_error(
    model: JointModel, windows: RolloutWindows, start: Array, std: Array
) -> Array:
    """Fit the joint coefficients, so that simulated positions match the measured positions.

    Torque contains little information about friction near zero velocity, where it changes within
    one sample; positions contain more. The Gauss-Newton iteration starts at a consistent estimate,
    which is also the prior. Links and signs stay unchanged, so the result is consistent.

    Parameters
    ----------
    windows : RolloutWindows
        Windows of the identification bags.
    start : (p,) ndarray
        Initial estimate.
    std : (k,) ndarray
        Standard deviations of its joint coefficients.

    Returns
    -------
    (p,) ndarray

    Raises
    ------
    IdentificationError
        If there are no windows, or a simulation diverges.
    """
    if not windows.count:
        raise IdentificationError(
            'no half-second window of the motion has the torque of every joint: record a '
            'longer motion'
        )
    rollout = Rollout(model, windows)
    fixed = len(start) - len(std)
    signed = np.array([term.nonnegative for _, term in model.joint_columns], dtype=bool)
    least = np.where(signed, 0.0, -np.inf)
    best = _Trial(rollout, windows, start)
    if not np.isfinite(best.left).all():
        raise IdentificationError('the simulation of the arm diverges')
    rms = np.sqrt((best.left**2).mean(axis=(0, 1)))
    weight = np.sqrt(_INDEPENDENT / best.left.shape[1]) / np.maximum(rms, 1e-9)
    cost = best.cost(weight, start, std)
    for _ in range(_ROUNDS):
        step = best.step(weight, start, std, least)
        before, length = cost, 1.0
        while length > _SHORTEST:
            values = np.maximum(best.theta[fixed:] + length * step, least)
            tried = _Trial(rollout, windows, np.concatenate([start[:fixed], values]))
            cost = tried.cost(weight, start, std)
            if cost < before:
                best = tried
                break
            length *= 0.5
        else:
            break
        if before - cost < _SETTLED * before:
            break
    return best.theta


class _Trial:
    """Simulation with one parameter vector (p,): position residuals, and their derivatives."""

    def __init__(self, rollout: Rollout, windows: RolloutWindows, theta: Array) -> None:
        positions, self.slopes = rollout.sensitivities(theta)
        self.theta = theta
        self.left = windows.q[:, 1:] - positions

    def cost(self, weight: Array, start: Array, std: Array) -> float:
        """Return the normalized squared error plus the squared distance from the start."""
        moved = (self.theta - start)[-len(std) :] / std
        total = float(((self.left * weight) ** 2).sum() + moved @ moved)
        return total if np.isfinite(total) else np.inf

    def step(self, weight: Array, start: Array, std: Array, least: Array) -> Array:
        """Return a Gauss-Newton step (k,) of the parameters, from all parts of the motion."""
        values, first = self.theta[-len(std) :], start[-len(std) :]
        rows = (self.slopes * weight[:, None]).reshape(-1, len(std))
        system = np.vstack([rows, np.diag(1.0 / std)])
        wanted = np.concatenate([(self.left * weight).ravel(), (first - values) / std])
        limits = (np.minimum(least - values, -1e-12), np.full(len(std), np.inf))
        return np.asarray(lsq_linear(system, wanted, limits).x)
