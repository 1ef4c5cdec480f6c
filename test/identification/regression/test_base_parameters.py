"""Identifiable combinations: ranks of this arm, and torque that stays the same."""

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.regression.base_parameters import find_base_parameters
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


def test_condition_number_is_5_2(robot: Robot) -> None:
    factor, columns = factor_of(robot, False)
    eigenvalues = np.sort(np.linalg.eigvalsh(factor.T @ factor))[::-1]
    expected = np.sqrt(eigenvalues[0] / eigenvalues[29])
    assert find_base_parameters(factor, columns).condition_number == pytest.approx(expected)


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


def test_a_column_without_effect_is_dependent() -> None:
    factor = np.diag([1.0, 0.0, 3.0])
    base = find_base_parameters(factor, ('a', 'b', 'c'))
    assert base.expressions() == ['a', 'c']
    assert base.dependent.tolist() == [1]
    nothing = find_base_parameters(np.zeros((2, 2)), ('a', 'b'))
    assert nothing.rank == 0
    assert nothing.condition_number == float('inf')


@pytest.mark.parametrize('angle', [np.pi, 3.1416])
def test_rounded_angles_add_no_base_parameters(robot: Robot, angle: float) -> None:
    """A base that is upside down by 3.1416 rad leaves gravity 7e-6 about the first axis."""
    gravity = 9.81 * np.array([0.0, np.sin(angle), -np.cos(angle)])
    base = find_base_parameters(*factor_of(robot.with_gravity(gravity), False))
    assert base.rank == 30
    assert base.condition_number < 100.0
