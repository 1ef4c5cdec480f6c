"""Choosing how to clean the kinematics, by the torque error that is left."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.kinematics_filter import KinematicsFilter
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.parameters.joint_term import ROTOR, THESIS_TERMS
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.regression.regression_bank import RegressionBank
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.identification.solvers.least_squares_solver import solve_least_squares
from aerarm_ros.model.regressor import Regressor

_TERMS = (*THESIS_TERMS, ROTOR)
_ENOUGH = 120.0  # [s] of a long recording, from its middle, decide


@dataclass(frozen=True)
class FilterTrial:
    """A way to clean the kinematics, and the torque error [%] that least squares leaves then."""

    kinematics: KinematicsFilter
    error: float


@dataclass(frozen=True, eq=False)
class FilterChoice:
    """What was tried, and the samples of the best.

    Attributes
    ----------
    trials : list of FilterTrial
    kinematics : KinematicsFilter
        The one with the least error.
    bags : list of SampleColumns
        The recordings, filtered by it.
    """

    trials: list[FilterTrial]
    kinematics: KinematicsFilter
    bags: list[SampleColumns]


def choose_filter(
    regressor: Regressor, conditioner: Conditioner, recordings: Sequence[Recording]
) -> FilterChoice:
    """Clean the kinematics in every way that the recordings allow and keep the best.

    The torque is filtered equally in all trials, so their errors can be compared: real
    motion has content beyond the commanded harmonics, such as the ripple of dry friction,
    and measured velocities may lag; which matters more, the data decide.

    Parameters
    ----------
    regressor : Regressor
    conditioner : Conditioner
    recordings : sequence of Recording
        To identify from.

    Raises
    ------
    IdentificationError
        If a recording is too short.
    """
    measured = all(recording.dq is not None for recording in recordings)
    excerpts = [_excerpt(recording) for recording in recordings]
    trials: list[FilterTrial] = []
    best: list[SampleColumns] = []
    for kinematics in conditioner.candidates():
        if not (measured or kinematics.from_position):
            continue
        bags = [SampleColumns(conditioner.condition(e, kinematics), regressor) for e in excerpts]
        error = _least_error(bags, regressor)
        if not trials or error < min(trial.error for trial in trials):
            best = bags
        trials.append(FilterTrial(kinematics, error))
    chosen = min(trials, key=lambda trial: trial.error).kinematics
    bags = [
        bag if excerpt is whole else condition_once(regressor, conditioner, whole, chosen)
        for bag, excerpt, whole in zip(best, excerpts, recordings, strict=True)
    ]
    conditioner.forget_motions()
    return FilterChoice(trials, chosen, bags)


def condition_once(
    regressor: Regressor,
    conditioner: Conditioner,
    recording: Recording,
    kinematics: KinematicsFilter,
) -> SampleColumns:
    """Return the columns of a bag that won't be filtered again, with no more memory than needed."""
    conditioner.forget_motions()
    samples = conditioner.condition(recording, kinematics)
    conditioner.forget_motions()
    return SampleColumns(samples, regressor)


def _excerpt(recording: Recording) -> Recording:
    if recording.duration <= _ENOUGH:
        return recording
    share = 0.5 * _ENOUGH / recording.duration
    return recording.part(0.5 - share, 0.5 + share, '')


def _least_error(bags: Sequence[SampleColumns], regressor: Regressor) -> float:
    robot = regressor.robot
    model = JointModel.uniform(robot.joint_names, robot.link_names, _TERMS)
    regression = RegressionBank(bags, _TERMS).regression(model)
    return regression.error(solve_least_squares(regression, np.zeros(len(model.columns))))
