"""Mass, centre of mass and inertia of a payload, thesis section 3.6."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.identification_error import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.payload import Payload
from aerarm_ros.identification.prior import Prior
from aerarm_ros.identification.recording import Recording
from aerarm_ros.identification.reduced_regression import TriangularSystem, triangular_factor
from aerarm_ros.identification.regression_bank import RegressionBank
from aerarm_ros.identification.regularised_solver import posterior_covariance, solve_regularised
from aerarm_ros.identification.sample_columns import SampleColumns
from aerarm_ros.identification.semidefinite_solver import PhysicalLimits, solve_semidefinite
from aerarm_ros.model.inertia import from_pseudo_inertia
from aerarm_ros.model.regressor import Regressor

Array = npt.NDArray[np.float64]

_ROUNDS = 3  # the payload decides the load that friction depends on, and the other way round
_SIZE = 0.1  # [m]: of what an arm carries, to a factor of a few
_WIDE = 10.0  # standard deviations of the prior in natural sizes: data decide all they can
_SIGNIFICANT = 3.0  # standard deviations that a payload must weigh


@dataclass(frozen=True, eq=False)
class _Residual:
    """What the arm's model leaves of the torque, reduced, for the payload's ten columns.

    `system` is weighted for the fit. `information` is weighted to unit variance an independent
    sample; `arm` are its columns of all the arm's parameters, `own` those of the payload.
    """

    system: TriangularSystem
    information: TriangularSystem
    arm: Array
    own: Array


def identify_payload(result: IdentificationResult, recordings: Sequence[Recording]) -> Payload:
    """Identify what the last link carries, with the arm's model fixed.

    Torque that the arm's own model leaves unexplained is linear in the payload's inertial
    parameters: their columns are those of the last link.

    Parameters
    ----------
    result : IdentificationResult
        Of the arm without the payload.
    recordings : sequence of Recording
        Motion with the payload.

    Raises
    ------
    IdentificationError
        If a recording is too short, or shows no payload.
    """
    regressor = Regressor(result.robot)
    kinematics = result.filter_choice.kinematics
    bags = [
        SampleColumns(result.conditioner.condition(recording, kinematics), regressor)
        for recording in recordings
    ]
    carried = np.zeros(10)
    for _ in range(_ROUNDS):
        residual = _residual(result, bags, carried)
        prior, limits = _about(_unconstrained(residual.system))
        carried = solve_semidefinite(residual.system, prior, limits)
    payload = Payload(result.robot.link_names[-1], carried, _covariance(result, residual, prior))
    if payload.mass < _SIGNIFICANT * payload.std[0]:
        raise IdentificationError(_nothing(payload.mass, float(payload.std[0])))
    return payload


def _residual(
    result: IdentificationResult, bags: Sequence[SampleColumns], carried: Array
) -> _Residual:
    fit, theta = result.fit, result.recommended.estimate.theta
    last = slice(10 * (fit.model.n - 1), 10 * fit.model.n)
    load = np.array(theta[: 10 * fit.model.n])
    load[last] += carried
    terms = [term for _, term in fit.model.joint_columns]
    regression = RegressionBank(bags, terms, load).regression(fit.model)

    def reduced(weights: Array) -> tuple[TriangularSystem, TriangularSystem]:
        whole = regression.system(weights)
        rows = np.column_stack([whole.R[:, last], whole.z - whole.R @ theta])
        factor = triangular_factor(rows)
        return TriangularSystem(factor[:10, :10], factor[:10, 10]), whole

    system, _ = reduced(fit.noise.weights)
    information, whole = reduced(fit.noise.information_weights)
    return _Residual(system, information, whole.R, whole.R[:, last])


def _unconstrained(system: TriangularSystem) -> Array:
    """Return the (10,) least-squares payload, next to nothing assumed."""
    scale = np.array([1.0, *[_SIZE] * 3, *[_SIZE**2] * 6])
    return solve_regularised(system, Prior(np.zeros(10), _WIDE * scale))


def _about(rough: Array) -> tuple[Prior, PhysicalLimits]:
    """Return a wide prior about a ball of the mass that was found, and what a body obeys."""
    mass = float(rough[0])
    if mass <= 0.0:
        raise IdentificationError(_nothing(mass, None))
    point = np.append(np.clip(rough[1:4] / mass, -3.0 * _SIZE, 3.0 * _SIZE), 1.0)
    ball = mass * (np.outer(point, point) + np.diag([*[0.2 * _SIZE**2] * 3, 0.0]))
    scale = mass * np.array([1.0, *[_SIZE] * 3, *[_SIZE**2] * 6])
    limits = PhysicalLimits(np.array([mass]), np.array([_SIZE]), np.zeros(0, dtype=bool))
    return Prior(from_pseudo_inertia(ball), _WIDE * scale), limits


def _covariance(result: IdentificationResult, residual: _Residual, prior: Prior) -> Array:
    """Return the (10, 10) covariance: of the payload's own motion, and of the arm's model."""
    own = posterior_covariance(residual.information, prior)
    fit = result.fit
    arm = posterior_covariance(fit.regression.system(fit.noise.information_weights), fit.prior)
    # An error of the arm's parameters is torque that the fit takes for the payload's.
    slope = own @ residual.own.T @ residual.arm
    return np.asarray(own + slope @ arm @ slope.T)


def _nothing(mass: float, std: float | None) -> str:
    spread = '' if std is None else f' with a standard deviation of {std:.2g} kg'
    return (
        f'no payload found: its mass would be {mass:.3g} kg{spread}; check that --payload '
        'is the recording with the payload and --bag the one without'
    )
