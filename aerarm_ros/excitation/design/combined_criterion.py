"""Several criteria at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aerarm_ros.excitation.design.design_criterion import DesignCriterion
from aerarm_ros.motion.float_array import FloatArray


class CombinedCriterion:
    """Weighted sum of criteria; all of them are logarithms, so weights compare factors.

    Parameters
    ----------
    parts : (weight, criterion) pairs.
    """

    def __init__(self, parts: Sequence[tuple[float, DesignCriterion]]) -> None:
        self._parts = tuple(parts)

    def evaluate(self, stacked: FloatArray) -> tuple[float, FloatArray]:
        """Return value and derivative; see `DesignCriterion`."""
        value, gradient = 0.0, np.zeros_like(stacked)
        for weight, criterion in self._parts:
            part, part_gradient = criterion.evaluate(stacked)
            value += weight * part
            gradient += weight * part_gradient
        return value, gradient
