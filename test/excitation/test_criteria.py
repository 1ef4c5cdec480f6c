"""Regressor, identifiable space and criteria against their definitions and differences."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.criteria import (
    BothCriterion,
    ConditionCriterion,
    IdentifiableSpace,
    InformationCriterion,
    SmoothRegressor,
)
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import JointReference


def states_of(trajectory: FourierTrajectory) -> JointReference:
    return trajectory.evaluate(np.linspace(0.0, 10.0, 40, endpoint=False))


def test_is_the_exact_regressor_away_from_standstill(
    robot: Robot, trajectory: FourierTrajectory
) -> None:
    states = states_of(trajectory)
    smooth = SmoothRegressor(robot, width=1e-9).stack(states)
    exact = Regressor(robot, rotor_inertia=True).stack(*states)
    np.testing.assert_allclose(smooth.reshape(exact.shape), exact, atol=1e-12)


def test_times_the_prior_it_is_the_torque(
    robot: Robot, arm: ArmConfig, setup: ExcitationSetup, trajectory: FourierTrajectory
) -> None:
    states = states_of(trajectory)
    regressor = SmoothRegressor(robot, width=1e-9)
    prior = Regressor(robot, rotor_inertia=True).parameters(
        robot.inertial_parameters, robot.viscous, robot.coulomb, arm.column('reflected_inertia')
    )
    np.testing.assert_allclose(
        regressor.stack(states) @ prior, setup.effort_model.effort(*states), atol=1e-10
    )


def test_derivatives_by_central_differences(robot: Robot, trajectory: FourierTrajectory) -> None:
    regressor, states, step = SmoothRegressor(robot), states_of(trajectory), 1e-4
    for kind, joint, derivative in regressor.derivatives(states, regressor.stack(states)):
        shifted = []
        for sign in (1.0, -1.0):
            moved = [part.copy() for part in states]
            moved[kind][:, joint] += sign * step
            shifted.append(regressor.stack(JointReference(*moved)))
        numeric = (shifted[0] - shifted[1]) / (2.0 * step)
        np.testing.assert_allclose(derivative, numeric, atol=2e-4)


def test_ranks_of_the_arm(robot: Robot) -> None:
    regressor = SmoothRegressor(robot)
    thesis = IdentifiableSpace.of_regressor(robot, regressor, regressor.thesis_columns)
    assert (thesis.rank, thesis.basis.shape) == (30, (48, 30))  # thesis 5.3
    assert IdentifiableSpace.of_regressor(robot, regressor, slice(None)).rank == 32


def test_gravity_across_joint_1_shows_two_more() -> None:
    tilted = load_robot(gravity_in_base=(3.0, 0.0, -9.3))
    regressor = SmoothRegressor(tilted)
    space = IdentifiableSpace.of_regressor(tilted, regressor, regressor.thesis_columns)
    assert space.rank == 32


def test_every_trajectory_lies_in_the_space(robot: Robot, trajectory: FourierTrajectory) -> None:
    regressor = SmoothRegressor(robot)
    space = IdentifiableSpace.of_regressor(robot, regressor, slice(None))
    stacked = regressor.stack(trajectory.evaluate(np.linspace(0.0, 10.0, 200)))
    matrix = stacked.reshape(-1, stacked.shape[2])
    outside = matrix - matrix @ space.basis @ space.basis.T
    assert np.abs(outside).max() < 1e-9 * np.abs(matrix).max()
    assert np.linalg.matrix_rank(matrix[:, space.base_columns]) == space.rank


@pytest.mark.parametrize(('urdf', 'locked', 'base'), [('ur10_robot.urdf', (), 36)])
def test_six_joint_arm(
    example_urdf: Callable[[str], Path], urdf: str, locked: tuple[str, ...], base: int
) -> None:
    arm = load_robot(example_urdf(urdf), locked=locked)
    regressor = SmoothRegressor(arm)
    rigid = IdentifiableSpace.of_regressor(arm, regressor, slice(0, 10 * arm.n))
    assert rigid.rank == base  # six rotary joints, the first along gravity: 36 (Khalil)


NOISE = np.array([0.17, 0.09, 0.08, 0.09])


@pytest.fixture(scope='module')
def regressor(robot) -> SmoothRegressor:
    return SmoothRegressor(robot)


@pytest.fixture(scope='module')
def space(robot, regressor: SmoothRegressor) -> IdentifiableSpace:
    return IdentifiableSpace.of_regressor(robot, regressor, slice(None))


@pytest.fixture(scope='module')
def thesis(robot, regressor: SmoothRegressor) -> ConditionCriterion:
    columns = regressor.thesis_columns
    return ConditionCriterion(
        IdentifiableSpace.of_regressor(robot, regressor, columns), columns, sharpness=20.0
    )


@pytest.fixture(scope='module')
def stacked(regressor: SmoothRegressor, trajectory: FourierTrajectory) -> np.ndarray:
    return regressor.stack(trajectory.evaluate(np.linspace(0.0, 10.0, 200, endpoint=False)))


@pytest.mark.parametrize('kind', ['thesis', 'scaled', 'information', 'both'])
def test_derivative_along_motions_of_the_arm(
    kind: str, regressor, space, thesis, trajectory: FourierTrajectory
) -> None:
    information = InformationCriterion(space, NOISE)
    criterion = {
        'thesis': thesis,
        'scaled': ConditionCriterion(space, slice(None), scaled=True),
        'information': information,
        'both': BothCriterion(information, thesis, limit=np.log(50.0)),
    }[kind]
    time, step = np.linspace(0.0, 10.0, 200, endpoint=False), 1e-5
    direction = np.random.default_rng(2).normal(size=trajectory.alpha.shape)

    def at(shift: float) -> np.ndarray:
        moved = FourierTrajectory(
            0.1, trajectory.q0, trajectory.alpha + shift * direction, trajectory.beta
        )
        return regressor.stack(moved.evaluate(time))

    change = (at(step) - at(-step)) / (2.0 * step)
    value, gradient = criterion.evaluate(at(0.0))
    numeric = (criterion.evaluate(at(step))[0] - criterion.evaluate(at(-step))[0]) / (2.0 * step)
    assert (gradient * change).sum() == pytest.approx(numeric, rel=1e-4, abs=1e-7)
    assert np.isfinite(value)


def test_condition_number_is_that_of_the_non_zero_singular_values(thesis, stacked) -> None:
    matrix = stacked[:, :, :48].reshape(-1, 48)
    singular = np.linalg.svd(matrix, compute_uv=False)[:30]
    assert thesis.condition_number(stacked) == pytest.approx(singular[0] / singular[-1], rel=1e-6)
    # The softened logarithm is above the exact one, by little.
    assert 0.0 < thesis.evaluate(stacked)[0] - np.log(singular[0] / singular[-1]) < 0.2


def test_scaled_condition_number_ignores_units(space, stacked) -> None:
    criterion = ConditionCriterion(space, slice(None), scaled=True)
    units = np.random.default_rng(0).uniform(0.1, 10.0, stacked.shape[2])
    assert criterion.condition_number(stacked * units) == pytest.approx(
        criterion.condition_number(stacked), rel=1e-6
    )


def test_the_information_matrix_predicts_the_scatter_of_least_squares(space, stacked) -> None:
    """Monte Carlo: the scatter of least-squares estimates is the Cramer-Rao bound."""
    generator = np.random.default_rng(1)
    weighted = (stacked / NOISE[:, np.newaxis]).reshape(-1, stacked.shape[2])
    inverse = np.linalg.pinv(weighted, rcond=1e-9)
    estimates = inverse @ generator.normal(size=(len(weighted), 3000))
    scatter = np.cov(space.basis.T @ estimates)
    predicted = InformationCriterion(space, NOISE).evaluate(stacked)[0]
    mean_information = np.log(len(stacked))  # the criterion is that of one mean sample
    assert np.linalg.slogdet(scatter)[1] / space.rank + mean_information == pytest.approx(
        2.0 * predicted, abs=0.02
    )


def test_a_bounded_criterion_counts_twice_beyond_its_limit(space, thesis, stacked) -> None:
    value, information = thesis.evaluate(stacked)[0], InformationCriterion(space, NOISE)
    alone = information.evaluate(stacked)[0]
    below, above = (BothCriterion(information, thesis, value + s) for s in (1.0, -1.0))
    assert below.evaluate(stacked)[0] == pytest.approx(alone, abs=1e-6)
    assert above.evaluate(stacked)[0] == pytest.approx(alone + 2.0)
