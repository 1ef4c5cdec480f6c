"""The published torque is the mean of a cycle, not its last sample."""

import numpy as np
import pytest


@pytest.mark.parametrize('speed', [0.4, -0.4])
def test_measured_torque_is_the_mean_motor_torque(rig, speed: float) -> None:
    plant, given = rig.plant, []
    apply = plant.apply_effort
    plant.apply_effort = lambda effort: (given.append(np.array(effort)), apply(effort))
    moving = np.array([speed, 0.0, speed, speed])

    def source(now: float) -> tuple[None, np.ndarray, None]:
        return None, moving, None

    rig.run(0.5, source)
    given.clear()
    measured = []
    for _ in range(1000):
        rig.run(1e-3, source)
        measured.append(rig.bridge.tau.copy())
    assert rig.bridge.dq[[0, 2, 3]] == pytest.approx(moving[[0, 2, 3]], rel=0.2)
    difference = np.mean(measured, axis=0) - np.mean(given, axis=0)
    # What joint 3 was off without the correction: 0.017 Nm.
    assert np.all(np.abs(difference[[0, 2, 3]]) < 0.003), difference


def test_torque_of_an_accelerating_joint_is_the_commanded_one(rig) -> None:
    """Under torque control the boards have no gains, at any speed of the joint."""
    effort, measured = np.array([1.0, 0.0, 0.5, 0.0]), []
    rig.run(0.02, lambda now: (None, None, effort))
    for _ in range(40):
        rig.run(1e-3, lambda now: (None, None, effort))
        measured.append(rig.bridge.tau.copy())
    assert np.all(rig.bridge.dq[[0, 2]] > 0.3)
    np.testing.assert_allclose(np.mean(measured, axis=0)[[0, 2]], [1.0, 0.5], atol=0.01)
