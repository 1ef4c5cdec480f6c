"""A quaternion a little further on."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def turned(quaternion: Array, angle: Array) -> Array:
    """Return a unit quaternion (x, y, z, w) after a small turn (3,) [rad] in body axes."""
    x, y, z, w = quaternion.tolist()
    a, b, c = (0.5 * angle).tolist()
    result: Array = np.array(
        [
            x + w * a + y * c - z * b,
            y + w * b + z * a - x * c,
            z + w * c + x * b - y * a,
            w - x * a - y * b - z * c,
        ]
    )
    result /= np.linalg.norm(result)
    return result
