import numpy as np

from aerarm_ros.online.payload_estimator import FROZEN_EFFORT, FrozenSignal

NAMES = ('shoulder', 'elbow')


def feed(watch: FrozenSignal, dq: list[float], efforts: list[list[float]]) -> None:
    for tau in efforts:
        watch.update(np.array(tau), np.array(dq), 1e-3)


def test_a_torque_that_stays_in_motion_is_named() -> None:
    watch = FrozenSignal(NAMES, FROZEN_EFFORT)
    feed(watch, [1.0, 1.0], [[0.1 * k, 0.5] for k in range(300)])
    assert watch.problem == (
        'effort of elbow stays at 0.5 Nm while the joint moves: check that joint_states '
        'has measured torques'
    )
    feed(watch, [1.0, 1.0], [[0.1, 0.6]])
    assert not watch.problem


def test_an_arm_at_rest_may_be_silent() -> None:
    watch = FrozenSignal(NAMES, FROZEN_EFFORT)
    feed(watch, [0.0, 0.01], [[0.0, 0.0]] * 1000)
    assert not watch.problem
