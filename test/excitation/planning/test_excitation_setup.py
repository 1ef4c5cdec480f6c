"""One arm's checks, in this and in another process."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings import ExcitationConfig, ExcitationError, InfeasibleError
from aerarm_ros.excitation.trajectory import FourierTrajectory


def test_a_sent_setup_judges_alike(setup: ExcitationSetup, trajectory: FourierTrajectory) -> None:
    sent = pickle.loads(pickle.dumps(setup))
    here, there = (
        s.checker.check_trajectory(trajectory, s.config.ramp_time) for s in (setup, sent)
    )
    assert [str(margin) for margin in here.margins] == [str(margin) for margin in there.margins]


def test_an_arm_known_by_its_urdf_alone_has_no_current_limit(robot) -> None:
    setup = ExcitationSetup.of_robot(robot, ExcitationConfig())
    assert np.isinf(setup.limits.current).all()
    assert (setup.effort_model.current(np.ones(4)) == 0.0).all()
    assert (setup.rotor_inertia == 0.0).all()


def test_limits_a_urdf_does_not_know_can_be_given(robot) -> None:
    config = ExcitationConfig()
    setup = ExcitationSetup.of_robot(
        robot, config, (), [1.0, 2.0, 3.0, 4.0], current_limit=5.0, torque_per_ampere=0.5
    )
    np.testing.assert_array_equal(setup.limits.acceleration, [1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(setup.limits.current, 5.0)
    np.testing.assert_array_equal(setup.effort_model.current(np.ones(4)), 2.0)
    for wrong, message in (
        ({'acceleration_limit': [1.0, 2.0]}, 'acceleration limit must have 1 value or 4'),
        ({'acceleration_limit': -1.0}, 'acceleration of joint1 must be positive'),
        ({'current_limit': 5.0}, 'needs the torque per ampere'),
        ({'torque_per_ampere': 0.0}, 'torque per ampere must be positive'),
    ):
        with pytest.raises(ExcitationError, match=message):
            ExcitationSetup.of_robot(robot, config, **wrong)


@pytest.mark.parametrize(
    ('bias', 'message'),
    [((0.0, 1.5, 0.0, 3.0), 'position of joint4'), ((0.0, -0.4, 0.0, 0.0), 'ground clearance of')],
)
def test_a_centre_where_the_arm_may_not_rest_is_refused(
    setup: ExcitationSetup, bias: tuple[float, ...], message: str
) -> None:
    elsewhere = replace(setup, config=replace(setup.config, bias=bias))
    with pytest.raises(InfeasibleError, match=message):
        elsewhere.require_bias()


def test_random_trajectories_are_about_the_configured_bias(setup: ExcitationSetup) -> None:
    drawn = setup.random_trajectory(0.3, 0.2, 4)
    assert (drawn.fundamental, drawn.harmonics) == (0.2, 4)
    np.testing.assert_allclose(drawn.bias, setup.config.bias)
