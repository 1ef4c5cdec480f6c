"""A vector that is no longer than allowed."""

from math import sqrt

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def limited(vector: Array, length: float) -> Array:
    """Return a vector (k,), shortened to `length` if it is longer, its direction as it was."""
    norm = sqrt(vector @ vector)
    return vector if norm <= length else (length / norm) * vector
