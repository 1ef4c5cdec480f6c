"""Checks of what a law is given when it is made."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def non_negative(name: str, values: npt.ArrayLike, n: int) -> Array:
    """Return `values` as a private (n,) array, a scalar being repeated.

    Raises
    ------
    ValueError
        If their number isn't n, or one is negative or not finite.
    """
    array = finite(name, values, n)
    if np.any(array < 0.0):
        raise ValueError(f'{name} = {array} must not be negative')
    return array


def finite(name: str, values: npt.ArrayLike, n: int) -> Array:
    """Return `values` as a private (n,) array, a scalar being repeated.

    Raises
    ------
    ValueError
        If their number isn't n, or one is not finite.
    """
    array = np.asarray(values, dtype=float)
    if array.shape not in ((), (n,)):
        raise ValueError(f'{name} has {array.size} values, {n} are needed (or one for all)')
    if not np.all(np.isfinite(array)):
        raise ValueError(f'{name} = {array} must be finite')
    return np.broadcast_to(array, (n,)).copy()


def positive(name: str, value: float) -> float:
    """Return `value`.

    Raises
    ------
    ValueError
        If it isn't positive and finite.
    """
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f'{name} = {value} must be positive and finite')
    return float(value)


def non_negative_number(name: str, value: float) -> float:
    """Return `value`.

    Raises
    ------
    ValueError
        If it is negative or not finite.
    """
    return float(non_negative(name, value, 1)[0])
