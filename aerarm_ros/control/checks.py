"""Checks of parameters and references of controllers: finite, positive, within joint limits."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.motion.signals import Array


class RejectedInputError(ValueError):
    """Error: a reference or sensor sample is invalid; the message says why and what to check.

    The function that raises this error has changed nothing, so the arm continues its motion.
    """


def non_negative(name: str, values: npt.ArrayLike, n: int) -> Array:
    """Check that `values` are not negative; return a copy (n,), with a scalar repeated.

    Raises
    ------
    ValueError
        If the number of values is not n, or a value is negative or not finite.
    """
    array = finite(name, values, n)
    if np.any(array < 0.0):
        raise ValueError(f'{name} = {array} must not be negative')
    return array


def finite(name: str, values: npt.ArrayLike, n: int) -> Array:
    """Check that `values` are finite; return a copy (n,), with a scalar repeated.

    Raises
    ------
    ValueError
        If the number of values is not n, or a value is not finite.
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
        If `value` is not positive and finite.
    """
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f'{name} = {value} must be positive and finite')
    return float(value)


def non_negative_number(name: str, value: float) -> float:
    """Return `value`.

    Raises
    ------
    ValueError
        If `value` is negative or not finite.
    """
    return float(non_negative(name, value, 1)[0])


def checked_vector(what: str, values: npt.ArrayLike, unit: str) -> Array:
    """Return a vector (3,); raise RejectedInputError unless `values` are three finite numbers."""
    vector = np.array(values, dtype=float)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise RejectedInputError(f'{what} {vector} must be three finite numbers [{unit}]')
    return vector


_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of n joints.

    Attributes
    ----------
    position_min, position_max : (n,) ndarray
        Limits of the positions [rad].
    velocity_max, acceleration_max : (n,) ndarray
        Limits of the velocities [rad/s] and accelerations [rad/s^2].
    effort_max : (n,) ndarray
        Limits of the torques [Nm].
    """

    names: tuple[str, ...]
    position_min: Array
    position_max: Array
    velocity_max: Array
    acceleration_max: Array
    effort_max: Array

    @classmethod
    def from_config(cls, config: ArmConfig) -> 'JointLimits':
        """Return the joint limits in the configuration of an arm."""
        fields = ('position_min', 'position_max', 'velocity_max', 'acceleration_max', 'effort_max')
        return cls(config.joint_names, *(config.column(field) for field in fields))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)

    def order(self, names: Sequence[str]) -> list[int]:
        """Return, for each joint of the arm, its index in `names`.

        Raises
        ------
        RejectedInputError
            If `names` are not exactly the arm's joints, in any order.
        """
        if sorted(names) != sorted(self.names):
            raise RejectedInputError(
                f'joint names {list(names)} do not match the arm: name each of '
                f'{list(self.names)} once'
            )
        return [list(names).index(name) for name in self.names]

    def part(self, names: Sequence[str]) -> list[int]:
        """Return the index of each joint in `names`, which are some of the arm's joints.

        Raises
        ------
        RejectedInputError
            If there is no name, a name occurs twice or belongs to no joint.
        """
        if not names or len(set(names)) < len(names) or not set(names) <= set(self.names):
            raise RejectedInputError(
                f'joint names {list(names)} do not match the arm: name joints of '
                f'{list(self.names)}, each once'
            )
        return [self.names.index(name) for name in names]

    def including(self, q: Array) -> 'JointLimits':
        """Return limits that are widened to include the posture `q` (n,) [rad]."""
        return replace(
            self,
            position_min=np.minimum(self.position_min, q),
            position_max=np.maximum(self.position_max, q),
        )

    def check_position(self, what: str, q: Array) -> None:
        """Require that positions, (n,) or (M, n) [rad], lie inside the joint limits.

        Raises
        ------
        RejectedInputError
            If a position is outside or not a number; the message names the joint.
        """
        low, high = self.position_min - _ROUNDING, self.position_max + _ROUNDING
        inside = (q >= low) & (q <= high)
        if not np.all(inside):
            joint = int(np.argmin(np.atleast_2d(inside).all(axis=0)))
            column = np.atleast_2d(q)[:, joint]
            value = column[np.argmin(np.atleast_2d(inside)[:, joint])]
            raise RejectedInputError(
                f'{what}: {self.names[joint]} at {value:.4g} rad is outside '
                f'{self.position_min[joint]:.4g} .. {self.position_max[joint]:.4g}'
            )

    def check(self, what: str, q: Array, dq: Array | None, ddq: Array | None) -> None:
        """Require that positions, and velocities and accelerations if given, lie inside the limits.

        Raises
        ------
        RejectedInputError
            If a value is outside or not a number; the message names the joint.
        """
        self.check_position(what, q)
        if dq is not None:
            self.check_velocity(what, dq)
        if ddq is not None:
            self.check_acceleration(what, ddq)

    def check_velocity(self, what: str, dq: Array) -> None:
        """Require that velocities, (n,) or (M, n) [rad/s], lie inside the joint limits.

        Raises
        ------
        RejectedInputError
            If a velocity is too large or not a number; the message names the joint.
        """
        self._check_size(what, dq, self.velocity_max, 'rad/s')

    def check_acceleration(self, what: str, ddq: Array) -> None:
        """Require that accelerations, (n,) or (M, n) [rad/s^2], lie inside the joint limits.

        Raises
        ------
        RejectedInputError
            If an acceleration is too large or not a number; the message names the joint.
        """
        self._check_size(what, ddq, self.acceleration_max, 'rad/s^2')

    def _check_size(self, what: str, values: Array, largest: Array, unit: str) -> None:
        size = np.atleast_2d(np.abs(values)).max(axis=0)
        inside = size <= largest + _ROUNDING
        if not np.all(inside):
            joint = int(np.argmin(inside))
            raise RejectedInputError(
                f'{what}: {self.names[joint]} needs {size[joint]:.3g} {unit}, '
                f'{size[joint] - largest[joint]:.3g} more than its limit of '
                f'{largest[joint]:.3g}; slow the motion down'
            )
