"""Which combinations of parameters an arm can show at all, whatever its motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.design.smooth_regressor import SmoothRegressor
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference


@dataclass(frozen=True, eq=False)
class IdentifiableSpace:
    """Row space of the regressor over all motions.

    Parameters
    ----------
    basis : (p, r) orthonormal basis of the identifiable combinations; r is the rank.
    base_columns : (r,) columns that span the regressor, well conditioned: base parameters.
    """

    basis: FloatArray
    base_columns: NDArray[np.intp]

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return int(self.basis.shape[1])

    @classmethod
    def of_regressor(
        cls, robot: Robot, regressor: SmoothRegressor, columns: slice, samples: int = 400
    ) -> IdentifiableSpace:
        """Find the space numerically from random states.

        Parameters
        ----------
        robot : arm, for its position limits.
        regressor : its regressor.
        columns : which columns are to be identified.
        samples : random states; a few times more than columns a joint.
        """
        generator = np.random.default_rng(0)
        low = np.maximum(robot.position_min, -np.pi)
        high = np.minimum(robot.position_max, np.pi)
        size = (samples, robot.n)
        states = JointReference(
            generator.uniform(low, high, size),
            generator.normal(0.0, 2.0, size),
            generator.normal(0.0, 5.0, size),
        )
        stacked = regressor.stack(states)[:, :, columns]
        matrix = stacked.reshape(-1, stacked.shape[2])
        _, singular, rows = np.linalg.svd(matrix, full_matrices=False)
        rank = int((singular > 1e-9 * singular[0] * max(matrix.shape) ** 0.5).sum())
        norms = np.linalg.norm(matrix, axis=0)
        # A column that is zero but for rounding must not be blown up to a norm of one.
        scales = np.where(norms > 1e-9 * norms.max(), norms, np.inf)
        _, _, pivots = scipy.linalg.qr(matrix / scales, mode='economic', pivoting=True)
        return cls(rows[:rank].T, np.sort(pivots[:rank]))
