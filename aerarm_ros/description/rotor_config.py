"""One rotor of a drone."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.config_error import ConfigError, check_name, check_range
from aerarm_ros.description.pose_config import check_position, check_vector

_UNIT_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class RotorConfig:
    """A propeller with its motor, whose thrust is commanded.

    Attributes
    ----------
    name : str
        As in the topic rotor_command.
    position : tuple of 3 floats
        Of its hub in the body frame [m].
    axis : tuple of 3 floats
        Direction of the thrust on the body, a unit vector in body axes.
    moment_per_thrust : float
        Drag moment on the body about `axis` per thrust [Nm/N]: positive for a propeller that
        turns clockwise as seen from where its axis points to, about 0.01 to 0.02 in size.
    thrust_max : float
        [N]
    time_constant : float
        First-order lag from commanded to true thrust [s].
    thrust_min : float
        [N]; zero for a propeller that may stand, negative for one that reverses.

    Raises
    ------
    ConfigError
        If a value lies outside its range or contradicts another.
    """

    name: str
    position: tuple[float, ...]
    axis: tuple[float, ...]
    moment_per_thrust: float
    thrust_max: float
    time_constant: float
    thrust_min: float = 0.0

    def __post_init__(self) -> None:
        """Check every value."""
        check_name('rotor', 'name', self.name)
        owner = f'rotor {self.name}'
        check_position(owner, 'position', self.position)
        check_vector(owner, 'axis', self.axis, 10.0, '')
        length = math.hypot(*self.axis)
        if abs(length - 1.0) > _UNIT_TOLERANCE:
            raise ConfigError(
                f'{owner}: axis has length {length:.4g}, not 1: give a unit vector, [0, 0, 1] for '
                'thrust upwards'
            )
        check_range(owner, 'moment_per_thrust', self.moment_per_thrust, -1.0, 1.0, 'Nm/N')
        check_range(owner, 'thrust_max', self.thrust_max, 1e-3, 1e4, 'N')
        check_range(owner, 'thrust_min', self.thrust_min, -1e4, 1e4, 'N')
        check_range(owner, 'time_constant', self.time_constant, 1e-4, 1.0, 's')
        if self.thrust_min >= self.thrust_max:
            raise ConfigError(
                f'{owner}: thrust_min = {self.thrust_min} must be below '
                f'thrust_max = {self.thrust_max}'
            )

    @property
    def wrench_per_thrust(self) -> npt.NDArray[np.float64]:
        """(6,) force [-] and moment [m] on the body at its frame's origin, per N of thrust."""
        axis = np.array(self.axis) / math.hypot(*self.axis)
        moment = np.cross(self.position, axis) + self.moment_per_thrust * axis
        return np.concatenate([axis, moment])
