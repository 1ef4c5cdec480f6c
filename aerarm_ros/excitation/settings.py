"""Settings, motion limits and error types of an excitation."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.config_reader import ConfigError, build, check_fields, load, ranged
from aerarm_ros.description.robot import Robot
from aerarm_ros.motion.signals import Array


class ExcitationError(ValueError):
    """Error for an unusable or impossible excitation; the message states what to check."""


class InfeasibleError(ExcitationError):
    """Error for a motion that violates a limit of the arm; the message names the limit."""


class NothingDrawnError(InfeasibleError):
    """Error for a search in which no random trajectory was feasible.

    Attributes
    ----------
    binding : description of the limit most often violated.
    """

    def __init__(self, message: str, binding: str) -> None:
        super().__init__(message)
        self.binding = binding

    def __reduce__(self) -> tuple[Any, ...]:
        # Workers send this exception to the waiting process.
        return type(self), (str(self), self.binding)


class DesignStoppedError(ExcitationError):
    """Error for a design that was stopped before a feasible trajectory was found."""


def one_per_joint(name: str, values: ArrayLike, n: int) -> Array:
    """Return an (n,) array; `value` contains one value for all joints, or one per joint.

    Raises
    ------
    ExcitationError
        If the number of values is neither 1 nor n.
    """
    array = np.atleast_1d(np.asarray(values, dtype=float))
    if array.shape not in ((1,), (n,)):
        raise ExcitationError(f'{name} must have 1 value or {n}, one per joint, not {array.size}')
    return np.broadcast_to(array, n).copy()


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Motion limits of all joints, as arrays (n,) in the order of the joints; inf means no limit.

    Parameters
    ----------
    joint_names : names of the n joints, for messages.
    position_min, position_max : position limits [rad].
    velocity : largest speed [rad/s].
    acceleration : largest acceleration [rad/s^2].
    effort : largest joint torque [Nm].
    current : largest motor current [A].

    Raises
    ------
    ExcitationError
        If shapes differ, a minimum is not below its maximum, or a limit is not positive.
    """

    joint_names: tuple[str, ...]
    position_min: Array
    position_max: Array
    velocity: Array
    acceleration: Array
    effort: Array
    current: Array

    def __post_init__(self) -> None:
        n = len(self.joint_names)
        for field in fields(self)[1:]:
            values = np.asarray(getattr(self, field.name), dtype=float)
            object.__setattr__(self, field.name, values)
            if values.shape != (n,):
                raise ExcitationError(f'limit {field.name} must have {n} values, one per joint')
            for name, value in zip(self.joint_names, values, strict=True):
                if np.isnan(value) or (not field.name.startswith('position') and value <= 0.0):
                    raise ExcitationError(f'limit {field.name} of {name} must be positive: {value}')
        for i, name in enumerate(self.joint_names):
            if not self.position_min[i] < self.position_max[i]:
                raise ExcitationError(
                    f'the position limits of {name} leave no range of motion: minimum '
                    f'{self.position_min[i]:.4g} rad, maximum {self.position_max[i]:.4g} rad'
                )

    @classmethod
    def of_arm(cls, config: ArmConfig) -> MotionLimits:
        """Return the motion limits in the configuration file of an arm."""
        return cls(
            tuple(config.joint_names),
            config.column('position_min'),
            config.column('position_max'),
            config.column('velocity_max'),
            config.column('acceleration_max'),
            config.column('effort_max'),
            np.array([joint.motor.current_max for joint in config.joints]),
        )

    @classmethod
    def of_robot(cls, robot: Robot, acceleration_limit: ArrayLike = np.inf) -> MotionLimits:
        """Return the motion limits of a URDF, with the given acceleration limit.

        Parameters
        ----------
        robot : robot model with the URDF's limits.
        acceleration_limit : largest acceleration [rad/s^2], one for all joints or (n,).

        Raises
        ------
        ExcitationError
            If the number of values is neither 1 nor n, or a value is not positive.
        """
        unlimited = np.full(robot.n, np.inf)
        return cls(
            tuple(robot.joint_names),
            robot.position_min,
            robot.position_max,
            robot.velocity_max,
            one_per_joint('acceleration limit', acceleration_limit, robot.n),
            # A URDF contains 0 for an unknown effort limit.
            np.where(robot.effort_max > 0.0, robot.effort_max, unlimited),
            unlimited,
        )

    def scaled(self, position: float, velocity: float, effort: float) -> MotionLimits:
        """Return the part of the limits that an excitation may use: factors in (0, 1].

        Parameters
        ----------
        position : fraction of each joint's range, about its middle.
        velocity : fraction of velocity and acceleration.
        effort : fraction of torque and current.
        """
        slack = (1.0 - position) * 0.5 * (self.position_max - self.position_min)
        slack = np.where(np.isfinite(slack), slack, 0.0)
        return MotionLimits(
            self.joint_names,
            self.position_min + slack,
            self.position_max - slack,
            velocity * self.velocity,
            velocity * self.acceleration,
            effort * self.effort,
            effort * self.current,
        )


@dataclass(frozen=True, slots=True)
class ExcitationConfig:
    """Excitation settings: usable fractions of the arm's limits, and surroundings of the arm.

    Parameters
    ----------
    position_share : usable fraction of each joint's range, about its middle.
    velocity_share : usable fraction of velocity and acceleration limits.
    effort_share : usable fraction of torque and motor current limits.
    transfer_share : fraction of the usable velocity and acceleration limits that approach and
        return may use.
    self_clearance : distance between non-adjacent links and to obstacles fixed to the base [m].
    ground_clearance : distance to the ground [m].
    ground_height : height of the ground above the base frame's origin, against gravity [m]; None
        without reachable ground.
    bias : centre of the motion [rad], one value per joint; None for the middle of each range.
    bias_spread : largest random offset of a given bias [rad].
    highest_frequency : largest allowed frequency N f0 [Hz], to avoid exciting elastic parts.
    ramp_time : duration of run-in and run-out along the trajectory [s].
    unchecked_pairs : pairs of links that touch by design and are not checked, each as 'one to
        other'.
    check_clearance : whether to check distances; False for an arm without collision shapes, which
        then moves without collision checks.

    Raises
    ------
    ConfigError
        If a value is out of range.
    """

    position_share: float = ranged(0.01, 1.0, default=0.95)
    velocity_share: float = ranged(0.01, 1.0, default=0.9)
    effort_share: float = ranged(0.01, 1.0, default=0.8)
    transfer_share: float = ranged(0.01, 1.0, default=0.3)
    self_clearance: float = ranged(0.0, 1.0, 'm', default=0.02)
    ground_clearance: float = ranged(0.0, 1.0, 'm', default=0.03)
    ground_height: float | None = ranged(-100.0, 100.0, 'm', default=0.0)
    bias: tuple[float, ...] | None = None
    bias_spread: float = ranged(0.0, np.pi, 'rad', default=0.1)
    highest_frequency: float = ranged(1e-3, 499.0, 'Hz', default=2.0)
    ramp_time: float = ranged(0.1, 60.0, 's', default=2.0)
    unchecked_pairs: tuple[str, ...] = ()
    check_clearance: bool = True

    def __post_init__(self) -> None:
        check_fields('excitation', self)
        pairs = self.unchecked_pairs
        if not isinstance(pairs, list | tuple) or not all(isinstance(pair, str) for pair in pairs):
            raise ConfigError("excitation: unchecked_pairs must be a list of 'one to other'")
        object.__setattr__(self, 'unchecked_pairs', tuple(pairs))

    def bias_spread_of(self, robot: Robot) -> Array:
        """Return the largest random offset of each joint from the centre `bias` (n,) [rad].

        Without a given bias, the middle of a joint's range is only a guess (and may be a posture in
        collision), so the offset covers a third of the range.
        """
        if self.bias is not None:
            return np.full(robot.n, self.bias_spread)
        span = np.minimum(robot.position_max - robot.position_min, 2.0 * np.pi)
        return np.maximum(span / 6.0, self.bias_spread)

    def bias_of(self, robot: Robot) -> Array:
        """Return the centre of the motion [rad], (n,).

        Raises
        ------
        ConfigError
            If `bias` does not have one value per joint.
        """
        if self.bias is None:
            limits = robot.position_min, robot.position_max
            bounded = np.isfinite(limits).all(axis=0)
            return np.asarray(0.5 * np.where(bounded, limits, 0.0).sum(axis=0))
        if len(self.bias) != robot.n:
            raise ConfigError(
                f'excitation: bias has {len(self.bias)} values, but the robot has {robot.n} joints'
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
        If the file cannot be read or is invalid.
    """
    return load(path, 'excitation.yaml', partial(build, ExcitationConfig, 'top level'))
