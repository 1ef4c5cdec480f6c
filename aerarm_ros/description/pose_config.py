"""Where a part sits on the body that carries it."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_error import ConfigError, check_range

Array = npt.NDArray[np.float64]

_LENGTH_BOUND = 5.0  # [m] beyond, a position is more likely in millimetres
_ANGLE_BOUND = 6.3  # [rad] beyond, an angle is more likely in degrees


def check_vector(owner: str, key: str, values: tuple[float, ...], bound: float, unit: str) -> None:
    """Require three finite numbers within +- `bound`.

    Raises
    ------
    ConfigError
        If they aren't.
    """
    if len(values) != 3:
        raise ConfigError(f'{owner}: {key} = {list(values)} needs x, y and z')
    for value in values:
        check_range(owner, key, value, -bound, bound, unit)


def check_position(owner: str, key: str, values: tuple[float, ...]) -> None:
    """Require a position on a drone, three numbers [m]; raises ConfigError."""
    check_vector(owner, key, values, _LENGTH_BOUND, 'm')


@dataclass(frozen=True, slots=True)
class PoseConfig:
    """Pose of a part's frame in the frame of its body.

    Attributes
    ----------
    position : tuple of 3 floats
        Of the part's origin [m].
    rpy : tuple of 3 floats
        Roll, pitch and yaw [rad] about the body's axes in this order, as in a URDF's `<origin>`.

    Raises
    ------
    ConfigError
        If a number is missing or lies outside any plausible range.
    """

    position: tuple[float, ...]
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check every value."""
        check_position('pose', 'position', self.position)
        check_vector('pose', 'rpy', self.rpy, _ANGLE_BOUND, 'rad')

    @property
    def rotation(self) -> Array:
        """(3, 3) matrix from the part's axes to the body's."""
        (cr, cp, cy), (sr, sp, sy) = (
            [function(angle) for angle in self.rpy] for function in (math.cos, math.sin)
        )
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
