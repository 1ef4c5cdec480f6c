"""References along a path with its own time, and limited vectors."""

import numpy as np
from derivatives import assert_derivatives_agree

from aerarm_ros.motion.signals import JointReference, limited


def test_a_paced_path_has_the_derivatives_of_its_new_time() -> None:
    time = np.linspace(0.0, 1.0, 2001)
    # Along q(s) = (sin 2 s, s^3) with s(t) = t^2.
    s, rate, rate_change = time**2, 2.0 * time, np.full_like(time, 2.0)
    along = JointReference(
        np.column_stack([np.sin(2.0 * s), s**3]),
        np.column_stack([2.0 * np.cos(2.0 * s), 3.0 * s**2]),
        np.column_stack([-4.0 * np.sin(2.0 * s), 6.0 * s]),
    )
    paced = along.paced(rate[:, np.newaxis], rate_change[:, np.newaxis])
    np.testing.assert_array_equal(paced.q, along.q)
    assert_derivatives_agree(time, paced, of_position=1e-5, of_velocity=1e-4)


def test_long_vectors_are_shortened_in_their_direction() -> None:
    vector = np.array([3.0, 0.0, -4.0])
    np.testing.assert_allclose(limited(vector, 2.5), 0.5 * vector, rtol=1e-15)
    np.testing.assert_array_equal(limited(vector, 5.0), vector)
    np.testing.assert_array_equal(limited(np.zeros(3), 0.0), 0.0)
