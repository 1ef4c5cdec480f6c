"""Damped least squares: exact away from singularities, bounded at them."""

import numpy as np
import pytest

from aerarm_ros.control.laws.kinematic_control import DampedInverse
from aerarm_ros.model.kinematics import Kinematics


def test_equals_the_pseudo_inverse_away_from_singularities(robot, postures) -> None:
    kinematics = Kinematics(robot, 'tool0')
    inverse = DampedInverse(threshold=0.01, damping=0.01)
    tried = 0
    for q in postures:
        jacobian = kinematics.position_jacobian(q)
        result = inverse.of(jacobian)
        if result.least > 0.01:
            tried += 1
            np.testing.assert_allclose(result.inverse, np.linalg.pinv(jacobian), atol=1e-9)
            np.testing.assert_allclose(jacobian @ result.null_space, 0.0, atol=1e-9)
    assert tried >= 5


def test_is_bounded_at_the_wrist_which_is_singular_everywhere(robot, postures) -> None:
    kinematics = Kinematics(robot, 'wrist')
    inverse = DampedInverse(threshold=0.08, damping=0.04)
    for q in postures:
        jacobian = kinematics.position_jacobian(q)
        result = inverse.of(jacobian)
        assert result.least < 1e-9
        assert np.linalg.norm(result.inverse, 2) < 1.0 / (2.0 * 0.04) + 1.0 / 0.08
        # What the wrist can do it still does exactly.
        reachable = jacobian @ np.array([0.3, -0.2, 0.0, 0.0])
        if np.linalg.svd(jacobian)[1][1] > 0.08:
            np.testing.assert_allclose(jacobian @ result.inverse @ reachable, reachable, atol=1e-9)


def test_damping_grows_toward_the_singularity(robot) -> None:
    inverse = DampedInverse(threshold=0.1, damping=0.05)
    losses = []
    for value in (0.2, 0.1, 0.08, 0.05, 0.02, 0.0):
        result = inverse.of(np.diag([1.0, 0.7, value]))
        losses.append(1.0 - value * result.inverse[2, 2])
        assert result.inverse[0, 0] == pytest.approx(1.0)
    assert losses[:2] == pytest.approx([0.0, 0.0])
    assert np.all(np.diff(losses) >= 0.0)
    assert losses[-1] == 1.0


@pytest.mark.parametrize('arguments', [(0.0, 0.1), (0.1, -1.0), (np.nan, 0.1)])
def test_wrong_numbers_are_refused(arguments) -> None:
    with pytest.raises(ValueError, match='positive'):
        DampedInverse(*arguments)
