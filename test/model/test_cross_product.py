import numpy as np

from aerarm_ros.model.inertia import cross


def test_the_cross_product_is_numpys_to_the_bit() -> None:
    random = np.random.default_rng(0)
    for a, b in random.normal(size=(20, 2, 3)):
        np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
