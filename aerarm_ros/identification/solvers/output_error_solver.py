"""Coefficients of the joints by simulated positions (output error), the links left as they are."""

import numpy as np

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import JointModel
from aerarm_ros.identification.rollout import Rollout, RolloutWindows
from aerarm_ros.motion.signals import Array

_ROUNDS = 8
_SETTLED = 1e-3  # of the cost
_SHORTEST = 0.05  # of a Gauss-Newton step
# Errors of one window grow together: it is worth so many independent ones.
_INDEPENDENT = 2.0


def solve_output_error(
    model: JointModel, windows: RolloutWindows, start: Array, std: Array
) -> Array:
    """Minimise the position error of simulated windows over the joints' coefficients.

    Torque says little of friction near zero velocity, where it changes within one sample; the
    position that the arm then takes says more. Gauss-Newton from a consistent estimate, which
    is the prior as well: links and signs stay as they are, and so does consistency.

    Parameters
    ----------
    model : JointModel
    windows : RolloutWindows
        Of the bags to identify from.
    start : (p,) ndarray
        The estimate to begin with.
    std : (k,) ndarray
        Standard deviations of the joints' coefficients in it.

    Returns
    -------
    (p,) ndarray

    Raises
    ------
    IdentificationError
        If there are no windows, or the arm runs away in one.
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
    """Parameters (p,), what simulation with them leaves of positions, and the derivatives."""

    def __init__(self, rollout: Rollout, windows: RolloutWindows, theta: Array) -> None:
        positions, self.slopes = rollout.sensitivities(theta)
        self.theta = theta
        self.left = windows.q[:, 1:] - positions

    def cost(self, weight: Array, start: Array, std: Array) -> float:
        """Return the squared error, in units of what there was, and the distance from the start."""
        moved = (self.theta - start)[-len(std) :] / std
        total = float(((self.left * weight) ** 2).sum() + moved @ moved)
        return total if np.isfinite(total) else np.inf

    def step(self, weight: Array, start: Array, std: Array, least: Array) -> Array:
        """Return the (k,) change that would be best if positions were linear in it."""
        # Imported here: it takes long, and few ask for this solver.
        from scipy.optimize import lsq_linear

        values, first = self.theta[-len(std) :], start[-len(std) :]
        rows = (self.slopes * weight[:, None]).reshape(-1, len(std))
        system = np.vstack([rows, np.diag(1.0 / std)])
        wanted = np.concatenate([(self.left * weight).ravel(), (first - values) / std])
        limits = (np.minimum(least - values, -1e-12), np.full(len(std), np.inf))
        return np.asarray(lsq_linear(system, wanted, limits).x)
