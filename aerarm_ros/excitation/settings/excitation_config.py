"""Where and how far an excitation may move one arm, read from YAML."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.description.config_error import ConfigError, check_range
from aerarm_ros.description.config_reader import build, load
from aerarm_ros.description.robot import Robot
from aerarm_ros.motion.float_array import FloatArray


@dataclass(frozen=True, slots=True)
class ExcitationConfig:
    """Surroundings and usable shares of an arm's limits.

    Parameters
    ----------
    position_share : usable share of each joint's range, about its middle.
    velocity_share : usable share of velocity and acceleration limits.
    effort_share : usable share of torque and motor current limits.
    transfer_share : share of the usable velocity and acceleration on the way to the trajectory
        and back.
    self_clearance : distance kept between links that are not neighbours and to what is fixed to
        the base [m].
    ground_clearance : distance kept to the ground [m].
    ground_height : height of the ground above the base frame's origin, against gravity [m]; None
        if there is no ground in reach.
    bias : centre of the motion [rad], a joint each; None for the middle of each joint's range.
    bias_spread : largest random term added to a bias that is given [rad].
    highest_frequency : highest harmonic N f0 allowed [Hz], so that elastic parts are not excited.
    ramp_time : run-in and run-out along the trajectory [s].
    unchecked_pairs : pairs of links whose distance is not checked, each as 'one to other': they
        touch by construction.

    Raises
    ------
    ConfigError
        If a value is out of range.
    """

    position_share: float = 0.95
    velocity_share: float = 0.9
    effort_share: float = 0.8
    transfer_share: float = 0.3
    self_clearance: float = 0.02
    ground_clearance: float = 0.03
    ground_height: float | None = 0.0
    bias: tuple[float, ...] | None = None
    bias_spread: float = 0.1
    highest_frequency: float = 2.0
    ramp_time: float = 2.0
    unchecked_pairs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for key in ('position_share', 'velocity_share', 'effort_share', 'transfer_share'):
            check_range('excitation', key, getattr(self, key), 0.01, 1.0, '')
        for key in ('self_clearance', 'ground_clearance'):
            check_range('excitation', key, getattr(self, key), 0.0, 1.0, 'm')
        check_range('excitation', 'bias_spread', self.bias_spread, 0.0, np.pi, 'rad')
        check_range('excitation', 'highest_frequency', self.highest_frequency, 1e-3, 499.0, 'Hz')
        check_range('excitation', 'ramp_time', self.ramp_time, 0.1, 60.0, 's')
        if self.ground_height is not None:
            check_range('excitation', 'ground_height', self.ground_height, -100.0, 100.0, 'm')
        pairs = self.unchecked_pairs
        if not isinstance(pairs, list | tuple) or not all(isinstance(pair, str) for pair in pairs):
            raise ConfigError("excitation: unchecked_pairs must be a list of 'one to other'")
        object.__setattr__(self, 'unchecked_pairs', tuple(pairs))

    def bias_spread_of(self, robot: Robot) -> FloatArray:
        """Return the largest random term of each joint's bias [rad], (n,).

        Without a bias given, the middle of a joint's range is a guess (and may be a posture in
        collision), so a third of the range around it is drawn from.
        """
        if self.bias is not None:
            return np.full(robot.n, self.bias_spread)
        span = np.minimum(robot.position_max - robot.position_min, 2.0 * np.pi)
        return np.maximum(span / 6.0, self.bias_spread)

    def bias_of(self, robot: Robot) -> FloatArray:
        """Return the centre of the motion [rad], (n,).

        Raises
        ------
        ConfigError
            If `bias` does not have one value a joint.
        """
        if self.bias is None:
            middle = 0.5 * (robot.position_min + robot.position_max)
            return np.where(np.isfinite(middle), middle, 0.0)
        if len(self.bias) != robot.n:
            raise ConfigError(
                f'excitation: bias has {len(self.bias)} values, the robot has {robot.n} joints'
            )
        for name, value in zip(robot.joint_names, self.bias, strict=True):
            if not np.isfinite(value):
                raise ConfigError(
                    f'excitation: bias of {name} must be a finite number, not {value}'
                )
        return np.array(self.bias)


def load_excitation_config(path: Path | str | None = None) -> ExcitationConfig:
    """Read an excitation configuration; None reads the packaged config/excitation.yaml.

    Raises
    ------
    ConfigError
        If the file cannot be read or says something wrong.
    """
    return load(path, 'excitation.yaml', _build)


def _build(document: dict[str, Any]) -> ExcitationConfig:
    if 'stop_time' in document:
        raise ConfigError(
            'stop_time is no longer used, motions stop as fast as the limits of the arm allow: '
            'delete the line'
        )
    return build(ExcitationConfig, 'top level', document)
