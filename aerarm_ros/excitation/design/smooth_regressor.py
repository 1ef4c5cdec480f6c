"""The whole regressor and its derivatives by the state, for gradient-based design."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference


class SmoothRegressor:
    """Regressor with links, viscous friction, smoothed Coulomb friction and rotor inertia.

    The columns are those of `Regressor(robot, rotor_inertia=True)`. The sign of the velocity is
    replaced by tanh(dq / width), which has a derivative.

    Parameters
    ----------
    robot : arm with n joints.
    width : velocity scale of the smoothing [rad/s].
    """

    _STEP = 1e-6

    def __init__(self, robot: Robot, width: float = 0.1) -> None:
        self._regressor = Regressor(robot, rotor_inertia=True)
        self._n = robot.n
        self._width = width

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the p = 13 n columns."""
        return self._regressor.columns

    @property
    def thesis_columns(self) -> slice:
        """The columns of thesis (3.6), without rotor inertia."""
        return slice(0, 12 * self._n)

    def stack(self, states: JointReference) -> FloatArray:
        """Return the regressor (M, n, p) of (M, n) states."""
        n, joint = self._n, np.arange(self._n)
        stacked = np.zeros((len(states.q), n, 13 * n))
        stacked[:, :, : 10 * n] = self._regressor.stack_rigid(*states)
        stacked[:, joint, 10 * n + joint] = states.dq
        stacked[:, joint, 11 * n + joint] = np.tanh(states.dq / self._width)
        stacked[:, joint, 12 * n + joint] = states.ddq
        return stacked

    def derivatives(
        self, states: JointReference, stacked: FloatArray
    ) -> Iterator[tuple[int, int, FloatArray]]:
        """Yield the derivative (M, n, p) of `stacked` by each entry of the state.

        Forward differences: the regressor is linear in the acceleration and quadratic in the
        velocity, so only the position's are inexact beyond rounding, by about 1e-6.

        Yields
        ------
        kind, joint, derivative : kind 0, 1, 2 for position, velocity and acceleration.
        """
        for kind in range(3):
            for joint in range(self._n):
                moved = [part.copy() for part in states]
                moved[kind][:, joint] += self._STEP
                yield kind, joint, (self.stack(JointReference(*moved)) - stacked) / self._STEP
