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


@pytest.mark.parametrize(('rotor_inertia', 'columns', 'rank'), [(False, 48, 30), (True, 52, 32)])
def test_ranks_of_this_arm(robot: Robot, rotor_inertia: bool, columns: int, rank: int) -> None:
    """Thesis 5.3: 30 of 48; the rotors of joints 3 and 4 add two of four."""
    base = find_base_parameters(*factor_of(robot, rotor_inertia))
    assert len(base.columns) == columns
    assert base.rank == rank


def test_tilted_gravity_identifies_two_more(robot: Robot) -> None:
    tilted = robot.with_gravity([3.0, 0.0, -9.0])
    assert find_base_parameters(*factor_of(tilted, False)).rank == 32


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


@pytest.mark.parametrize('angle', [np.pi, 3.1416])
def test_rounded_angles_add_no_base_parameters(robot: Robot, angle: float) -> None:
    """A base that is upside down by 3.1416 rad leaves gravity 7e-6 about the first axis."""
    gravity = 9.81 * np.array([0.0, np.sin(angle), -np.cos(angle)])
    base = find_base_parameters(*factor_of(robot.with_gravity(gravity), False))
    assert base.rank == 30
    assert base.condition_number < 100.0


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


def test_a_rich_motion_needs_no_comment(robot: Robot) -> None:
    assert excitation_warnings(base_of(robot, [0, 1, 2, 3]), Regressor(robot)) == []


def test_joints_at_rest_cost_parameters(robot: Robot) -> None:
    (text,) = excitation_warnings(base_of(robot, [0, 1, 3]), Regressor(robot))
    assert 'of 30 parameter combinations' in text


def test_condition_decides(robot: Robot) -> None:
    base = base_of(robot, [0, 1, 2, 3])
    (text,) = excitation_warnings(replace(base, condition_number=500.0), Regressor(robot))
    assert 'excites the parameters poorly' in text
    with pytest.raises(IdentificationError, match='too short or too small to excite'):
        excitation_warnings(replace(base, condition_number=5000.0), Regressor(robot))
    nothing = find_base_parameters(np.zeros((48, 48)), base.columns)
    with pytest.raises(IdentificationError, match='excites no parameter'):
        excitation_warnings(nothing, Regressor(robot))
