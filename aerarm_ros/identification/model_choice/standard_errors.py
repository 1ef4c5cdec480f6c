"""Comparing errors on the same motion: sums over its blocks, and how far apart they are."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.samples import BLOCKS

Array = npt.NDArray[np.float64]


def block_sums(
    blocks: Sequence[npt.NDArray[np.intp]],
    residuals: Sequence[Array],
    counted: Sequence[npt.NDArray[np.bool_]] | None = None,
) -> Array:
    """Return the squared residuals of each block of each bag, summed over the joints.

    Parameters
    ----------
    blocks : sequence of (M,) ndarray of int
        `Samples.block` of each bag.
    residuals : sequence of (M, n) ndarray
        [Nm]; NaN does not count.
    counted : sequence of (M, n) ndarray of bool, optional
        Which ones count; all that are known by default.
    """
    sums = []
    for index, (block, residual) in enumerate(zip(blocks, residuals, strict=True)):
        counts = np.isfinite(residual) if counted is None else counted[index]
        squares = (np.where(counts, residual, 0.0) ** 2).sum(axis=1)
        sums.append(np.bincount(block, squares, BLOCKS))
    return np.concatenate(sums)


def standard_errors(differences: Array) -> float:
    """Return how far from zero the sum of independent differences is, in its standard errors."""
    error = float(differences.std() * np.sqrt(len(differences)))
    return float(differences.sum()) / error if error > 0.0 else 0.0
