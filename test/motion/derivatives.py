"""Check that the derivatives of a motion agree."""

import numpy as np

from aerarm_ros.motion.signals import JointReference


def assert_derivatives_agree(
    time: np.ndarray, reference: JointReference, of_position: float, of_velocity: float
) -> None:
    """Compare dq and ddq (M, n) with differences of q and dq at evenly spaced times (M,).

    A jump of velocity or acceleration shows as a gap of its own size for any step. So a motion
    that passes is continuous up to the acceleration.
    """
    numeric = np.gradient(reference.q, time, axis=0)
    np.testing.assert_allclose(numeric[1:-1], reference.dq[1:-1], atol=of_position)
    numeric = np.gradient(reference.dq, time, axis=0)
    np.testing.assert_allclose(numeric[1:-1], reference.ddq[1:-1], atol=of_velocity)
