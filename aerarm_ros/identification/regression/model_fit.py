"""A joint model fitted to the identification bags, with the noise that is left."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.regression.noise import Noise, noise_from_residuals
from aerarm_ros.identification.regression.prior import Prior, prior_from_cad
from aerarm_ros.identification.regression.reduced_regression import ReducedRegression
from aerarm_ros.identification.regression.regression_bank import RegressionBank
from aerarm_ros.identification.regression.regularised_regression import (
    posterior_covariance,
    solve_regularised,
)
from aerarm_ros.identification.regression.sample_columns import SampleColumns

Array = npt.NDArray[np.float64]

_ROUNDS = 2  # the noise follows from the fit, the fit from the noise: two rounds settle both


@dataclass(frozen=True, eq=False)
class ModelFit:
    """A regression with prior and noise, ready for any solver.

    Attributes
    ----------
    model : JointModel
    regression : ReducedRegression
    prior : Prior
    noise : Noise
        Of a bag that counts once; weighted bags have theirs over their weight.
    theta : (p,) ndarray
        Weighted, regularised solution without constraints.
    """

    model: JointModel
    regression: ReducedRegression
    prior: Prior
    noise: Noise
    theta: Array

    @property
    def inertial(self) -> Array:
        """(10 n,) inertial parameters of `theta`."""
        return self.theta[: 10 * self.model.n]

    @cached_property
    def covariance(self) -> Array:
        """(p, p) covariance of the parameters given data and prior, constraints left out."""
        system = self.regression.system(self.noise.information_weights)
        return posterior_covariance(system, self.prior)


def fit_model(
    bags: Sequence[SampleColumns],
    bank: RegressionBank,
    model: JointModel,
    cad: ArmParameters,
    noise: Noise | None = None,
) -> ModelFit:
    """Fit a model by least squares weighted by the noise it leaves.

    Parameters
    ----------
    bags : sequence of SampleColumns
        The identification bags.
    bank : RegressionBank
        Of these bags, with the model's terms.
    model : JointModel
    cad : ArmParameters
    noise : Noise, optional
        Of an earlier fit; equal noise relative to the joints' torques otherwise.
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
