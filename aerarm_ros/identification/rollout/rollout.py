"""An arm with some parameters, moved by recorded torque."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.rollout.joint_torques import JointTorques
from aerarm_ros.identification.rollout.rollout_windows import RolloutWindows

Array = npt.NDArray[np.float64]

_STEP = 5e-3  # [s] at most
_FARTHEST = 1e3  # [rad], [rad/s]: a model that runs away is stopped there


class Rollout:
    """Simulates windows of a motion, all side by side.

    Steps are implicit in the joints' own damping, so that friction never pushes, and take the links
    as they are half a step ahead.

    Parameters
    ----------
    model : JointModel
    windows : RolloutWindows
    """

    def __init__(self, model: JointModel, windows: RolloutWindows) -> None:
        self._windows = windows
        self._joints = JointTorques(model)
        self._substeps = max(1, int(np.ceil(windows.dt / _STEP - 1e-9)))
        self._dt = windows.dt / self._substeps

    def positions(self, theta: Array) -> Array:
        """Return the (W, K, n) positions at the samples after the first [rad].

        NaN where an arm has run away, as one may whose parameters are those of no body.

        Parameters
        ----------
        theta : (p,) ndarray
            In the order of the model's columns.
        """
        return self._run(theta, sensitive=False)[0]

    def sensitivities(self, theta: Array) -> tuple[Array, Array]:
        """Return positions, and their (W, K, n, k) derivatives by the joints' k coefficients."""
        return self._run(theta, sensitive=True)

    def _run(self, theta: Array, sensitive: bool) -> tuple[Array, Array]:
        windows, n = self._windows, self._windows.robot.n
        arm = windows.robot.with_inertial_parameters(theta[: 10 * n].reshape(n, 10)).model
        data, values = arm.createData(), theta[10 * n :]
        count, samples = windows.count, windows.q.shape[1] - 1
        q, dq, ddq = windows.q[:, 0], windows.dq[:, 0], np.zeros((count, n))
        of_q, of_dq, grown = np.zeros((3, count if sensitive else 0, n, len(values)))
        positions = np.empty((count, samples, n))
        slopes = np.empty((len(of_q), samples, n, len(values)))
        for sample in range(samples):
            for part in range(self._substeps):
                share = (part + 0.5) / self._substeps
                tau = (1.0 - share) * windows.tau[:, sample] + share * windows.tau[:, sample + 1]
                # Half a step ahead, as the step before went on.
                ahead = q + 0.5 * self._dt * dq, dq + 0.5 * self._dt * ddq
                mass, bias = _links(arm, data, *ahead)
                load = np.abs((mass @ ddq[..., None])[..., 0] + bias)
                damping = self._joints.damping(values, dq, load)
                system = mass + self._joints.inertia(values) + self._dt * damping
                columns = self._joints.columns(dq, ddq, load)
                own = self._joints.without_inertia(columns) @ values
                change = _solved(system, (self._dt * (tau - bias - own))[..., None])[..., 0]
                if sensitive:
                    columns = self._joints.columns(dq, change / self._dt, load)
                    by_q, by_dq = _derivatives(arm, data, *ahead, change / self._dt)
                    pull = columns + damping @ of_dq + by_q @ (of_q + 0.5 * self._dt * of_dq)
                    grown = _solved(system, -self._dt * (pull + by_dq @ (of_dq + 0.5 * grown)))
                    of_q = of_q + self._dt * (of_dq + 0.5 * grown)
                    of_dq = of_dq + grown
                q = np.clip(q + self._dt * (dq + 0.5 * change), -_FARTHEST, _FARTHEST)
                dq, ddq = np.clip(dq + change, -_FARTHEST, _FARTHEST), change / self._dt
            positions[:, sample] = np.where(np.abs(q) < _FARTHEST, q, np.nan)
            slopes[:, sample] = of_q
        return positions, slopes


def _links(model: Any, data: Any, q: Array, dq: Array) -> tuple[Array, Array]:
    """Return mass matrices (W, n, n) and torques without acceleration (W, n) of the links."""
    mass = np.array([pin.crba(model, data, own) for own in q])
    bias = np.array([pin.nonLinearEffects(model, data, *own) for own in zip(q, dq, strict=True)])
    upper = np.triu(mass)
    return upper + np.swapaxes(np.triu(mass, 1), 1, 2), bias


def _derivatives(model: Any, data: Any, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
    """Return the (W, n, n) derivatives of the links' torque by position and velocity."""
    by_q, by_dq = np.empty((2, len(q), q.shape[1], q.shape[1]))
    for k, state in enumerate(zip(q, dq, ddq, strict=True)):
        pin.computeRNEADerivatives(model, data, *state)
        by_q[k], by_dq[k] = data.dtau_dq, data.dtau_dv
    return by_q, by_dq


def _solved(system: Array, right: Array) -> Array:
    """Return the solutions; infinite where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(system, right))
    except np.linalg.LinAlgError:
        return np.full(right.shape, np.inf)
