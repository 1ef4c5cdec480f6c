"""Friction models by name and by cross-validation, which equals fitting and predicting."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from identified import identified

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.uniform_motion import FOLDS
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    ArmParameters,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.model_choice import (
    DISTANCES,
    FRICTION_MODELS,
    CrossValidation,
    candidate_terms,
    choose_model,
    friction_terms,
)
from aerarm_ros.identification.model_fit import RegressionBank
from aerarm_ros.ros.library.identification import IdentifiedModel


@pytest.mark.parametrize('name', sorted(FRICTION_MODELS))
def test_named_models_are_fitted_as_they_are(result: IdentificationResult, name: str) -> None:
    fit = choose_model(result.robot, result.identification, result.cad, name)
    assert fit.model.terms == (FRICTION_MODELS[name],) * 4


def test_models_are_combined_by_name_and_unknown_ones_refused() -> None:
    """Dahl friction replaces the step of all dry friction."""
    kinds = (TermKind.COULOMB, TermKind.LOAD)
    dry = [term for term in friction_terms('load+dahl') if term.kind in kinds]
    assert sorted(term.kind.value for term in dry) == ['fl', 'fs']
    assert all(term.distance > 0.0 for term in dry)
    for name in ('', 'wet', 'load+', 'load+wet'):
        with pytest.raises(IdentificationError, match='friction model'):
            friction_terms(name)


START = (*THESIS_TERMS, ROTOR)


def test_score_is_that_of_five_separate_fits(
    columns_of: Callable, arm, robot: Robot, cad: ArmParameters
) -> None:
    bank = RegressionBank([columns_of(arm, noise=1.0)], candidate_terms(), arm.inertial.ravel())
    model = JointModel.uniform(robot.joint_names, robot.link_names, START)
    expected = 0.0
    for fold in range(FOLDS):
        others = [other for other in range(FOLDS) if other != fold]
        training, held_out = bank.regression(model, others), bank.regression(model, [fold])
        system = training.system(100.0)
        # The same prior: links about CAD, a coefficient's deviation explains all of the torque.
        norms = training.column_norms()
        links = cad.inertial.ravel()
        shifted = [np.linalg.norm(own[:, -1] - own[:, :40] @ links) for own in training.factors]
        terms = enumerate(model.joint_columns, start=40)
        joints = [shifted[joint] / norms[joint, index] for index, (joint, _) in terms]
        std = np.concatenate([0.3 * cad.inertial_scale().ravel(), joints])
        mean = np.concatenate([links, np.zeros(12)])
        rows = np.vstack([system.R, np.diag(1.0 / std)])
        right = np.concatenate([system.z, mean / std])
        theta = np.linalg.lstsq(rows, right, rcond=None)[0]
        theta[40:] = np.maximum(theta[40:], 0.0)
        expected += np.sum((100.0 * held_out.residual_norms(theta)) ** 2)
    spread = 0.3 * cad.inertial_scale().ravel()
    validation = CrossValidation(bank, cad.inertial.ravel(), spread, np.full(4, 100.0))
    assert validation.score([START] * 4) == pytest.approx(expected, rel=1e-5)
    variants = [START, (*START, JointTerm(TermKind.OFFSET)), START[:2]]
    together = validation.score_variants([START] * 4, 2, variants)
    alone = [validation.score([START, START, variant, START]) for variant in variants]
    assert np.allclose(together, alone)


def test_friction_that_builds_up_is_noticed_and_predicted(make_arm: Callable, robot: Robot) -> None:
    """Joint 3 has dry friction that builds up over 20 mrad, the others have friction of a step."""
    arm = make_arm()
    bags = []
    for seed in (1, 2):
        bag = arm.recording(seed, noise=1.0)
        tau, state, last = bag.tau.copy(), 1.0, bag.q[0, 2]
        for row, angle in enumerate(bag.q[:, 2]):
            step, last = angle - last, angle
            state += step / 0.02 * (1.0 - state * np.sign(step))
            tau[row, 2] += 0.5 * state
        bags.append(replace(bag, tau=tau))

    chosen, step = (identified(*bags, friction=name) for name in ('auto', 'coulomb'))
    distances = [max(term.distance for term in own) for own in chosen.fit.model.terms]
    assert distances[2] in DISTANCES
    assert distances[2] >= 0.01
    assert [distances[joint] for joint in (0, 1, 3)] == [0.0, 0.0, 0.0]
    errors = [r.recommended.validation[0].per_joint_filtered[2] for r in (chosen, step)]
    assert errors[0] < 0.5 * errors[1]
    # the same torque from the complete model
    samples = chosen.validation[0].samples
    torque = IdentifiedModel(robot, chosen.recommended.estimate).torque(
        samples.q, samples.dq, samples.ddq, is_motion=True
    )
    assert np.allclose(torque, chosen.recommended.validation[0].prediction.raw)


@pytest.mark.parametrize(
    ('extra', 'expected'),
    [
        (lambda dq: 0.4 * np.sign(dq) * np.exp(-((dq / 0.15) ** 2)), {TermKind.STRIBECK}),
        # On a joint that never rests long, half of it looks like an offset, half like Coulomb.
        (lambda dq: 0.3 * np.maximum(np.sign(dq), 0.0), {TermKind.FORWARD, TermKind.OFFSET}),
        (np.zeros_like, set()),
    ],
    ids=['stribeck', 'asymmetric', 'none'],
)
def test_friction_of_one_joint_is_noticed(
    make_arm: Callable, extra: Callable, expected: set
) -> None:
    bag = make_arm(rate=200.0).recording(1, noise=1.0)
    tau = bag.tau.copy()
    tau[:, 2] += extra(np.gradient(bag.q[:, 2], bag.time))
    found = identified(replace(bag, tau=tau), friction='auto')
    kinds = {term.kind for term in found.fit.model.terms[2]}
    assert kinds & expected or not expected
    optional = {TermKind.STRIBECK, TermKind.FORWARD, TermKind.BACKWARD, TermKind.CREEP}
    assert expected or not kinds & optional
    assert found.recommended.estimate.physically_consistent
