import numpy as np

from aerarm_ros.motion.signals import limited


def test_long_vectors_are_shortened_in_their_direction() -> None:
    vector = np.array([3.0, 0.0, -4.0])
    np.testing.assert_allclose(limited(vector, 2.5), 0.5 * vector, rtol=1e-15)
    np.testing.assert_array_equal(limited(vector, 5.0), vector)
    np.testing.assert_array_equal(limited(np.zeros(3), 0.0), 0.0)
