"""One arm's checks, here and in another process."""

import pickle

import numpy as np

from aerarm_ros.excitation.excitation_config import ExcitationConfig
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.fourier_trajectory import FourierTrajectory


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


def test_random_trajectories_are_about_the_configured_bias(setup: ExcitationSetup) -> None:
    drawn = setup.random_trajectory(0.3, 0.2, 4)
    assert (drawn.fundamental, drawn.harmonics) == (0.2, 4)
    np.testing.assert_allclose(drawn.bias, setup.config.bias)
