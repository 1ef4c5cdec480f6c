"""Each criterion's value compared with its definition, and its derivative with differences."""

import numpy as np
import pytest

from aerarm_ros.excitation.criteria import (
    BothCriterion,
    ConditionCriterion,
    IdentifiableSpace,
    InformationCriterion,
    SmoothRegressor,
)
from aerarm_ros.excitation.trajectory import FourierTrajectory

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
    bound = InformationCriterion(space, NOISE).standard_deviations(stacked, len(stacked))
    seen = bound > 1e-6
    np.testing.assert_allclose(estimates.std(axis=1)[seen], bound[seen], rtol=0.06)


def test_half_the_noise_is_half_the_deviation(space, stacked) -> None:
    full, half = (InformationCriterion(space, s * NOISE).evaluate(stacked)[0] for s in (1.0, 0.5))
    assert full - half == pytest.approx(np.log(2.0))


def test_a_bounded_criterion_counts_twice_beyond_its_limit(space, thesis, stacked) -> None:
    value, information = thesis.evaluate(stacked)[0], InformationCriterion(space, NOISE)
    alone = information.evaluate(stacked)[0]
    below, above = (BothCriterion(information, thesis, value + s) for s in (1.0, -1.0))
    assert below.evaluate(stacked)[0] == pytest.approx(alone, abs=1e-6)
    assert above.evaluate(stacked)[0] == pytest.approx(alone + 2.0)
