"""A constant bias without contact is subtracted, for any later rotation of the drone."""

import numpy as np
import pinocchio as pin

from aerarm_ros.flight.contact_estimator import DURATION, ContactZero

STEP = 0.004
PLACE = np.array([0.02, -0.01, -0.06])  # of 0.3 kg that nobody knows of, in base axes
HANGING = pin.rpy.rpyToMatrix(np.pi, 0.0, 0.0)


def felt(force: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    in_base = force @ rotation
    return np.concatenate([in_base, np.cross(PLACE, in_base)])


def test_an_unknown_weight_is_subtracted_once_it_is_averaged() -> None:
    zero, weight = ContactZero(), np.array([0.0, 0.0, -2.9])
    wrench = felt(weight, HANGING)
    np.testing.assert_allclose(zero.apply(wrench, HANGING, STEP), wrench)
    zero.begin()
    random = np.random.default_rng(1)
    for _ in range(int(DURATION / STEP) - 1):
        noisy = wrench + random.normal(scale=0.05, size=6)
        np.testing.assert_allclose(zero.apply(noisy, HANGING, STEP), noisy)
    for _ in range(3):
        left = zero.apply(wrench, HANGING, STEP)
    np.testing.assert_allclose(left, 0.0, atol=0.01)
    # It turns and leans, and is pushed.
    turned = pin.rpy.rpyToMatrix(0.1, -0.1, 1.0) @ HANGING
    push = np.array([1.0, 2.0, -0.5])
    left = zero.apply(felt(weight + push, turned), turned, STEP)
    np.testing.assert_allclose(turned @ left[:3], push, atol=0.01)
    # Begun anew, it forgets what it was.
    zero.begin()
    for _ in range(int(DURATION / STEP) + 2):
        left = zero.apply(np.zeros(6), HANGING, STEP)
    np.testing.assert_allclose(left, 0.0, atol=1e-9)
