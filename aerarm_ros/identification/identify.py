"""Function for the complete offline identification, from recordings to parameter estimates."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.filter_choice import (
    EffortDelay,
    FilterChoice,
    GravityDirection,
    choose_filter,
    condition_once,
    find_effort_delay,
    find_gravity,
)
from aerarm_ros.identification.identification_result import (
    IdentificationResult,
    Solution,
    assess,
    bag_demand,
    extrapolation_warnings,
)
from aerarm_ros.identification.input_errors import (
    bound_warnings,
    coupling_warnings,
    error_warnings,
    find_input_errors,
    joint_warnings,
)
from aerarm_ros.identification.joint_model import (
    THESIS_TERMS,
    ArmParameters,
    CoupledJoints,
    JointModel,
    LinkBounds,
    TermKind,
)
from aerarm_ros.identification.model_choice import AUTOMATIC, choose_model
from aerarm_ros.identification.model_fit import (
    BaseParameters,
    ModelFit,
    RegressionBank,
    find_base_parameters,
    fit_model,
)
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.regression import SampleColumns, triangular_factor
from aerarm_ros.identification.simple_fit import SimpleFit
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.solvers.solvers import DEFAULT, RECOMMENDED, solve_all
from aerarm_ros.model.regressor import Regressor


class Stopwatch:
    """Stopwatch that sums the wall-clock time of each stage.

    Attributes
    ----------
    seconds : dict of str to float
        Total time [s] of each stage, in the order of their first start.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the time of the enclosed code."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin


_MOST = 10.0  # largest ratio between the weights of one bag and those of all bags together
# number of rounds, because a noisy bag degrades the first fit, which determines the noise of all
# bags
_WEIGHT_ROUNDS = 2


def weighted_bags(bags: Sequence[SampleColumns], cad: ArmParameters) -> list[SampleColumns]:
    """Return copies of the bags, with joint weights inversely proportional to each bag's noise.

    The noise is the residual torque in held-out parts of the motion, relative to the noise of all
    bags together. A single bag therefore has weights of one.

    Parameters
    ----------
    bags : sequence of SampleColumns
        Identification bags.
    """
    weighted = list(bags)
    if len(bags) < 2:
        return weighted
    for _ in range(_WEIGHT_ROUNDS):
        residuals = SimpleFit(weighted, cad).residuals()
        squares = np.array([np.nansum(own**2, axis=0) for own in residuals])
        counts = np.array([np.isfinite(own).sum(axis=0) for own in residuals])
        noise = np.sqrt(squares / np.maximum(counts, 1))
        together = np.sqrt(squares.sum(axis=0) / np.maximum(counts.sum(axis=0), 1))
        known = (noise > 0.0) & (counts > 0)
        weights = np.where(known, together / np.where(known, noise, 1.0), 1.0)
        weighted = [
            bag.altered(weights=own)
            for bag, own in zip(bags, np.clip(weights, 1.0 / _MOST, _MOST), strict=True)
        ]
    return weighted


# Condition number. Gautier and Khalil (1992) require less than 100; above this limit noise
# dominates.
_POOR_CONDITION = 400.0
_LARGEST_CONDITION = 1000.0
# number of random states, enough to show every effect of the arm's mechanics on the torque
_STATES = 50


def excitation_warnings(base: BaseParameters, regressor: Regressor) -> list[str]:
    """Return warnings about parameters that a motion excites too little.

    Parameters
    ----------
    base : BaseParameters
        Base parameters of links, viscous and Coulomb friction along the motion.
    regressor : Regressor
        Regressor of the arm with the same columns.

    Raises
    ------
    IdentificationError
        If the motion has almost no excitation.
    """
    if base.rank == 0:
        raise IdentificationError(
            'the motion excites no parameter: record an excitation trajectory'
        )
    if base.condition_number > _LARGEST_CONDITION:
        raise IdentificationError(
            f'condition number {base.condition_number:.3g} means that the motion is too short or '
            'too small to excite the parameters: record a longer motion that moves every joint'
        )
    warnings = []
    possible = _structural_rank(regressor)
    if base.rank < possible:
        warnings.append(
            f'the motion identifies only {base.rank} of {possible} parameter combinations; all '
            'other combinations keep their CAD values: move every joint'
        )
    if base.condition_number > _POOR_CONDITION:
        warnings.append(
            f'condition number {base.condition_number:.0f} means that the motion excites the '
            'parameters poorly: record a longer or faster motion'
        )
    return warnings


def _structural_rank(regressor: Regressor) -> int:
    """Return the largest possible rank of the regressor, found from random states."""
    random = np.random.default_rng(0)
    states = random.uniform(-2.0, 2.0, (3, _STATES, regressor.robot.n))
    factor = triangular_factor(regressor.stack(*states))
    return find_base_parameters(factor, regressor.columns).rank


_FRICTION = (TermKind.VISCOUS, TermKind.COULOMB)


def without_insignificant_terms(
    fit: ModelFit, estimate: Estimate, bags: Sequence[SampleColumns], cad: ArmParameters
) -> tuple[ModelFit, list[str]]:
    """Repeat the fit without the joint terms whose coefficient is at the lower bound 0.

    An example is rotor inertia when a torque sensor is mounted behind the gear, where the sensor
    does not measure it. With an insignificant column in the fit, solvers without bounds would
    return an impossible rotor inertia. Friction (2.6), which every joint has, is removed only if
    the data clearly require a negative value.

    Parameters
    ----------
    estimate : Estimate
        Estimate of this fit, with standard deviations.
    bags : sequence of SampleColumns
        Identification bags.

    Returns
    -------
    ModelFit
        The original fit if no term is removed.
    list of str
        Removed columns.
    """
    model, start = fit.model, 10 * fit.model.n
    friction = np.array([term.kind in _FRICTION for _, term in model.joint_columns], dtype=bool)
    std = np.zeros(len(fit.theta)) if estimate.std is None else estimate.std
    insignificant = estimate.held_at_zero[start:] & (~friction | (fit.theta < -std)[start:])
    if not insignificant.any():
        return fit, []
    pairs = zip(model.joint_columns, insignificant, strict=True)
    kept = [own for own, is_left_out in pairs if not is_left_out]
    terms = tuple(tuple(t for j, t in kept if j == joint) for joint in range(model.n))
    smaller = JointModel(model.joint_names, model.link_names, terms)
    bank = RegressionBank(bags, [term for _, term in kept], estimate.inertial.ravel())
    left_out = np.array(model.columns[start:])[insignificant].tolist()
    return fit_model(bags, bank, smaller, cad, fit.noise), left_out


_ROUNDS = 2  # repeated, because another term may become insignificant without the removed one


@dataclass(frozen=True)
class IdentificationOptions:
    """Options of the identification.

    Attributes
    ----------
    friction : str
        'auto' or a key of `model_choice.FRICTION_MODELS`.
    solvers : tuple of str
        Names in `SOLVERS`; the solvers in `solvers.ALWAYS` always run.
    progress : callable or None
        Function that receives the name of each slow step.
    bounds : LinkBounds
        Bounds of total mass and centres of mass.
    coupled : sequence of (joint, driver)
        Pairs of joints, the first of which is driven by the motion of the second, in addition to
        the pairs in the configuration.
    tilt : bool
        Whether to estimate the direction of gravity.
    """

    conditioning: ConditioningOptions = field(default_factory=ConditioningOptions)
    friction: str = AUTOMATIC
    solvers: tuple[str, ...] = DEFAULT
    progress: Callable[[str], None] | None = None
    bounds: LinkBounds = field(default_factory=LinkBounds)
    coupled: CoupledJoints = ()
    tilt: bool = True


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
    config : ArmConfig or None
        Configuration with rotor inertia; None if the drives are unknown.
    identification : sequence of Recording
        Recordings from which all choices and fits are made.
    validation : sequence of Recording
        Recordings whose torque is only predicted, for validation.
    stopwatch : Stopwatch
        Records the time of each stage.

    Raises
    ------
    IdentificationError
        If a recording is too short, or its motion excites too little.
    """
    cad = ArmParameters.stated(robot, config)
    level = Regressor(robot)
    with stopwatch.stage('conditioning'):
        conditioner = Conditioner(identification, options.conditioning)
        motion = _prepared(level, conditioner, identification, cad, options)
        robot, choice = motion.robot, motion.choice
        validation_bags = [
            condition_once(
                Regressor(robot), choice.conditioner, recording, choice.kinematics, predicted=True
            )
            for recording in validation
        ]
    bags = choice.bags
    with stopwatch.stage('model selection'):
        coupled = (*(config.coupled_joints if config else ()), *options.coupled)
        fit = choose_model(robot, bags, cad, options.friction, coupled)
    with stopwatch.stage('solvers'):
        fit, estimates, left_out, held = _solved(fit, cad, bags, options)
    with stopwatch.stage('regression'):
        thesis_base, used_base = _bases(fit, bags, motion.stated_bags)
        warnings = [text for bag in (*identification, *validation) for text in bag.warnings]
        warnings += conditioner.warnings + excitation_warnings(thesis_base, level)
    with stopwatch.stage('assessment'):
        solutions = {
            name: Solution(estimate, assess(estimate, bags), assess(estimate, validation_bags))
            for name, estimate in estimates.items()
        }
        recommended, names = solutions[RECOMMENDED], fit.model.joint_names
        errors = find_input_errors(level.robot, motion.stated_bags, cad)
        warnings += errors
        warnings += recommended.estimate.notes
        warnings += error_warnings(solutions, bags, cad, names)
        warnings += joint_warnings(recommended, names) + held
        if not errors:
            warnings += coupling_warnings(recommended, bags, names)
        demands = [
            [bag_demand(fit, bags, bag) for bag in group] for group in (bags, validation_bags)
        ]
        warnings += extrapolation_warnings(fit, *demands)
    return IdentificationResult(
        robot=robot,
        cad=cad,
        conditioner=choice.conditioner,
        gravity=motion.gravity,
        delay=motion.delay,
        filter_choice=choice,
        validation=validation_bags,
        thesis_base=thesis_base,
        used_base=used_base,
        fit=fit,
        solutions=solutions,
        left_out=left_out,
        demands=demands[0] + demands[1],
        warnings=list(dict.fromkeys(warnings)),
    )


@dataclass(frozen=True, eq=False)
class _PreparedBags:
    """Filtered bags with estimated gravity and delays; `stated_bags` have the stated gravity."""

    robot: Robot
    choice: FilterChoice
    stated_bags: list[SampleColumns]
    gravity: GravityDirection
    delay: EffortDelay


def _prepared(
    level: Regressor,
    conditioner: Conditioner,
    identification: Sequence[Recording],
    cad: ArmParameters,
    options: IdentificationOptions,
) -> _PreparedBags:
    """Choose the filter, then estimate the direction of gravity and the signal delays."""
    robot = level.robot
    choice = choose_filter(level, conditioner, identification)
    stated_bags = choice.bags
    gravity = GravityDirection.stated_by(robot)
    if options.tilt:
        gravity = find_gravity(robot, stated_bags, cad)
        robot = robot.with_gravity(gravity.used)
    regressor = Regressor(robot)
    if gravity.tilt > 0.0:
        choice = choose_filter(regressor, conditioner, identification)
    late = choice.has_late_velocities
    in_time = choice.excerpts(regressor, identification, in_time=True) if late else None
    delay = find_effort_delay(choice.excerpts(regressor, identification), cad, in_time)
    choice = choice.with_effort_delay(regressor, identification, delay)
    choice = replace(choice, bags=weighted_bags(choice.bags, cad))
    if gravity.tilt == 0.0:
        stated_bags = choice.bags
    return _PreparedBags(robot, choice, stated_bags, gravity, delay)


def _solved(
    fit: ModelFit, cad: ArmParameters, bags: list[SampleColumns], options: IdentificationOptions
) -> tuple[ModelFit, dict[str, Estimate], list[str], list[str]]:
    """Run the solvers with and without insignificant terms; return results and removed terms."""
    left_out: list[str] = []
    warnings: list[str] = []
    how = (options.solvers, options.progress, options.bounds)
    for _ in range(_ROUNDS):
        estimates = solve_all(fit, cad, *how)
        warnings += bound_warnings(estimates[RECOMMENDED], fit, cad.inertial[:, 0])
        fit, insignificant = without_insignificant_terms(fit, estimates[RECOMMENDED], bags, cad)
        left_out += insignificant
        if not insignificant:
            break
    else:
        estimates = solve_all(fit, cad, *how)
    return fit, estimates, left_out, warnings


def _bases(
    fit: ModelFit, bags: Sequence[SampleColumns], stated_bags: Sequence[SampleColumns]
) -> tuple[BaseParameters, BaseParameters]:
    """Return the base parameters of the thesis's torque model and of the fitted model.

    Both sets of base parameters are computed with the stated gravity. With a slight tilt of
    gravity more parameters are identifiable, but so weakly that every motion would seem to excite
    them poorly.
    """
    model = JointModel.uniform(fit.model.joint_names, fit.model.link_names, THESIS_TERMS)
    regressions = [RegressionBank(stated_bags, THESIS_TERMS).regression(model), fit.regression]
    if stated_bags is not bags:
        own = [term for _, term in fit.model.joint_columns]
        regressions[1] = RegressionBank(stated_bags, own, fit.inertial).regression(fit.model)
    thesis, used = (find_base_parameters(r.system().R, r.columns) for r in regressions)
    return thesis, used
