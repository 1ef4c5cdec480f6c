"""The regressor reproduces the dynamics, and has the ranks mechanics says."""

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.regressor import Regressor, viscous_coulomb


def motion(robot: Robot, rng: np.random.Generator, samples: int = 60) -> np.ndarray:
    """Positions, velocities and accelerations of `samples` instants."""
    return rng.uniform(-2.0, 2.0, (3, samples, robot.n))


def numerical_rank(matrix: np.ndarray) -> int:
    singular = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(singular > 1e-9 * singular[0]))


@pytest.mark.parametrize('rotor_inertia', [False, True])
def test_regressor_times_parameters_is_the_torque(
    robot: Robot, rng: np.random.Generator, rotor_inertia: bool
) -> None:
    """Thesis (2.7), (3.1): links, friction and rotors."""
    q, dq, ddq = motion(robot, rng)
    fv, fs, rotor = rng.uniform(0.01, 1.0, (3, robot.n))
    regressor = Regressor(robot, rotor_inertia)
    theta = regressor.parameters(
        robot.inertial_parameters, fv, fs, rotor if rotor_inertia else None
    )
    dynamics = Dynamics(robot, rotor if rotor_inertia else 0.0)
    rigid = [dynamics.inverse(*sample) for sample in zip(q, dq, ddq, strict=True)]
    tau = np.array(rigid) + viscous_coulomb(dq, fv, fs)
    assert np.allclose(regressor.stack(q, dq, ddq) @ theta, tau.reshape(-1), atol=1e-9)


def test_one_sample_is_a_row_of_the_stack(robot: Robot, rng: np.random.Generator) -> None:
    q, dq, ddq = motion(robot, rng, 3)
    regressor = Regressor(robot)
    stacked = regressor.stack_rigid(q, dq, ddq)
    assert stacked.shape == (3, robot.n, 10 * robot.n)
    single = regressor.rigid(q[0], dq[0], ddq[0])
    regressor.rigid(q[1], dq[1], ddq[1])
    assert np.array_equal(single, stacked[0])
    whole = regressor.stack(q, dq, ddq).reshape(3, robot.n, -1)
    assert np.array_equal(whole[:, :, : 10 * robot.n], stacked)


def test_columns_are_named_after_links_and_joints(arm: Robot) -> None:
    columns = Regressor(arm, rotor_inertia=True).columns
    assert len(columns) == 52 == len(set(columns))
    assert columns[:3] == ('m_link1', 'mcx_link1', 'mcy_link1')
    assert columns[39:41] == ('Izz_link4', 'fv_joint1')
    assert columns[44] == 'fs_joint1'
    assert columns[48:] == ('Ja_joint1', 'Ja_joint2', 'Ja_joint3', 'Ja_joint4')
    assert Regressor(arm).columns == columns[:48]


def test_each_named_joint_column_acts_on_its_joint_alone(
    arm: Robot, rng: np.random.Generator
) -> None:
    q, dq, ddq = motion(arm, rng, 5)
    regressor = Regressor(arm, rotor_inertia=True)
    stacked = regressor.stack(q, dq, ddq).reshape(5, 4, -1)
    for kind, values in (('fv', dq), ('fs', np.sign(dq)), ('Ja', ddq)):
        for i, joint in enumerate(arm.joint_names):
            column = stacked[:, :, regressor.columns.index(f'{kind}_{joint}')]
            assert np.array_equal(column, values * (np.arange(4) == i))


@pytest.mark.parametrize(
    ('gravity', 'rotor_inertia', 'rank'),
    [
        ((0.0, 0.0, -9.81), False, 30),  # the thesis's 48 columns, section 5.3
        ((0.0, 0.0, -9.81), True, 32),  # the rotors of joints 3 and 4 stand out from the links
        ((2.0, 1.0, -9.5), False, 32),  # tilted gravity reveals link 1's first moments
        ((2.0, 1.0, -9.5), True, 34),
    ],
)
def test_rank_on_this_arm(
    arm: Robot,
    rng: np.random.Generator,
    gravity: tuple[float, float, float],
    rotor_inertia: bool,
    rank: int,
) -> None:
    regressor = Regressor(arm.with_gravity(gravity), rotor_inertia)
    assert numerical_rank(regressor.stack(*motion(arm, rng, 200))) == rank


def test_a_parameter_without_effect_is_a_zero_column(arm: Robot, rng: np.random.Generator) -> None:
    """Only link 1's inertia about the vertical can be felt, and only through Izz."""
    regressor = Regressor(arm)
    stacked = regressor.stack(*motion(arm, rng))
    silent = np.all(np.abs(stacked) < 1e-12, axis=0)
    link1 = {name for name in regressor.columns if name.endswith('link1')}
    felt = {name for name, zero in zip(regressor.columns, silent, strict=True) if not zero}
    assert link1 & felt == {'Izz_link1'}


def test_wrong_shapes_are_refused(arm: Robot) -> None:
    regressor = Regressor(arm)
    with pytest.raises(ValueError, match=r'\(samples, 4\)'):
        regressor.stack(np.zeros((5, 3)), np.zeros((5, 3)), np.zeros((5, 3)))
    with pytest.raises(ValueError, match=r'shapes'):
        regressor.stack_rigid(np.zeros((5, 4)), np.zeros((5, 4)), np.zeros((6, 4)))
    with pytest.raises(ValueError, match='has no columns for rotor inertia'):
        regressor.parameters(arm.inertial_parameters, arm.viscous, arm.coulomb, np.zeros(4))
    with pytest.raises(ValueError, match='4 joints'):
        regressor.parameters(np.zeros((3, 10)), arm.viscous, arm.coulomb)
