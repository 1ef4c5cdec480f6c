"""Simulation of an arm with given parameters, driven by recorded torque."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.uniform_motion import (
    KinematicsFilter,
    Samples,
    sampling_time,
)
from aerarm_ros.identification.joint_model import JointModel, JointTerm, TermKind
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.motion.signals import Array

# [s] length of a window; longer windows show smaller errors, until gravity makes the arm diverge
_LENGTH = 0.5
_MOST = 40  # number of windows per bag, evenly spread
# The torque that drives a simulation is filtered less than the torque of fits, because dry
# friction reverses within milliseconds.
_CUTOFF = 20.0  # [Hz]
_SAMPLES_PER_CUTOFF = 10.0


@dataclass(frozen=True, eq=False)
class RolloutWindows:
    """W windows of an arm's motion, each with K + 1 samples.

    Attributes
    ----------
    robot : Robot
        Robot with kinematics and gravity.
    dt : float
        Sampling time [s].
    q, dq, tau : (W, K + 1, n) ndarray
        Positions [rad], velocities [rad/s], torques [Nm].
    """

    robot: Robot
    dt: float
    q: Array
    dq: Array
    tau: Array

    @classmethod
    def of(cls, robot: Robot, bags: Sequence[Samples]) -> 'RolloutWindows':
        """Return windows of the bags' motions, all with the sampling time of the first bag.

        Windows with an unknown joint torque are excluded, so the result may contain no window.
        """
        dt = float(bags[0].time[1] - bags[0].time[0])
        steps = max(2, round(_LENGTH / dt))
        parts: list[list[Array]] = [[], [], []]
        for samples in bags:
            own = float(samples.time[1] - samples.time[0])
            count = int((len(samples.time) - 1) * own / dt) + 1
            index: Array = np.asarray(dt / own * np.arange(count), dtype=float)
            complete: npt.NDArray[np.bool_] = np.asarray(samples.measured.all(axis=1))
            known = complete[np.rint(index).astype(int)]
            signals = [_at(index, values) for values in (samples.q, samples.dq, samples.tau)]
            starts = np.arange(0, len(index) - steps, steps)
            starts = np.array([s for s in starts if known[s : s + steps + 1].all()], dtype=int)
            starts = starts[np.linspace(0, len(starts) - 1, min(len(starts), _MOST)).astype(int)]
            rows = starts[:, None] + np.arange(steps + 1)
            for part, signal in zip(parts, signals, strict=True):
                part.append(signal[rows])
        q, dq, tau = (np.concatenate(part) for part in parts)
        return cls(robot, dt, q, dq, tau)

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.q)


def _at(index: Array, values: Array) -> Array:
    """Return values (M, n) at fractional sample numbers, by linear interpolation."""
    places = np.arange(len(values))
    return np.column_stack([np.interp(index, places, column) for column in values.T])


def rollout_samples(conditioner: Conditioner, recording: Recording) -> Samples:
    """Return the samples of a recording for simulation, with low-pass filtered torque.

    Raises
    ------
    IdentificationError
        If the motion in the recording is too short.
    """
    highest = 1.0 / (_SAMPLES_PER_CUTOFF * sampling_time(recording))
    cutoff = max(conditioner.cutoff, min(_CUTOFF, highest))
    kinematics = KinematicsFilter(cutoff, from_position=True)
    return conditioner.at(cutoff).condition(recording, kinematics, predicted=True)


# Dry friction is smoothed over this velocity, because with a step the simulated velocity would
# change its sign in every step.
_WIDTH = 0.02  # [rad/s]
_SLOPE = 1e-4  # [rad/s] step of the numerical derivative of friction
_INERTIA = (TermKind.ROTOR, TermKind.COUPLED_INERTIA)


class JointTorques:
    """Torque of friction, rotors, offsets and couplings of n joints, with k coefficients."""

    def __init__(self, model: JointModel) -> None:
        self._terms = [
            (joint, joint if term.driver is None else term.driver, _spread(term))
            for joint, term in model.joint_columns
        ]
        unit = np.eye(model.n)
        self._own = unit[[joint for joint, _, _ in self._terms]]
        self._moving = unit[[moving for _, moving, _ in self._terms]]
        self._is_inertia = np.array([term.kind in _INERTIA for _, _, term in self._terms])

    def columns(self, dq: Array, ddq: Array, load: Array) -> Array:
        """Return the torque (W, n, k) of each term for a coefficient of 1 [Nm].

        Parameters
        ----------
        dq, ddq, load : (W, n) ndarray
            Velocities [rad/s], accelerations [rad/s^2], and absolute torques on the links [Nm].
        """
        columns = np.zeros((*dq.shape, len(self._terms)))
        for k, (joint, moving, term) in enumerate(self._terms):
            columns[:, joint, k] = term.basis(dq[:, moving], ddq[:, moving], load[:, joint])
        return columns

    def without_inertia(self, columns: Array) -> Array:
        """Return columns with zeros for acceleration terms; these are part of the mass matrix."""
        return np.asarray(columns * ~self._is_inertia)

    def inertia(self, values: Array) -> Array:
        """Return the (n, n) inertia matrix of the joints' acceleration terms [kg m^2]."""
        return np.asarray((self._own.T * (values * self._is_inertia)) @ self._moving)

    def damping(self, values: Array, dq: Array, load: Array) -> Array:
        """Return the (W, n, n) derivative of torque with respect to velocity [Nms/rad]."""
        still = np.zeros_like(dq)
        above, below = (self.columns(dq + way * _SLOPE, still, load) for way in (0.5, -0.5))
        return np.asarray(values * (above - below) / _SLOPE @ self._moving)


def simulated_model(model: JointModel) -> JointModel:
    """Return the model for simulation: friction of steady motion, with smoothed steps.

    Only terms that build up after a reversal change, because the simulation has no such state.
    """
    terms = tuple(
        tuple(replace(_spread(term), distance=0.0) if term.distance else term for term in own)
        for own in model.terms
    )
    return replace(model, terms=terms)


def _spread(term: JointTerm) -> JointTerm:
    """Return a copy of a friction term in which dry friction changes its sign smoothly."""
    dry = (TermKind.COULOMB, TermKind.LOAD, TermKind.CREEP, TermKind.FORWARD, TermKind.BACKWARD)
    return replace(term, width=max(term.width, _WIDTH)) if term.kind in dry else term


_STEP = 5e-3  # [s] largest step
_FARTHEST = 1e3  # [rad], [rad/s] bound at which a diverging simulation stops


class Rollout:
    """Simulation of many windows of a motion in parallel.

    Integration steps are implicit in the joints' damping, so that friction never accelerates a
    joint. The links' dynamics are evaluated for the state half a step ahead.
    """

    def __init__(self, model: JointModel, windows: RolloutWindows) -> None:
        self._windows = windows
        self._joints = JointTorques(model)
        self._substeps = max(1, int(np.ceil(windows.dt / _STEP - 1e-9)))
        self._dt = windows.dt / self._substeps

    def positions(self, theta: Array) -> Array:
        """Return the simulated positions (W, K, n) at all samples except the first [rad].

        NaN where the simulation diverges, which may happen for physically impossible parameters.

        Parameters
        ----------
        theta : (p,) ndarray
            Parameters in the order of the model's columns.
        """
        return self._run(theta, sensitive=False)[0]

    def sensitivities(self, theta: Array) -> tuple[Array, Array]:
        """Return simulated positions, and derivatives (W, K, n, k) by k joint coefficients."""
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
                # State half a step ahead, extrapolated from the previous step.
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
    """Return mass matrices (W, n, n) and torques at zero acceleration (W, n) of the links."""
    mass = np.array([pin.crba(model, data, own) for own in q])
    bias = np.array([pin.nonLinearEffects(model, data, *own) for own in zip(q, dq, strict=True)])
    upper = np.triu(mass)
    return upper + np.swapaxes(np.triu(mass, 1), 1, 2), bias


def _derivatives(model: Any, data: Any, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
    """Return (W, n, n) derivatives of the links' torque with respect to position and velocity."""
    by_q, by_dq = np.empty((2, len(q), q.shape[1], q.shape[1]))
    for k, state in enumerate(zip(q, dq, ddq, strict=True)):
        pin.computeRNEADerivatives(model, data, *state)
        by_q[k], by_dq[k] = data.dtau_dq, data.dtau_dv
    return by_q, by_dq


def _solved(system: Array, right: Array) -> Array:
    """Return solutions of linear systems; the solution is infinite for a singular matrix."""
    try:
        return np.asarray(np.linalg.solve(system, right))
    except np.linalg.LinAlgError:
        return np.full(right.shape, np.inf)


@dataclass(frozen=True, eq=False)
class RolloutError:
    """Simulation error of an arm with one solver's parameters on one bag.

    Attributes
    ----------
    seconds : float
        Length of a window [s].
    windows : int
        Number of windows.
    per_joint : (n,) ndarray
        RMS position error over the windows [rad]; infinite if the simulation diverges.
    total : float
        RMS position error of all joints relative to their motion within the windows [%].
    """

    bag: str
    solver: str
    seconds: float
    windows: int
    per_joint: Array
    total: float


def rollout_error(
    robot: Robot, model: JointModel, bag: Samples, estimates: Mapping[str, Array]
) -> list[RolloutError]:
    """Simulate a bag's windows with the parameters of each solver.

    Parameters
    ----------
    estimates : mapping
        Parameters (p,) by solver.

    Returns
    -------
    list of RolloutError
        Errors of each solver; empty if no window has valid torques of all joints.
    """
    windows = RolloutWindows.of(robot, [bag])
    if not windows.count:
        return []
    rollout = Rollout(model, windows)
    moved = windows.q[:, 1:] - windows.q[:, :1]
    size = max(float(np.linalg.norm(moved)), 1e-12)
    errors = []
    for solver, theta in estimates.items():
        left = rollout.positions(theta) - windows.q[:, 1:]
        squares = np.where(np.isfinite(left), left, np.inf) ** 2
        errors.append(
            RolloutError(
                bag.name,
                solver,
                windows.dt * moved.shape[1],
                windows.count,
                np.sqrt(squares.mean(axis=(0, 1))),
                100.0 * float(np.sqrt(squares.sum())) / size,
            )
        )
    return errors
