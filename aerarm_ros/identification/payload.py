"""Identification of a payload from two recordings: its mass, centre and inertia."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.filter_choice import choose_filter, condition_once
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import JointModel
from aerarm_ros.identification.model_fit import (
    Noise,
    Prior,
    RegressionBank,
    noise_from_residuals,
    posterior_covariance,
    solve_regularised,
)
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.regression import SampleColumns, TriangularSystem, triangular_factor
from aerarm_ros.identification.solvers.estimate import Estimate, PhysicalLimits
from aerarm_ros.identification.solvers.semidefinite_solver import solve_semidefinite
from aerarm_ros.model.inertia import barycentric_inertia, from_pseudo_inertia
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import Array


@dataclass(frozen=True, eq=False)
class Payload:
    """Inertial parameters of a rigid body fixed to the last link.

    Attributes
    ----------
    link : str
        Link that carries the payload; all coordinates are in the frame of that link's joint.
    inertial : (10,) ndarray
        Physically consistent parameters in the order of thesis (3.3).
    covariance : (10, 10) ndarray
        Covariance of `inertial`, from the noise in the recording with payload and from the
        uncertainty of the arm's parameters.
    """

    link: str
    inertial: Array
    covariance: Array

    @property
    def mass(self) -> float:
        """Mass of the payload [kg]."""
        return float(self.inertial[0])

    @property
    def centre(self) -> Array:
        """Centre of mass (3,) of the payload [m]."""
        return np.asarray(self.inertial[1:4] / self.inertial[0])

    @property
    def barycentric_inertia(self) -> Array:
        """Inertia (3, 3) of the payload about its centre of mass [kg m^2]."""
        return barycentric_inertia(self.inertial)

    @property
    def std(self) -> Array:
        """Standard deviations (10,) of `inertial`."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def centre_std(self) -> Array:
        """Standard deviations (3,) of the centre of mass [m], to first order."""
        slope = np.hstack([-self.centre[:, None], np.eye(3)]) / self.mass
        return np.asarray(np.sqrt(np.diag(slope @ self.covariance[:4, :4] @ slope.T)))

    def with_scale_deviation(self, share: float) -> 'Payload':
        """Return the payload with additional uncertainty due to a scale error of all torques.

        Parameters
        ----------
        share : float
            Relative standard deviation of the common factor of the torque constants.
        """
        scale = share**2 * np.outer(self.inertial, self.inertial)
        return replace(self, covariance=self.covariance + scale)


# repeated, because the payload determines the load on which friction depends, and vice versa
_ROUNDS = 3
_SIZE = 0.1  # [m] typical size of a payload, within a factor of a few
# prior standard deviation of the payload, relative to its natural sizes; wide, so that the data
# dominate
_WIDE = 10.0
_SIGNIFICANT = 3.0  # standard deviations by which the payload's mass must exceed zero


@dataclass(frozen=True, eq=False)
class _Arm:
    """Model of the arm without payload; `covariance` is None if unknown."""

    robot: Robot
    model: JointModel
    theta: Array
    covariance: Array | None


@dataclass(frozen=True, eq=False)
class _Residual:
    """Least-squares system for the payload, from the torque residual of the arm's model.

    `system` is weighted for the fit. `information` is weighted to unit variance per independent
    sample; `arm` contains its columns for all parameters of the arm, `own` those of the payload.
    """

    system: TriangularSystem
    information: TriangularSystem
    arm: Array
    own: Array
    joints: tuple[Array, ...]


def identify_payload(
    result: IdentificationResult, recordings: Sequence[Recording], gain_deviation: float = 0.0
) -> Payload:
    """Identify the payload of the last link, from recordings with and without the payload.

    The torque residual of the arm's model is linear in the payload's inertial parameters; their
    columns equal those of the last link.

    Parameters
    ----------
    result : IdentificationResult
        Result for the arm without payload.
    recordings : sequence of Recording
        Motion with the payload.
    gain_deviation : float
        Relative standard deviation of the torque constants, see `Payload.with_scale_deviation`.

    Raises
    ------
    IdentificationError
        If a recording is too short, or no payload is detected.
    """
    regressor = Regressor(result.robot)
    kinematics = result.filter_choice.kinematics
    bags = [
        condition_once(regressor, result.conditioner, recording, kinematics)
        for recording in recordings
    ]
    fit = result.fit
    arm = _Arm(result.robot, fit.model, result.recommended.estimate.theta, fit.covariance)
    return _weigh(arm, bags, [fit.noise] * _ROUNDS, gain_deviation)


def weigh_payload(
    robot: Robot,
    estimate: Estimate,
    recordings: Sequence[Recording],
    options: ConditioningOptions,
    gain_deviation: float = 0.0,
) -> Payload:
    """Identify the payload of the last link, with a given model of the arm without payload.

    The standard deviations do not include the uncertainty of the arm model.

    Parameters
    ----------
    estimate : Estimate
        Estimate of the arm without payload.
    recordings : sequence of Recording
        Motion with the payload.
    gain_deviation : float
        Relative standard deviation of the torque constants, see `Payload.with_scale_deviation`.

    Raises
    ------
    IdentificationError
        If a recording is too short, or no payload is detected.
    """
    arm, bags, noises = _known(robot, estimate, recordings, options)
    return _weigh(arm, bags, noises, gain_deviation)


def _known(
    robot: Robot, estimate: Estimate, recordings: Sequence[Recording], options: ConditioningOptions
) -> tuple[_Arm, Sequence[SampleColumns], Sequence[Noise | None]]:
    """Return the arm model (assumed exact), the filtered bags, and the noise for each fit."""
    conditioner = Conditioner(recordings, options)
    bags = choose_filter(Regressor(robot), conditioner, recordings).bags
    tau = np.concatenate([bag.samples.tau for bag in bags])
    rms = np.maximum(np.sqrt(np.mean(tau**2, axis=0)), 1e-6)
    arm = _Arm(robot, estimate.model, estimate.theta, None)
    return arm, bags, [Noise(rms, np.ones(robot.n)), *[None] * _ROUNDS]


def _weigh(
    arm: _Arm, bags: Sequence[SampleColumns], noises: Sequence[Noise | None], gain_deviation: float
) -> Payload:
    """Return the payload with uncertainty; `noises` contains the torque noise for each fit."""
    carried, residual, prior = _fitted(arm, bags, noises)
    payload = Payload(arm.robot.link_names[-1], carried, _covariance(arm, residual, prior))
    if payload.mass < _SIGNIFICANT * payload.std[0]:
        raise IdentificationError(_nothing(payload.mass, float(payload.std[0])))
    if gain_deviation == 0.0:
        return payload
    # Torque constants deviate by a common factor, and individually by half as much.
    own = posterior_covariance(residual.information, prior)
    slopes = [own @ (rows[:, :10].T @ rows[:, :10]) @ carried for rows in residual.joints]
    each = (0.5 * gain_deviation) ** 2 * sum(np.outer(slope, slope) for slope in slopes)
    payload = replace(payload, covariance=payload.covariance + each)
    return payload.with_scale_deviation(gain_deviation)


def _fitted(
    arm: _Arm, bags: Sequence[SampleColumns], noises: Sequence[Noise | None]
) -> tuple[Array, _Residual, Prior]:
    """Fit the payload once per noise; None selects the noise of the previous fit's residuals."""
    carried = np.zeros(10)
    for noise in noises:
        residual = _residual(arm, bags, carried, noise or _noise(arm, bags, carried))
        prior, limits = _about(_unconstrained(residual.system))
        carried = solve_semidefinite(residual.system, prior, limits)
    return carried, residual, prior


def _last_link(model: JointModel) -> slice:
    return slice(10 * (model.n - 1), 10 * model.n)


def _noise(arm: _Arm, bags: Sequence[SampleColumns], carried: Array) -> Noise:
    """Return the torque noise, from the residuals of the model of the arm with payload."""
    theta = np.array(arm.theta)
    theta[_last_link(arm.model)] += carried
    residuals = [bag.samples.tau - bag.predict(arm.model, theta).filtered for bag in bags]
    rms = np.sqrt(np.mean(np.concatenate([bag.samples.tau for bag in bags]) ** 2, axis=0))
    return noise_from_residuals(residuals, [bag.samples.usable for bag in bags], rms)


def _residual(arm: _Arm, bags: Sequence[SampleColumns], carried: Array, noise: Noise) -> _Residual:
    model, theta, last = arm.model, arm.theta, _last_link(arm.model)
    load = np.array(theta[: 10 * model.n])
    load[last] += carried
    terms = [term for _, term in model.joint_columns]
    regression = RegressionBank(bags, terms, load).regression(model)

    def reduced(weights: Array) -> tuple[TriangularSystem, TriangularSystem]:
        whole = regression.system(weights)
        rows = np.column_stack([whole.R[:, last], whole.z - whole.R @ theta])
        factor = triangular_factor(rows)
        return TriangularSystem(factor[:10, :10], factor[:10, 10]), whole

    system, _ = reduced(noise.weights)
    information, whole = reduced(noise.information_weights)
    joints = tuple(
        weight
        * triangular_factor(
            np.column_stack([factor[:, last], factor[:, -1] - factor[:, :-1] @ theta])
        )
        for weight, factor in zip(noise.information_weights, regression.factors, strict=True)
    )
    return _Residual(system, information, whole.R, whole.R[:, last], joints)


def _unconstrained(system: TriangularSystem) -> Array:
    """Return the payload (10,) from a least-squares fit without physical limits."""
    scale = np.array([1.0, *[_SIZE] * 3, *[_SIZE**2] * 6])
    return solve_regularised(system, Prior(np.zeros(10), _WIDE * scale))


def _about(rough: Array) -> tuple[Prior, PhysicalLimits]:
    """Return the physical limits, and a wide prior: a ball with the mass of the payload `rough`."""
    mass = float(rough[0])
    if mass <= 0.0:
        raise IdentificationError(_nothing(mass, None))
    point = np.append(np.clip(rough[1:4] / mass, -3.0 * _SIZE, 3.0 * _SIZE), 1.0)
    ball = mass * (np.outer(point, point) + np.diag([*[0.2 * _SIZE**2] * 3, 0.0]))
    scale = mass * np.array([1.0, *[_SIZE] * 3, *[_SIZE**2] * 6])
    limits = PhysicalLimits(np.array([mass]), np.array([_SIZE]), np.zeros(0, dtype=bool))
    return Prior(from_pseudo_inertia(ball), _WIDE * scale), limits


def _covariance(arm: _Arm, residual: _Residual, prior: Prior) -> Array:
    """Return the payload's covariance (10, 10), due to noise and to errors of the arm's model."""
    own = posterior_covariance(residual.information, prior)
    if arm.covariance is None:
        return own
    # An error of the arm's parameters causes torque that the fit attributes to the payload.
    slope = own @ residual.own.T @ residual.arm
    return np.asarray(own + slope @ arm.covariance @ slope.T)


def _nothing(mass: float, std: float | None) -> str:
    spread = '' if std is None else f' with a standard deviation of {std:.2g} kg'
    return (
        f'no payload found, because the estimated mass is {mass:.3g} kg{spread}: check that '
        '--payload is the recording with the payload and --bag the one without'
    )


@dataclass(frozen=True, eq=False)
class GainCalibration:
    """Torque constants measured with a known mass.

    Attributes
    ----------
    factors, std : (n,) ndarray
        Correction factor of each effort gain, with its standard deviation.
    payload : Payload
        The known mass with its centre and inertia.
    """

    factors: Array
    std: Array
    payload: Payload


def calibrate_gains(
    robot: Robot,
    estimate: Estimate,
    recordings: Sequence[Recording],
    options: ConditioningOptions,
    mass: float,
    deviation: float,
) -> GainCalibration:
    """Estimate torque constants from motion with a known mass, whose centre may be unknown.

    The arm was identified with the same constants, so the residual torque of joint j equals the
    payload's torque times an unknown factor c_j: `tau_j - Phi_j theta = c_j Y_j pi`, where the
    mass `pi_1` of the payload is known. A factor that the payload's torque determines poorly
    stays near the factor common to all joints. Gautier, Briot: Global identification of joint
    drive gains and dynamic parameters of robots (2014).

    Parameters
    ----------
    robot, estimate, recordings, options
        Same as in `weigh_payload`.
    mass : float
        Mass of the payload [kg].
    deviation : float
        Prior relative standard deviation of the torque constants.

    Raises
    ------
    IdentificationError
        If the mass is not positive, a recording is too short, or no payload is detected.
    """
    if not (np.isfinite(mass) and mass > 0.0):
        raise IdentificationError(f'known mass {mass} kg must be positive and finite')
    arm, bags, noises = _known(robot, estimate, recordings, options)
    carried, residual, _ = _fitted(arm, bags, noises)
    factors = np.full(robot.n, carried[0] / mass)
    body = carried * mass / carried[0]
    wide = _WIDE * mass * np.array([*[_SIZE] * 3, *[_SIZE**2] * 6])
    common = np.linalg.inv(deviation**2 * (np.ones((robot.n, robot.n)) + 0.25 * np.eye(robot.n)))
    root = np.linalg.cholesky(common).T
    start = body[1:].copy()

    def left(unknown: Array) -> Array:
        """Return the torque residuals, and deviations from the prior."""
        inertial, factors = np.append(mass, unknown[:9]), unknown[9:]
        rows = [
            block[:, 10] - factor * (block[:, :10] @ inertial)
            for factor, block in zip(factors, residual.joints, strict=True)
        ]
        return np.concatenate([*rows, (unknown[:9] - start) / wide, root @ (factors - 1.0)])

    precise = dict.fromkeys(('ftol', 'xtol', 'gtol'), 1e-14)
    found = least_squares(left, [*start, *factors], '3-point', x_scale='jac', **precise)
    body[1:], factors = found.x[:9], found.x[9:]
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    spread = np.zeros((10, 10))
    spread[1:, 1:] = covariance[:9, :9]
    std = np.sqrt(np.diag(covariance)[9:]) / factors**2
    return GainCalibration(1.0 / factors, std, Payload(arm.robot.link_names[-1], body, spread))
