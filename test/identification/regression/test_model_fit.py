"""Banks and fits equal regressions of all samples and Bayes' rule."""

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.uniform_motion import FOLDS
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.model_fit import (
    Prior,
    RegressionBank,
    posterior_covariance,
    solve_regularised,
)
from aerarm_ros.identification.regression import SampleColumns, TriangularSystem

SMOOTH = JointTerm(TermKind.COULOMB, 0.05)
OFFSET = JointTerm(TermKind.OFFSET)


def directly(bag: SampleColumns, model: JointModel, joint: int, rows: np.ndarray) -> np.ndarray:
    """Columns and torque of one joint's equation, from the samples."""
    parts = [bag.rigid[rows, joint]]
    for owner, term in model.joint_columns:
        column = bag.term(term)[rows, joint]
        parts.append((column if owner == joint else np.zeros_like(column))[:, None])
    return np.hstack([*parts, bag.samples.tau[rows, joint, None]])


@pytest.mark.parametrize('folds', [range(FOLDS), [0, 3]])
def test_any_model_on_any_part(result: IdentificationResult, folds) -> None:
    bags = [*result.identification, *result.validation]
    robot = result.robot
    terms = ((*THESIS_TERMS, ROTOR), (SMOOTH,), (SMOOTH, OFFSET), THESIS_TERMS)
    model = JointModel(robot.joint_names, robot.link_names, terms)
    bank = RegressionBank(bags, (*THESIS_TERMS, ROTOR, OFFSET, SMOOTH))
    regression = bank.regression(model, folds)
    for joint, factor in enumerate(regression.factors):
        rows = [b.samples.usable[:, joint] & np.isin(b.samples.fold, list(folds)) for b in bags]
        parts = [directly(b, model, joint, own) for b, own in zip(bags, rows, strict=True)]
        expected = np.vstack(parts)
        assert np.allclose(factor.T @ factor, expected.T @ expected, atol=1e-8)
        assert regression.rows[joint] == len(expected)


PRIOR = Prior(np.array([1.0, -2.0, 0.5]), np.array([0.1, 2.0, 30.0]))


@pytest.mark.parametrize('size', [1.0, 0.0])
def test_solution_and_covariance_are_those_of_bayes_rule(size: float) -> None:
    """Without data, the prior is left."""
    random = np.random.default_rng(0)
    R = size * np.triu(random.standard_normal((3, 3)))
    system = TriangularSystem(R, size * random.standard_normal(3))
    information = system.R.T @ system.R + np.diag(1.0 / PRIOR.std**2)
    assert np.allclose(posterior_covariance(system, PRIOR), np.linalg.inv(information))
    right = system.R.T @ system.z + PRIOR.mean / PRIOR.std**2
    assert np.allclose(solve_regularised(system, PRIOR), np.linalg.solve(information, right))
