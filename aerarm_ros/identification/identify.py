"""From recordings to estimates: the offline flow of the architecture in one function."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.assessment.assessment import assess
from aerarm_ros.identification.assessment.bag_demand import bag_demand, extrapolation_warnings
from aerarm_ros.identification.assessment.identification_result import (
    IdentificationResult,
    Solution,
)
from aerarm_ros.identification.assessment.plausibility import (
    bound_warnings,
    error_warnings,
    joint_warnings,
)
from aerarm_ros.identification.assessment.residual_trend import residual_trend, trend_warnings
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.conditioning_options import ConditioningOptions
from aerarm_ros.identification.model_choice.bag_weights import weighted_bags
from aerarm_ros.identification.model_choice.effort_delay import EffortDelay, find_effort_delay
from aerarm_ros.identification.model_choice.filter_choice import (
    FilterChoice,
    choose_filter,
    condition_once,
)
from aerarm_ros.identification.model_choice.gravity_direction import GravityDirection, find_gravity
from aerarm_ros.identification.model_choice.model_choice import AUTOMATIC, choose_model
from aerarm_ros.identification.model_choice.nil_terms import without_nil_terms
from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.parameters.coupled_joints import CoupledJoints
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import THESIS_TERMS
from aerarm_ros.identification.parameters.link_bounds import LinkBounds
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.regression.base_parameters import (
    BaseParameters,
    find_base_parameters,
)
from aerarm_ros.identification.regression.excitation_check import excitation_warnings
from aerarm_ros.identification.regression.model_fit import ModelFit
from aerarm_ros.identification.regression.regression_bank import RegressionBank
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.identification.rollout.rollout_error import RolloutError, rollout_error
from aerarm_ros.identification.rollout.rollout_windows import RolloutWindows, rollout_samples
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.solvers.solvers import FAST, RECOMMENDED, solve_all
from aerarm_ros.identification.stopwatch import Stopwatch
from aerarm_ros.model.regressor import Regressor

_ROUNDS = 2  # without one term another one may turn out to be nil


@dataclass(frozen=True)
class IdentificationOptions:
    """What the user may choose.

    Attributes
    ----------
    conditioning : ConditioningOptions
    friction : str
        'auto' or a key of `model_choice.FRICTION_MODELS`.
    solvers : tuple of str
        Names in `solvers.SOLVERS`; those of `solvers.ALWAYS` run in any case.
    progress : callable or None
        Is told what takes its time.
    bounds : LinkBounds
        Of total mass and centres of mass.
    coupled : sequence of (joint, driver)
        Joints that another one's motion drives, besides those of the configuration.
    tilt : bool
        Whether gravity may point elsewhere than the robot has it, where the data say so.
    rollouts : bool
        Whether to simulate every solver's arm over half seconds of the validation bags, or of those
        of identification where there are none.
    """

    conditioning: ConditioningOptions = field(default_factory=ConditioningOptions)
    friction: str = AUTOMATIC
    solvers: tuple[str, ...] = FAST
    progress: Callable[[str], None] | None = None
    bounds: LinkBounds = field(default_factory=LinkBounds)
    coupled: CoupledJoints = ()
    tilt: bool = True
    rollouts: bool = False


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
    cad = ArmParameters.stated(robot, config)
    level = Regressor(robot)
    with stopwatch.stage('conditioning'):
        conditioner = Conditioner(identification, options.conditioning)
        motion = _prepared(level, conditioner, identification, cad, options)
        robot, choice = motion.robot, motion.choice
        held_out = [
            condition_once(Regressor(robot), choice.conditioner, recording, choice.kinematics, True)
            for recording in validation
        ]
    bags = choice.bags
    with stopwatch.stage('model selection'):
        coupled = (*(config.coupled_joints if config else ()), *options.coupled)
        fit, comparisons = choose_model(robot, bags, cad, options.friction, coupled)
    with stopwatch.stage('solvers'):
        windows = None
        if 'output_error' in options.solvers:
            samples = [rollout_samples(choice.conditioner, bag) for bag in identification]
            windows = RolloutWindows.of(robot, samples)
        fit, estimates, left_out, held = _solved(fit, cad, bags, options, windows)
    with stopwatch.stage('regression'):
        thesis_base, used_base = _bases(fit, bags, motion.level_bags)
        warnings = [text for bag in (*identification, *validation) for text in bag.warnings]
        warnings += conditioner.warnings + excitation_warnings(thesis_base, level)
    with stopwatch.stage('assessment'):
        solutions = _assessed(estimates, bags, held_out)
        warnings += _result_warnings(solutions, fit, bags) + held
        pairs = zip(bags, solutions[RECOMMENDED].identification, strict=True)
        trends = [residual_trend(*pair) for pair in pairs]
        warnings += trend_warnings(trends, fit.model.joint_names)
        demands = [[bag_demand(fit, bags, bag) for bag in group] for group in (bags, held_out)]
        warnings += extrapolation_warnings(fit, *demands)
    with stopwatch.stage('rollouts'):
        rolled = validation or identification
        rollouts = _rollouts(motion, fit, estimates, rolled) if options.rollouts else []
    return IdentificationResult(
        robot=robot,
        cad=cad,
        conditioner=choice.conditioner,
        gravity=motion.gravity,
        delay=motion.delay,
        filter_choice=choice,
        validation=held_out,
        thesis_base=thesis_base,
        used_base=used_base,
        fit=fit,
        comparisons=comparisons,
        solutions=solutions,
        left_out=left_out,
        demands=demands[0] + demands[1],
        trends=trends,
        rollouts=rollouts,
        warnings=list(dict.fromkeys(warnings)),
    )


@dataclass(frozen=True, eq=False)
class _PreparedBags:
    """Filtered bags, and what was found of gravity and delays; level: under gravity as stated."""

    robot: Robot
    choice: FilterChoice
    level_bags: list[SampleColumns]
    gravity: GravityDirection | None
    delay: EffortDelay | None


def _prepared(
    level: Regressor,
    conditioner: Conditioner,
    identification: Sequence[Recording],
    cad: ArmParameters,
    options: IdentificationOptions,
) -> _PreparedBags:
    """Choose the filter, then look for gravity's direction and for delays."""
    robot, gravity, delay = level.robot, None, None
    choice = choose_filter(level, conditioner, identification)
    level_bags = choice.bags
    if options.tilt:
        gravity = find_gravity(robot, level_bags, cad)
        robot = robot.with_gravity(gravity.used)
    regressor = Regressor(robot)
    if gravity is not None and gravity.tilt > 0.0:
        choice = choose_filter(regressor, conditioner, identification)
    if not options.conditioning.exact_stamps:
        late = choice.has_late_velocities
        in_time = choice.excerpts(regressor, identification, True) if late else None
        delay = find_effort_delay(choice.excerpts(regressor, identification), cad, in_time)
        choice = choice.with_effort_delay(regressor, identification, delay)
    choice = replace(choice, bags=weighted_bags(choice.bags, cad))
    if gravity is None or gravity.tilt == 0.0:
        level_bags = choice.bags
    return _PreparedBags(robot, choice, level_bags, gravity, delay)


def _rollouts(
    motion: _PreparedBags,
    fit: ModelFit,
    estimates: Mapping[str, Estimate],
    recordings: Sequence[Recording],
) -> list[RolloutError]:
    """Simulate each solver's arm along recordings."""
    thetas = {name: estimate.theta for name, estimate in estimates.items()}
    errors = []
    for recording in recordings:
        samples = rollout_samples(motion.choice.conditioner, recording)
        errors += rollout_error(motion.robot, fit.model, samples, thetas)
    return errors


def _assessed(
    estimates: Mapping[str, Estimate],
    bags: Sequence[SampleColumns],
    held_out: Sequence[SampleColumns],
) -> dict[str, Solution]:
    return {
        name: Solution(estimate, assess(estimate, bags), assess(estimate, held_out))
        for name, estimate in estimates.items()
    }


def _solved(
    fit: ModelFit,
    cad: ArmParameters,
    bags: list[SampleColumns],
    options: IdentificationOptions,
    windows: RolloutWindows | None,
) -> tuple[ModelFit, dict[str, Estimate], list[str], list[str]]:
    """Solve, and again without the terms that come out as nil; say which, and what that means."""
    left_out: list[str] = []
    warnings: list[str] = []
    how = (options.solvers, options.progress, options.bounds, windows)
    for _ in range(_ROUNDS):
        estimates = solve_all(fit, cad, bags, *how)
        warnings += bound_warnings(estimates[RECOMMENDED], fit, cad.inertial[:, 0])
        fit, nil = without_nil_terms(fit, estimates[RECOMMENDED], bags, cad)
        left_out += nil
        if not nil:
            break
    else:
        estimates = solve_all(fit, cad, bags, *how)
    return fit, estimates, left_out, warnings


def _result_warnings(
    solutions: dict[str, Solution], fit: ModelFit, bags: list[SampleColumns]
) -> list[str]:
    """Return what the estimates say about themselves and about their input."""
    recommended = solutions[RECOMMENDED]
    return [
        *recommended.estimate.notes,
        *error_warnings(solutions, bags, fit.model.joint_names),
        *joint_warnings(recommended, bags, fit.model.joint_names),
    ]


def _bases(
    fit: ModelFit, bags: Sequence[SampleColumns], level_bags: Sequence[SampleColumns]
) -> tuple[BaseParameters, BaseParameters]:
    """Return the base parameters of the thesis's columns, and those of all that was fitted.

    Both of a base that stands as stated: under a slight tilt some more parameters have an effect,
    but so little that they would make any motion look like a poor one.
    """
    model = JointModel.uniform(fit.model.joint_names, fit.model.link_names, THESIS_TERMS)
    regressions = [RegressionBank(level_bags, THESIS_TERMS).regression(model), fit.regression]
    if level_bags is not bags:
        own = [term for _, term in fit.model.joint_columns]
        regressions[1] = RegressionBank(level_bags, own, fit.inertial).regression(fit.model)
    thesis, used = (find_base_parameters(r.system().R, r.columns) for r in regressions)
    return thesis, used
