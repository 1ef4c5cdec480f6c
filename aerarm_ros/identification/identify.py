"""From recordings to estimates: the offline flow of the architecture in one function."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.assessment import assess
from aerarm_ros.identification.base_parameters import BaseParameters, find_base_parameters
from aerarm_ros.identification.conditioning import Conditioner, ConditioningOptions
from aerarm_ros.identification.cross_validation import CrossValidation
from aerarm_ros.identification.estimate import Estimate
from aerarm_ros.identification.identification_error import IdentificationError
from aerarm_ros.identification.identification_result import (
    FilterTrial,
    IdentificationResult,
    Solution,
)
from aerarm_ros.identification.joint_model import JointModel
from aerarm_ros.identification.joint_model_selection import (
    Comparison,
    candidate_terms,
    select_terms,
)
from aerarm_ros.identification.joint_term import ROTOR, THESIS_TERMS, JointTerm, TermKind
from aerarm_ros.identification.least_squares_solver import solve_least_squares
from aerarm_ros.identification.model_fit import ModelFit, fit_model
from aerarm_ros.identification.prior import LINK_SPREAD
from aerarm_ros.identification.recording import Recording
from aerarm_ros.identification.regression_bank import RegressionBank
from aerarm_ros.identification.regularised_solver import posterior_covariance
from aerarm_ros.identification.sample_columns import SampleColumns
from aerarm_ros.identification.semidefinite_solver import PhysicalLimits, solve_semidefinite
from aerarm_ros.identification.stopwatch import Stopwatch
from aerarm_ros.model.regressor import Regressor

Array = npt.NDArray[np.float64]

FRICTION_MODELS: dict[str, tuple[JointTerm, ...]] = {
    'coulomb': (*THESIS_TERMS, ROTOR),
    'load': (*THESIS_TERMS, ROTOR, JointTerm(TermKind.LOAD)),
}
"""Friction models with a name; 'auto' chooses each joint's terms by cross-validation."""

_LARGEST_CONDITION = 1e4
# Rounds of choosing the terms: what the links weigh decides the load that friction depends on.
_SELECTION_ROUNDS = 2


@dataclass(frozen=True)
class IdentificationOptions:
    """What the user may choose.

    Attributes
    ----------
    conditioning : ConditioningOptions
    friction : str
        'auto' or a key of `FRICTION_MODELS`.
    """

    conditioning: ConditioningOptions = field(default_factory=ConditioningOptions)
    friction: str = 'auto'


def identify(
    robot: Robot,
    config: ArmConfig | None,
    identification: Sequence[Recording],
    validation: Sequence[Recording],
    options: IdentificationOptions,
    stopwatch: Stopwatch,
) -> IdentificationResult:
    """Identify an arm's dynamic parameters.

    Parameters
    ----------
    robot : Robot
    config : ArmConfig or None
        Rotor inertia; None if nothing is known of the drives.
    identification : sequence of Recording
        Every choice is made, and every parameter fitted, on these.
    validation : sequence of Recording
        Only predicted.
    options : IdentificationOptions
    stopwatch : Stopwatch
        Gets the time of each stage.

    Raises
    ------
    IdentificationError
        If a recording is too short, or its motion excites too little.
    """
    regressor = Regressor(robot)
    cad = ArmParameters.stated(robot, config)
    with stopwatch.stage('conditioning'):
        conditioner = Conditioner(identification, options.conditioning)
        trials, bags = _choose_filter(regressor, conditioner, identification)
        kinematics = min(trials, key=lambda trial: trial.error).kinematics
        held_out = [
            SampleColumns(conditioner.condition(recording, kinematics), regressor)
            for recording in validation
        ]
    with stopwatch.stage('model selection'):
        fit, comparisons = _choose_model(robot, bags, cad, options.friction)
    with stopwatch.stage('regression'):
        thesis = JointModel.uniform(robot.joint_names, robot.link_names, THESIS_TERMS)
        thesis_base = _base(RegressionBank(bags, THESIS_TERMS), thesis)
        used_base = find_base_parameters(fit.regression.system().R, fit.regression.columns)
        warnings = [
            text for recording in (*identification, *validation) for text in recording.warnings
        ]
        warnings += _check_excitation(thesis_base)
    with stopwatch.stage('solvers'):
        fit, estimates = _solve(bags, cad, fit)
    with stopwatch.stage('assessment'):
        solutions = {
            name: Solution(estimate, assess(estimate, bags), assess(estimate, held_out))
            for name, estimate in estimates.items()
        }
    return IdentificationResult(
        robot=robot,
        cad=cad,
        conditioner=conditioner,
        filter_trials=trials,
        kinematics=kinematics,
        identification=bags,
        validation=held_out,
        thesis_base=thesis_base,
        used_base=used_base,
        fit=fit,
        comparisons=comparisons,
        solutions=solutions,
        warnings=warnings,
    )


def _choose_filter(
    regressor: Regressor, conditioner: Conditioner, recordings: Sequence[Recording]
) -> tuple[list[FilterTrial], list[SampleColumns]]:
    """Clean the kinematics in every way that fits; return trials and the best's samples."""
    robot = regressor.robot
    terms = FRICTION_MODELS['coulomb']
    model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
    trials: list[FilterTrial] = []
    best: list[SampleColumns] = []
    for kinematics in conditioner.candidates():
        if not kinematics.from_position and any(r.dq is None for r in recordings):
            continue
        bags = [SampleColumns(conditioner.condition(r, kinematics), regressor) for r in recordings]
        error = _least_error(bags, terms, model)
        if not trials or error < min(trial.error for trial in trials):
            best = bags
        trials.append(FilterTrial(kinematics, error))
    return trials, best


def _least_error(
    bags: Sequence[SampleColumns], terms: Sequence[JointTerm], model: JointModel
) -> float:
    regression = RegressionBank(bags, terms).regression(model)
    return regression.error(solve_least_squares(regression, np.zeros(len(regression.columns))))


def _choose_model(
    robot: Robot, bags: list[SampleColumns], cad: ArmParameters, friction: str
) -> tuple[ModelFit, list[Comparison]]:
    def model_of(terms: Sequence[Sequence[JointTerm]]) -> JointModel:
        return JointModel(robot.joint_names, robot.link_names, tuple(tuple(own) for own in terms))

    start = [FRICTION_MODELS['coulomb']] * robot.n
    fit = fit_model(bags, RegressionBank(bags, start[0]), model_of(start), cad)
    if friction == 'coulomb':
        return fit, []
    comparisons: list[Comparison] = []
    chosen: Sequence[Sequence[JointTerm]] = start
    for _ in range(_SELECTION_ROUNDS):
        if friction == 'auto':
            bank = RegressionBank(bags, candidate_terms(), fit.inertial)
            mean, std = cad.inertial.ravel(), LINK_SPREAD * cad.inertial_scale().ravel()
            selection = CrossValidation(bank, mean, std, fit.noise.weights)
            chosen, comparisons = select_terms(selection, chosen)
        else:
            chosen = [FRICTION_MODELS[friction]] * robot.n
            bank = RegressionBank(bags, FRICTION_MODELS[friction], fit.inertial)
        fit = fit_model(bags, bank, model_of(chosen), cad, fit.noise)
    return fit, comparisons


def _base(bank: RegressionBank, model: JointModel) -> BaseParameters:
    regression = bank.regression(model)
    return find_base_parameters(regression.system().R, regression.columns)


def _check_excitation(base: BaseParameters) -> list[str]:
    if not np.isfinite(base.condition_number) or base.rank == 0:
        raise IdentificationError(
            'the motion excites no parameter: record an excitation trajectory'
        )
    if base.condition_number > _LARGEST_CONDITION:
        raise IdentificationError(
            f'condition number {base.condition_number:.3g}: the motion is too short or too small '
            'to excite the parameters; record a longer one that moves every joint'
        )
    return []


def _solve(
    bags: list[SampleColumns], cad: ArmParameters, fit: ModelFit
) -> tuple[ModelFit, dict[str, Estimate]]:
    model = fit.model
    if model.depends_on_load:
        # The load follows from the links: once more with those of the final model.
        terms = [term for _, term in model.joint_columns]
        fit = fit_model(bags, RegressionBank(bags, terms, fit.inertial), model, cad, fit.noise)
    regression, prior = fit.regression, fit.prior
    mean = prior.mean
    weights = fit.noise.weights
    joint_terms = [term for _, term in model.joint_columns]
    limits = PhysicalLimits(
        mass=cad.inertial[:, 0],
        size=cad.inertial_scale()[:, 1] / cad.inertial[:, 0],
        nonnegative=np.array([term.nonnegative for term in joint_terms], dtype=bool),
    )
    solvers: dict[str, Callable[[], Array]] = {
        'cad': lambda: mean,
        'ols': lambda: solve_least_squares(regression, mean),
        'wls': lambda: solve_least_squares(regression, mean, weights),
        'sdp': lambda: solve_semidefinite(regression.system(weights), prior, limits),
    }
    estimates = {}
    for name, solve in solvers.items():
        begin = time.perf_counter()
        theta = solve()
        seconds = time.perf_counter() - begin
        estimates[name] = Estimate(name, model, theta, seconds=seconds)
    covariance = posterior_covariance(regression.system(fit.noise.information_weights), prior)
    variance = np.diag(covariance)
    known = estimates['sdp']
    estimates['sdp'] = Estimate(
        'sdp',
        model,
        known.theta,
        std=np.sqrt(variance),
        determined=np.clip(1.0 - variance / prior.std**2, 0.0, 1.0),
        seconds=known.seconds,
    )
    return fit, estimates
