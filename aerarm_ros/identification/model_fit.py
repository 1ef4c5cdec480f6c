"""Base parameters that a motion identifies (thesis sections 3.2.1, 5.3), noise and prior."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.uniform_motion import FOLDS
from aerarm_ros.identification.joint_model import ArmParameters, JointModel, JointTerm, TermKind
from aerarm_ros.identification.regression import (
    ReducedRegression,
    SampleColumns,
    TriangularSystem,
    triangular_factor,
)
from aerarm_ros.motion.signals import Array

# Dependencies of regressor columns are exact up to this rounding error; any excitation exceeds it
# by far.
_RANK_TOLERANCE = 1e-8
# URDFs round angles to five digits (3.1416), so a vertical axis tilts by 1e-5 rad and gravity acts
# on it. Columns below this fraction of the largest are not identifiable.
_NO_EFFECT = 3e-5
_COEFFICIENT_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Base parameters: the smallest set of parameter combinations that determines all torques.

    Base parameter i is `theta[independent[i]] + combination[i] @ theta[dependent]`.

    Attributes
    ----------
    columns : tuple of str
        Names of all p parameters.
    independent : (r,) ndarray of int
        Columns that are linearly independent of earlier columns.
    dependent : (p - r,) ndarray of int
        All other columns, including columns without effect.
    combination : (r, p - r) ndarray
        Factors with which the dependent parameters contribute to the base parameters.
    condition_number : float
        Condition number (5.2): largest over smallest nonzero singular value of the regressor.
    """

    columns: tuple[str, ...]
    independent: npt.NDArray[np.intp]
    dependent: npt.NDArray[np.intp]
    combination: Array
    condition_number: float

    @property
    def rank(self) -> int:
        """Rank r of the regressor."""
        return len(self.independent)

    def values(self, theta: Array) -> Array:
        """Return the base parameters (r,) of a parameter vector `theta` (p,)."""
        return np.asarray(theta[self.independent] + self.combination @ theta[self.dependent])

    def complete(self, values: Array, reference: Array) -> Array:
        """Return a parameter vector with the given base parameters; see `reference` for the rest.

        Parameters
        ----------
        values : (r,) ndarray
            Base parameters.
        reference : (p,) ndarray
            Parameter vector that provides the dependent parameters.
        """
        theta = np.array(reference, dtype=float)
        theta[self.independent] = values - self.combination @ theta[self.dependent]
        return theta

    def expressions(self) -> list[str]:
        """Return each base parameter as a text, for example 'Izz_link1 + Ja_joint1'."""
        return [
            _expression(self.columns[column], row, [self.columns[d] for d in self.dependent])
            for column, row in zip(self.independent, self.combination, strict=True)
        ]


def find_base_parameters(factor: Array, columns: Sequence[str]) -> BaseParameters:
    """Find the independent columns of a triangular factor, and combinations for the others.

    Columns are orthogonalized in order; a column that is a combination of earlier ones is
    dependent. The parameters of later links are therefore combined into those of earlier links.

    Parameters
    ----------
    factor : (p, p) ndarray
        Triangular factor R of the unweighted regressor.
    columns : sequence of str
        Names of its columns.
    """
    independent, dependent = _split(factor)
    if len(independent) == 0:
        empty = np.zeros((0, len(dependent)))
        return BaseParameters(tuple(columns), independent, dependent, empty, float('inf'))
    solved = np.linalg.lstsq(factor[:, independent], factor[:, dependent], rcond=None)[0]
    combination: Array = np.asarray(solved)
    combination[np.abs(combination) < _COEFFICIENT_TOLERANCE] = 0.0
    singular = np.linalg.svd(factor, compute_uv=False)
    condition = float(singular[0] / singular[len(independent) - 1])
    return BaseParameters(tuple(columns), independent, dependent, combination, condition)


def _split(factor: Array) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return independent and dependent columns by modified Gram-Schmidt, performed twice."""
    norms = np.linalg.norm(factor, axis=0)
    basis = np.zeros((len(factor), 0))
    independent, dependent = [], []
    for column, norm in enumerate(norms):
        if norm <= _RANK_TOLERANCE * norms.max():
            dependent.append(column)
            continue
        left = factor[:, column] / norm
        for _ in range(2):
            left = left - basis @ (basis.T @ left)
        size = np.linalg.norm(left)
        if size <= _RANK_TOLERANCE or size * norm <= _NO_EFFECT * norms.max():
            dependent.append(column)
        else:
            basis = np.column_stack([basis, left / size])
            independent.append(column)
    return np.array(independent, dtype=np.intp), np.array(dependent, dtype=np.intp)


def _expression(name: str, row: Array, names: Sequence[str]) -> str:
    parts = [name]
    for coefficient, other in zip(row, names, strict=True):
        if coefficient:
            size = abs(coefficient)
            factor = '' if abs(size - 1.0) < 1e-5 else f'{size:.4g} '
            parts.append(f'{"-" if coefficient < 0.0 else "+"} {factor}{other}')
    return ' '.join(parts)


# least noise as a fraction of a joint's torque, which keeps weights finite for data without noise
_SMALLEST_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of each joint's torque residual.

    Attributes
    ----------
    std : (n,) ndarray
        Standard deviation [Nm].
    correlation : (n,) ndarray
        Number of correlated samples that count as one independent sample, at least 1. Filtering
        and model errors both correlate neighbouring residuals; without this factor standard
        deviations would be too small.
    """

    std: Array
    correlation: Array

    @property
    def weights(self) -> Array:
        """Weights (n,) of the joints' rows in a fit [1/Nm].

        Each weight is one over the noise of the joint. Correlation that is common to all joints
        lowers all weights, and thus the influence of the data relative to the prior.
        """
        return np.asarray(1.0 / (self.std * np.sqrt(np.median(self.correlation))))

    @property
    def information_weights(self) -> Array:
        """Weights (n,) of the joints' rows, one over the noise per independent sample [1/Nm]."""
        return np.asarray(1.0 / (self.std * np.sqrt(self.correlation)))


def noise_from_residuals(
    residuals: Sequence[Array], usable: Sequence[npt.NDArray[np.bool_]], torque_rms: Array
) -> Noise:
    """Estimate the noise of each joint from its torque residuals.

    Parameters
    ----------
    residuals : sequence of (M, n) arrays
        Measured minus predicted torque of each bag [Nm].
    usable : sequence of (M, n) bool arrays
        Samples of each joint to include.
    torque_rms : (n,) ndarray
        RMS torque of each joint [Nm].
    """
    n = len(torque_rms)
    std, correlation = np.empty(n), np.ones(n)
    for joint in range(n):
        kept = [r[u[:, joint], joint] for r, u in zip(residuals, usable, strict=True)]
        count = sum(len(part) for part in kept)
        power = sum(float(part @ part) for part in kept)
        floor = _SMALLEST_SHARE * max(float(torque_rms[joint]), 1e-6)
        std[joint] = max(np.sqrt(power / max(count, 1)), floor)
        if count and power / count > floor**2:
            times = [_correlation_time(part) * len(part) for part in kept if len(part) > 3]
            correlation[joint] = max(1.0, sum(times) / count)
    return Noise(std, correlation)


def _correlation_time(residual: Array) -> float:
    """Return the integrated autocorrelation time [samples], with a window of five times this time.

    The length of the sum is that of Sokal: a longer sum adds noise, and a shorter sum truncates
    the correlation.
    """
    padded = np.fft.rfft(residual, 2 * len(residual))
    covariance = np.fft.irfft(np.abs(padded) ** 2)[: len(residual)]
    if covariance[0] <= 0.0:
        return 1.0
    total = 2.0 * np.cumsum(covariance / covariance[0]) - 1.0
    inside = np.arange(len(total)) < 5.0 * total
    last = int(np.argmin(inside)) if not inside.all() else len(total) - 1
    return float(max(total[last], 1.0))


# Relative standard deviation of an inertial parameter. A CAD model lacks cables, screws and the
# infill of printed parts, but not half of a link.
LINK_SPREAD = 0.3
# Prior of a joint coefficient, relative to the value that would explain all of its torque.
_TERM_SPREAD = 1.0


@dataclass(frozen=True, eq=False)
class Prior:
    """Prior of the parameters: independent, deliberately wide normal distributions.

    The prior determines parameter combinations that the motion does not excite; the data dominate
    all other combinations.

    Attributes
    ----------
    mean, std : (p,) ndarray
        Mean and standard deviation in the parameters' units.
    """

    mean: Array
    std: Array


def prior_from_cad(cad: ArmParameters, model: JointModel, regression: ReducedRegression) -> Prior:
    """Return a weak prior, whose mean is the CAD parameters.

    Parameters
    ----------
    regression : ReducedRegression
        Regression with the columns of `model`; its torques determine the prior deviations of
        friction.
    """
    mean = cad.vector(model)
    norms, torque = regression.column_norms(), regression.torque_norms
    joints = []
    for index, (joint, term) in enumerate(model.joint_columns, start=10 * model.n):
        norm = norms[joint, index]
        share = _TERM_SPREAD * torque[joint] / norm if norm > 0.0 else 0.0
        least = 0.5 * mean[index] if term.kind is not TermKind.OFFSET else 0.0
        joints.append(max(share, least, 1e-6))
    return Prior(mean, np.concatenate([LINK_SPREAD * cad.inertial_scale().ravel(), joints]))


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
