"""Held-out torque error of joint models, from triangular factors only."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.samples import FOLDS
from aerarm_ros.identification.parameters.joint_term import JointTerm
from aerarm_ros.identification.regression.regression_bank import RegressionBank

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Eigenvalues of the links' Gram matrix below this share of the largest are directions that
# no torque depends on.
_NO_EFFECT = 1e-12


@dataclass(frozen=True, eq=False)
class _Eliminated:
    """A joint's own coefficients as functions of the links' parameters x: `constant - slope x`.

    `hessian` and `gradient` are what the joint's rows then say about x. Leading axes: variants
    of the joint's terms, parts of the motion left out.
    """

    hessian: Array
    gradient: Array
    constant: Array
    slope: Array


class CrossValidation:
    """Predicts each part of the identification motion from the others.

    The links' parameters are common to all joints, a joint's terms belong to its own torque
    only. So each joint's terms are eliminated first (a Schur complement), and exchanging the
    terms of one joint needs no more than a solution for the links.

    Parameters
    ----------
    bank : RegressionBank
    link_mean, link_std : (10 n,) ndarray
        Prior of the inertial parameters.
    weights : (n,) ndarray
        One over each joint's noise [1/Nm].
    """

    def __init__(
        self, bank: RegressionBank, link_mean: Array, link_std: Array, weights: Array
    ) -> None:
        self._place = {term: place for place, term in enumerate(bank.terms)}
        self._nonnegative = np.array([term.nonnegative for term in bank.terms])
        count = len(link_mean)
        rows = [
            [
                _in_prior_units(bank.factor(joint, fold), link_mean, link_std, weights[joint])
                for fold in range(FOLDS)
            ]
            for joint in range(bank.n)
        ]
        grams = np.array([[row.T @ row for row in own] for own in rows])
        # Only combinations with an effect are kept: x = V y leaves prior and torques the same.
        values, vectors = np.linalg.eigh(grams[..., :count, :count].sum(axis=(0, 1)))
        effective = vectors[:, values > _NO_EFFECT * values[-1]]
        self._links = effective.shape[1]
        transform = np.zeros((grams.shape[-1], self._links + grams.shape[-1] - count))
        transform[:count, : self._links] = effective
        transform[count:, self._links :] = np.eye(grams.shape[-1] - count)
        self._held_out = transform.T @ grams @ transform
        self._training = self._held_out.sum(axis=1, keepdims=True) - self._held_out

    def score(self, terms: Sequence[Sequence[JointTerm]]) -> float:
        """Return the held-out squared error of a model, in units of the noise.

        Parameters
        ----------
        terms : n sequences of JointTerm
        """
        return float(self.score_variants(terms, 0, [terms[0]])[0])

    def score_variants(
        self,
        terms: Sequence[Sequence[JointTerm]],
        joint: int,
        variants: Sequence[Sequence[JointTerm]],
    ) -> Array:
        """Return the held-out squared errors for variants of one joint's terms.

        Parameters
        ----------
        terms : n sequences of JointTerm
            The model; what it has for `joint` doesn't matter.
        joint : int
        variants : V sequences of JointTerm

        Returns
        -------
        (V,) ndarray
            In units of the noise, summed over the joints and parts.
        """
        links = self._links
        masks = np.array([self._mask(variant) for variant in variants])
        own = self._eliminate(joint, masks)
        hessian, gradient = np.eye(links) + own.hessian, own.gradient.copy()
        others: list[tuple[int, _Eliminated]] = []
        for other, its_terms in enumerate(terms):
            if other != joint:
                part = self._eliminate(other, self._mask(its_terms)[None])
                hessian += part.hessian
                gradient += part.gradient
                others.append((other, part))
        x: Array = np.asarray(np.linalg.solve(hessian, gradient[..., None])[..., 0])
        errors = self._error(joint, x, own)
        for other, part in others:
            errors += self._error(other, x, part)
        return np.asarray(errors.sum(axis=1))

    def _mask(self, terms: Sequence[JointTerm]) -> Mask:
        mask = np.zeros(len(self._place), dtype=bool)
        mask[[self._place[term] for term in terms]] = True
        return mask

    def _eliminate(self, joint: int, masks: Mask) -> _Eliminated:
        links = self._links
        gram = self._training[joint]
        selected = masks[:, None, :]
        diagonal = np.diagonal(gram, axis1=1, axis2=2)[:, links:-1]
        # Prior of a coefficient: one standard deviation would explain all of the torque.
        ridge = diagonal / np.maximum(gram[:, -1:, -1], 1e-300) + 1e-9 * diagonal + 1e-300
        square = gram[:, links:-1, links:-1] * (selected[..., None] & selected[..., None, :])
        index = np.arange(square.shape[-1])
        square[..., index, index] += np.where(selected, ridge, 1.0)
        cross = gram[:, links:-1, :links] * selected[..., None]
        right = gram[:, links:-1, -1:] * selected[..., None]
        solved = np.linalg.solve(square, np.concatenate([right, cross], axis=-1))
        constant, slope = solved[..., 0], solved[..., 1:]
        turned = np.swapaxes(cross, -1, -2)
        return _Eliminated(
            hessian=gram[:, :links, :links] - turned @ slope,
            gradient=gram[:, :links, -1] - (turned @ constant[..., None])[..., 0],
            constant=constant,
            slope=slope,
        )

    def _error(self, joint: int, x: Array, part: _Eliminated) -> Array:
        own = part.constant - (part.slope @ x[..., None])[..., 0]
        # A term that only helps with the wrong sign is no friction.
        own = np.where(self._nonnegative, np.maximum(own, 0.0), own)
        solution = np.concatenate([x, own, -np.ones((*x.shape[:-1], 1))], axis=-1)
        return np.asarray(
            ((solution[..., None, :] @ self._held_out[joint])[..., 0, :] * solution).sum(-1)
        )


def _in_prior_units(factor: Array, mean: Array, std: Array, weight: float) -> Array:
    """Return weighted rows for deviations from the prior in its standard deviations."""
    rows = weight * factor
    links = len(mean)
    rows[:, -1] -= rows[:, :links] @ mean
    rows[:, :links] *= std
    return np.asarray(rows)
