"""Recursive Bayesian regression that forgets toward what was known at first."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Belief(NamedTuple):
    """What is known of m parameters.

    Attributes
    ----------
    mean : (m,) ndarray
    information : (m, m) ndarray
        Inverse of the covariance.
    covariance : (m, m) ndarray
    """

    mean: Array
    information: Array
    covariance: Array


class InformationFilter:
    """Parameters in units of their prior's standard deviations, about a mean of zero.

    Forgetting takes information away in favour of the prior's, `L <- D L D + (1 - D^2)`, for every
    parameter at its own rate: where motion says nothing, mean and spread go back to the prior and
    stay there, instead of growing without bound (Kulhavy, Kraus: On duality of regularized
    exponential and linear forgetting, 1996). The information is the sum of a prior and of
    squares, so it is positive definite in every step.

    Parameters
    ----------
    size : int
        m

    Attributes
    ----------
    belief : Belief
        Never changed in place.
    """

    def __init__(self, size: int) -> None:
        self._ones = np.ones(size)
        self.belief = Belief(np.zeros(size), np.eye(size), np.eye(size))

    def update(self, rows: Array, values: Array, variances: Array, kept: Array) -> None:
        """Forget, and take measurements.

        Parameters
        ----------
        rows : (k, m) ndarray
        values, variances : (k,) ndarray
            `rows @ parameters`, with noise of these variances.
        kept : (m,) ndarray
            D^2, what is kept of the information, 0 to 1.
        """
        mean, information, _ = self.belief
        root = np.sqrt(kept)
        prior = root[:, np.newaxis] * information * root
        weighted = (rows / variances[:, np.newaxis]).T
        known = prior @ mean + weighted @ values
        prior.ravel()[:: len(mean) + 1] += 1.0 - kept
        prior += weighted @ rows
        information = 0.5 * (prior + prior.T)
        covariance = np.linalg.inv(information)
        covariance = 0.5 * (covariance + covariance.T)
        self.belief = Belief(covariance @ known, information, covariance)

    def forget(self, which: slice) -> None:
        """Put some parameters back to the prior; what is known of the others stays."""
        mean, _, covariance = self.belief
        mean, covariance = mean.copy(), covariance.copy()
        mean[which] = 0.0
        covariance[which, :] = covariance[:, which] = 0.0
        diagonal = np.arange(len(mean))[which]
        covariance[diagonal, diagonal] = 1.0
        self.belief = Belief(mean, np.asarray(np.linalg.inv(covariance)), covariance)
