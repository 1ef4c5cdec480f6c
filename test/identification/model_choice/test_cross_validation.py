"""Cross-validation by elimination equals fitting and predicting from the samples."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.conditioning.uniform_motion import FOLDS
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.model_choice.model_choice import (
    CrossValidation,
    candidate_terms,
    select_terms,
)
from aerarm_ros.identification.regression.model_fit import RegressionBank
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.model.regressor import Regressor

START = (*THESIS_TERMS, ROTOR)


def bank_of(arm, robot: Robot, noise: float) -> RegressionBank:
    recording = arm.recording(1, noise=noise)
    conditioner = Conditioner([recording], ConditioningOptions())
    kinematics = conditioner.candidates()[0]
    bag = SampleColumns(conditioner.condition(recording, kinematics), Regressor(robot))
    return RegressionBank([bag], candidate_terms(), arm.inertial.ravel())


def validation_of(bank: RegressionBank, cad: ArmParameters) -> CrossValidation:
    return CrossValidation(
        bank, cad.inertial.ravel(), 0.3 * cad.inertial_scale().ravel(), np.full(4, 100.0)
    )


@pytest.fixture(scope='module')
def cad(robot: Robot, config: ArmConfig) -> ArmParameters:
    return ArmParameters.stated(robot, config)


def test_score_is_that_of_five_separate_fits(
    make_arm: Callable, robot: Robot, cad: ArmParameters
) -> None:
    bank = bank_of(make_arm(), robot, 1.0)
    model = JointModel.uniform(robot.joint_names, robot.link_names, START)
    expected = 0.0
    for fold in range(FOLDS):
        others = [other for other in range(FOLDS) if other != fold]
        training, held_out = bank.regression(model, others), bank.regression(model, [fold])
        system = training.system(100.0)
        # The same prior: links about CAD, a coefficient's deviation explains all of the torque.
        norms = training.column_norms()
        links = cad.inertial.ravel()
        shifted = [
            np.linalg.norm(factor[:, -1] - factor[:, :40] @ links) for factor in training.factors
        ]
        std = np.concatenate(
            [
                0.3 * cad.inertial_scale().ravel(),
                [
                    shifted[joint] / norms[joint, index]
                    for index, (joint, _) in enumerate(model.joint_columns, start=40)
                ],
            ]
        )
        mean = np.concatenate([links, np.zeros(12)])
        rows = np.vstack([system.R, np.diag(1.0 / std)])
        right = np.concatenate([system.z, mean / std])
        theta = np.linalg.lstsq(rows, right, rcond=None)[0]
        theta[40:] = np.maximum(theta[40:], 0.0)
        expected += np.sum((100.0 * held_out.residual_norms(theta)) ** 2)
    assert validation_of(bank, cad).score([START] * 4) == pytest.approx(expected, rel=1e-5)


def test_variants_are_scored_as_whole_models(
    make_arm: Callable, robot: Robot, cad: ArmParameters
) -> None:
    validation = validation_of(bank_of(make_arm(), robot, 1.0), cad)
    variants = [START, (*START, JointTerm(TermKind.OFFSET)), START[:2]]
    together = validation.score_variants([START] * 4, 2, variants)
    alone = [validation.score([START, START, variant, START]) for variant in variants]
    assert np.allclose(together, alone)


@pytest.mark.parametrize('load', [0.0, 0.06])
def test_load_dependent_friction_is_found_where_it_is(
    make_arm: Callable, robot: Robot, cad: ArmParameters, load: float
) -> None:
    """Joint 2 carries the arm: only there does the load change much."""
    validation = validation_of(bank_of(make_arm(load=load), robot, 1.0), cad)
    chosen, comparisons = select_terms(validation, [START] * 4)
    kinds = {term.kind for term in chosen[1]}
    assert (TermKind.LOAD in kinds) == (load > 0.0)
    assert comparisons
    assert all(TermKind.COULOMB in {t.kind for t in own} for own in chosen)


def test_nothing_is_added_to_a_model_that_is_complete(
    make_arm: Callable, robot: Robot, cad: ArmParameters
) -> None:
    validation = validation_of(bank_of(make_arm(), robot, 1.0), cad)
    chosen, _ = select_terms(validation, [START] * 4)
    extra = sum(len(own) - len(START) for own in chosen)
    assert extra <= 1
