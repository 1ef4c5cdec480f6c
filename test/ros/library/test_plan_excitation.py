"""A motion worth recording, in three calls."""

from pathlib import Path

import numpy as np
import pytest

import aerarm_ros
from aerarm_ros.excitation.design_file import TrajectoryFile
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.ros.library.excitation import PlannedExcitation


@pytest.fixture(scope='module')
def plan() -> PlannedExcitation:
    return aerarm_ros.plan_excitation(seconds=0.0, periods=1)


def test_the_motion_is_from_rest_to_rest_within_the_limits(plan: PlannedExcitation) -> None:
    time, motion = plan.sample(200.0)
    assert time[-1] == pytest.approx(plan.duration, abs=0.005)
    assert plan.duration == pytest.approx(10.0 + 2 * 2.0)
    robot = aerarm_ros.load_robot()
    assert (motion.q > robot.position_min).all()
    assert (motion.q < robot.position_max).all()
    assert (np.abs(motion.dq) < robot.velocity_max).all()
    assert np.abs(motion.dq[[0, -1]]).max() < 1e-9
    assert np.gradient(motion.q[:, 1], time)[5:-5] == pytest.approx(motion.dq[5:-5, 1], abs=1e-3)


def test_the_plan_is_saved_and_displayed(plan: PlannedExcitation, tmp_path: Path) -> None:
    file = TrajectoryFile.load(plan.save(tmp_path / 'motion.yaml'))
    assert file.periods == 1
    assert file.joint_names == plan.joint_names == aerarm_ros.load_robot().joint_names
    np.testing.assert_allclose(file.trajectory.alpha, plan.result.trajectory.alpha)
    figure = f'condition number {plan.condition_number:.1f}'
    for text in (plan.summary(), plan._repr_html_(), repr(plan)):
        assert figure in text
    assert 'ground clearance' in plan.summary()
    with pytest.raises(ExcitationError, match='rate = 0'):
        plan.sample(0.0)


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'seconds': -1.0}, 'seconds = -1'),
        ({'periods': 0}, 'periods = 0'),
        ({'harmonics': 500}, 'the highest harmonic'),
        ({'bias': [0.0]}, 'bias has 1 values'),
        ({'lock': 'joint1'}, 'lock = joint1 is possible only if urdf is a path'),
        (
            {'acceleration_limit': 5.0},
            'acceleration_limit cannot be combined with the configuration of the drives',
        ),
    ],
)
def test_impossible_arguments_raise_errors(given: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        aerarm_ros.plan_excitation(**{'seconds': 0.0, **given})
