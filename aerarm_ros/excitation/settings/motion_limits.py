"""What the joints may do during an excitation."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.motion.float_array import FloatArray


def one_a_joint(name: str, values: ArrayLike, n: int) -> FloatArray:
    """Return `values` as (n,): one for all joints, or one each.

    Raises
    ------
    ExcitationError
        If there are neither 1 nor n.
    """
    array = np.atleast_1d(np.asarray(values, dtype=float))
    if array.shape not in ((1,), (n,)):
        raise ExcitationError(f'{name} must have 1 value or {n}, one a joint, not {array.size}')
    return np.broadcast_to(array, n).copy()


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of each joint, all (n,) in joint order; infinite where there is none.

    Parameters
    ----------
    joint_names : names, for messages.
    position_min, position_max : [rad].
    velocity : largest speed [rad/s].
    acceleration : largest acceleration [rad/s^2].
    effort : largest joint torque [Nm].
    current : largest motor current [A].

    Raises
    ------
    ExcitationError
        If a shape differs, a minimum is not below its maximum, or a limit is not positive.
    """

    joint_names: tuple[str, ...]
    position_min: FloatArray
    position_max: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    effort: FloatArray
    current: FloatArray

    def __post_init__(self) -> None:
        n = len(self.joint_names)
        for field in fields(self)[1:]:
            values = np.asarray(getattr(self, field.name), dtype=float)
            object.__setattr__(self, field.name, values)
            if values.shape != (n,):
                raise ExcitationError(f'limit {field.name} must have {n} values, one a joint')
            for name, value in zip(self.joint_names, values, strict=True):
                if np.isnan(value) or (not field.name.startswith('position') and value <= 0.0):
                    raise ExcitationError(f'limit {field.name} of {name} must be positive: {value}')
        for i, name in enumerate(self.joint_names):
            if not self.position_min[i] < self.position_max[i]:
                raise ExcitationError(
                    f'position limits of {name} leave no range: minimum '
                    f'{self.position_min[i]:.4g} rad, maximum {self.position_max[i]:.4g} rad'
                )

    @classmethod
    def of_arm(cls, config: ArmConfig) -> MotionLimits:
        """Return the limits of the arm's configuration."""
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
    def of_robot(
        cls, robot: Robot, acceleration_limit: ArrayLike = np.inf, current_limit: ArrayLike = np.inf
    ) -> MotionLimits:
        """Return the limits a URDF states, and the two it does not know.

        Parameters
        ----------
        robot : the arm.
        acceleration_limit : largest acceleration [rad/s^2], one for all joints or (n,).
        current_limit : largest motor current [A], likewise.

        Raises
        ------
        ExcitationError
            If there are neither 1 nor n values, or one is not positive.
        """
        unlimited = np.full(robot.n, np.inf)
        return cls(
            tuple(robot.joint_names),
            robot.position_min,
            robot.position_max,
            robot.velocity_max,
            one_a_joint('acceleration limit', acceleration_limit, robot.n),
            # A URDF writes 0 where it does not know the effort.
            np.where(robot.effort_max > 0.0, robot.effort_max, unlimited),
            one_a_joint('current limit', current_limit, robot.n),
        )

    def scaled(self, position: float, velocity: float, effort: float) -> MotionLimits:
        """Return the share of these limits an excitation may use, each factor in (0, 1].

        Parameters
        ----------
        position : share of each joint's range, about its middle.
        velocity : share of velocity and acceleration.
        effort : share of torque and current.

        Raises
        ------
        ExcitationError
            If a share is not in (0, 1].
        """
        for name, share in (('position', position), ('velocity', velocity), ('effort', effort)):
            if not 0.0 < share <= 1.0:
                raise ExcitationError(f'usable share of {name} must be in (0, 1], got {share}')
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
