"""A criterion that only has to be good enough."""

from __future__ import annotations

import numpy as np

from aerarm_ros.excitation.design.design_criterion import DesignCriterion
from aerarm_ros.motion.float_array import FloatArray


class BoundedCriterion:
    """Zero while another criterion is below a limit, and as steep as it above.

    log(1 + exp(s (value - limit))) / s: a hinge with a round corner.

    Parameters
    ----------
    criterion : what is to stay below the limit.
    limit : value of the criterion from which on it counts.
    sharpness : s.
    """

    def __init__(self, criterion: DesignCriterion, limit: float, sharpness: float = 20.0) -> None:
        self._criterion = criterion
        self._limit = limit
        self._sharpness = sharpness

    def evaluate(self, stacked: FloatArray) -> tuple[float, FloatArray]:
        """Return value and derivative; see `DesignCriterion`."""
        value, gradient = self._criterion.evaluate(stacked)
        excess = self._sharpness * (value - self._limit)
        slope = float(np.exp(-np.logaddexp(0.0, -excess)))
        return float(np.logaddexp(0.0, excess)) / self._sharpness, slope * gradient
