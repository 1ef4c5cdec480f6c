"""Fit of a joint model to the identification bags, with its noise."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.conditioning.uniform_motion import FOLDS
from aerarm_ros.identification.joint_model import JointModel, JointTerm
from aerarm_ros.identification.regression.base_parameters import (
    Noise,
    Prior,
    noise_from_residuals,
    prior_from_cad,
)
from aerarm_ros.identification.regression.regression import (
    ReducedRegression,
    SampleColumns,
    TriangularSystem,
    triangular_factor,
)
from aerarm_ros.motion.signals import Array


def solve_regularised(system: TriangularSystem, prior: Prior) -> Array:
    """Return the parameters (p,) that minimize squared torque error plus distance from the prior.

    Parameters
    ----------
    system : TriangularSystem
        System weighted to unit variance.
    """
    rows = np.vstack([system.R * prior.std, np.eye(len(prior.mean))])
    right = np.concatenate([system.z - system.R @ prior.mean, np.zeros(len(prior.mean))])
    deviation, *_ = np.linalg.lstsq(rows, right, rcond=None)
    return np.asarray(prior.mean + prior.std * deviation)


def posterior_covariance(system: TriangularSystem, prior: Prior) -> Array:
    """Return the covariance (p, p) of the parameters, given data and prior.

    Parameters
    ----------
    system : TriangularSystem
        System weighted to unit variance per independent sample.
    """
    rows = np.vstack([system.R * prior.std, np.eye(len(prior.mean))])
    inverse = np.linalg.inv(np.linalg.qr(rows, mode='r'))
    return np.asarray(np.outer(prior.std, prior.std) * (inverse @ inverse.T))


class RegressionBank:
    """Identification bags in the form of small triangular factors, for quick fits of models.

    A joint's terms act only on its own torque, so its rows need only the links' columns and its own
    candidate terms. The bank stores one factor per joint and part of the motion.

    Parameters
    ----------
    terms : sequence of JointTerm
        Candidate terms of every joint.
    inertial : (10 n,) ndarray, optional
        Inertial parameters that determine the load of load-dependent terms.

    Attributes
    ----------
    factors : n lists of arrays
        Triangular factors of the regressor for each joint and part of the motion.
    """

    def __init__(
        self,
        bags: Sequence[SampleColumns],
        terms: Sequence[JointTerm],
        inertial: Array | None = None,
    ) -> None:
        self.terms = tuple(dict.fromkeys(terms))
        self.n = bags[0].samples.n
        columns = [[bag.term(term, inertial) for term in self.terms] for bag in bags]
        for bag in bags:
            bag.drop_loads()
        self.factors: list[list[Array]] = []
        self._rows = np.zeros((self.n, FOLDS), dtype=np.intp)
        for joint in range(self.n):
            blocks = []
            for bag, own in zip(bags, columns, strict=True):
                of_joint = [column[:, joint] for column in own]
                block = np.column_stack([bag.rigid[:, joint], *of_joint, bag.samples.tau[:, joint]])
                # In place, because the rows of half an hour take tens of megabytes.
                block *= bag.weights[joint]
                blocks.append(block)
            self.factors.append([])
            for fold in range(FOLDS):
                rows = np.vstack(
                    [
                        block[bag.samples.usable[:, joint] & (bag.samples.fold == fold)]
                        for bag, block in zip(bags, blocks, strict=True)
                    ]
                )
                self._rows[joint, fold] = len(rows)
                self.factors[joint].append(triangular_factor(rows))

    def regression(
        self, model: JointModel, folds: Iterable[int] = range(FOLDS)
    ) -> ReducedRegression:
        """Return the regression of a model on given parts of the motion.

        Parameters
        ----------
        model : JointModel
            Model whose terms are among the candidates.
        """
        folds = list(folds)
        joint_columns = model.joint_columns
        factors = []
        for joint in range(self.n):
            own = [(i, t) for i, (j, t) in enumerate(joint_columns) if j == joint]
            source = np.vstack([self.factors[joint][fold] for fold in folds])
            links = 10 * self.n
            spread = np.zeros((len(source), links + len(joint_columns) + 1))
            spread[:, :links] = source[:, :links]
            for index, term in own:
                spread[:, links + index] = source[:, links + self.terms.index(term)]
            spread[:, -1] = source[:, -1]
            factors.append(triangular_factor(spread))
        return ReducedRegression(model.columns, factors, self._rows[:, folds].sum(axis=1))


_ROUNDS = 2  # noise and fit depend on each other; two rounds are sufficient


@dataclass(frozen=True, eq=False)
class ModelFit:
    """Regression, prior and torque noise of a model; the input of every solver.

    Attributes
    ----------
    noise : Noise
        Torque noise of a bag with weight one; the noise of other bags is this noise divided by
        their weight.
    theta : (p,) ndarray
        Weighted, regularized solution without constraints.
    """

    model: JointModel
    regression: ReducedRegression
    prior: Prior
    noise: Noise
    theta: Array

    @property
    def inertial(self) -> Array:
        """Inertial parameters (10 n,) of the links, from `theta`."""
        return self.theta[: 10 * self.model.n]

    @cached_property
    def covariance(self) -> Array:
        """(p, p) covariance of the parameters given data and prior, without constraints."""
        system = self.regression.system(self.noise.information_weights)
        return posterior_covariance(system, self.prior)


def fit_model(
    bags: Sequence[SampleColumns],
    bank: RegressionBank,
    model: JointModel,
    cad: ArmParameters,
    noise: Noise | None = None,
) -> ModelFit:
    """Fit a model near CAD by least squares, weighted by its residual noise.

    Parameters
    ----------
    bags : sequence of SampleColumns
        Identification bags.
    bank : RegressionBank
        Reduced bags, including the model's terms.
    noise : Noise, optional
        Noise of an earlier fit; by default equal noise relative to the joints' torques.
    """
    regression = bank.regression(model)
    prior = prior_from_cad(cad, model, regression)
    rms = regression.torque_norms / np.sqrt(np.maximum(regression.rows, 1))
    if noise is None:
        noise = Noise(np.maximum(rms, 1e-6), np.ones(model.n))
    usable = [bag.samples.usable for bag in bags]
    theta = solve_regularised(regression.system(noise.weights), prior)
    for _ in range(_ROUNDS):
        residuals = [
            bag.weights * (bag.samples.tau - bag.predict(model, theta).filtered) for bag in bags
        ]
        noise = noise_from_residuals(residuals, usable, rms)
        theta = solve_regularised(regression.system(noise.weights), prior)
    return ModelFit(model, regression, prior, noise, theta)
