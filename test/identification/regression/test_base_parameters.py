"""Identifiable combinations of parameters, and the noise of the torque."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identify import excitation_warnings
from aerarm_ros.identification.model_fit import (
    BaseParameters,
    find_base_parameters,
    noise_from_residuals,
)
from aerarm_ros.model.regressor import Regressor


def factor_of(robot: Robot, rotor_inertia: bool) -> tuple[np.ndarray, tuple[str, ...]]:
    random = np.random.default_rng(0)
    regressor = Regressor(robot, rotor_inertia)
    stacked = regressor.stack(*random.uniform(-2.0, 2.0, (3, 200, robot.n)))
    return np.linalg.qr(stacked, mode='r'), regressor.columns


@pytest.mark.parametrize(
    ('gravity', 'rotor_inertia', 'rank'),
    [
        ((0.0, 0.0, -9.81), False, 30),  # the thesis's 48 columns, section 5.3
        ((0.0, 0.0, -9.81), True, 32),  # the rotors of joints 3 and 4 stand out from the links
        ((2.0, 1.0, -9.5), False, 32),  # tilted gravity reveals link 1's first moments
        ((2.0, 1.0, -9.5), True, 34),
        # A base that is upside down by 3.1416 rad leaves gravity 7e-6 about the first axis.
        ((0.0, 9.81 * np.sin(3.1416), -9.81 * np.cos(3.1416)), False, 30),
    ],
)
def test_ranks_of_this_arm(robot: Robot, gravity: tuple, rotor_inertia: bool, rank: int) -> None:
    base = find_base_parameters(*factor_of(robot.with_gravity(gravity), rotor_inertia))
    assert (len(base.columns), base.rank) == (52 if rotor_inertia else 48, rank)
    assert base.condition_number < (100.0 if rank == 30 else np.inf)


def test_only_distal_rotors_are_separable_from_links(robot: Robot) -> None:
    base = find_base_parameters(*factor_of(robot, True))
    found = {base.columns[i] for i in base.independent}
    assert {'Ja_joint3', 'Ja_joint4'} <= found
    assert not {'Ja_joint1', 'Ja_joint2'} & found
    first = next(e for e in base.expressions() if e.startswith('Izz_link1'))
    assert first.endswith('+ Ja_joint1')
    assert '+ 0.4225 m_link4' in first  # the square of 0.65 m


def test_parameters_with_equal_base_parameters_give_equal_torque(robot: Robot) -> None:
    factor, columns = factor_of(robot, True)
    base = find_base_parameters(factor, columns)
    random = np.random.default_rng(1)
    theta, other = random.standard_normal((2, len(columns)))
    values = base.values(theta)
    completed = base.complete(values, other)
    assert np.allclose(base.values(completed), values)
    assert np.allclose(factor @ completed, factor @ theta, atol=1e-6)
    assert np.array_equal(completed[base.dependent], other[base.dependent])


def autoregressive(rho: float, count: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    shocks = np.sqrt(1.0 - rho**2) * random.standard_normal(count)
    values = np.empty(count)
    values[0] = random.standard_normal()
    for k in range(1, count):
        values[k] = rho * values[k - 1] + shocks[k]
    return values


@pytest.mark.parametrize('rho', [0.0, 0.5, 0.9])
def test_correlation_time_of_an_autoregressive_process(rho: float) -> None:
    """Its integrated autocorrelation time is (1 + rho) / (1 - rho)."""
    residuals = [0.3 * autoregressive(rho, 20_000, seed)[:, None] for seed in range(2)]
    usable = [np.ones((20_000, 1), dtype=bool)] * 2
    noise = noise_from_residuals(residuals, usable, np.ones(1))
    assert noise.std[0] == pytest.approx(0.3, rel=0.05)
    assert noise.correlation[0] == pytest.approx((1 + rho) / (1 - rho), rel=0.25)
    assert noise.information_weights[0] == pytest.approx(
        1.0 / (noise.std[0] * np.sqrt(noise.correlation[0]))
    )


def base_of(robot: Robot, moving: list[int]) -> BaseParameters:
    """Base parameters of a motion in which only some joints move."""
    states = np.zeros((3, 200, robot.n))
    states[:, :, moving] = np.random.default_rng(0).uniform(-2, 2, (3, 200, len(moving)))
    regressor = Regressor(robot)
    return find_base_parameters(np.linalg.qr(regressor.stack(*states))[1], regressor.columns)


def test_the_excitation_is_judged_by_rank_and_condition(robot: Robot) -> None:
    base, regressor = base_of(robot, [0, 1, 2, 3]), Regressor(robot)
    assert excitation_warnings(base, regressor) == []
    for poor, words in (
        (base_of(robot, [0, 1, 3]), 'of 30 parameter combinations'),
        (replace(base, condition_number=500.0), 'excites the parameters poorly'),
    ):
        (text,) = excitation_warnings(poor, regressor)
        assert words in text
    for useless, words in (
        (replace(base, condition_number=5000.0), 'too short or too small to excite'),
        (find_base_parameters(np.zeros((48, 48)), base.columns), 'excites no parameter'),
    ):
        with pytest.raises(IdentificationError, match=words):
            excitation_warnings(useless, regressor)
