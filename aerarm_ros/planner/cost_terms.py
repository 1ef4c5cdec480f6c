"""Cost terms of a planned motion, each with an analytic gradient."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.settings import MotionLimits
from aerarm_ros.motion.signals import Array, JointReference
from aerarm_ros.planner.spline_basis import SplineBasis


class TermValue(NamedTuple):
    """Value of a cost term for a motion, and its derivatives by q, dq and ddq at each instant.

    Attributes
    ----------
    value : float
        Value of the integral over time.
    by_q, by_dq, by_ddq : (M, n) ndarray
        Derivatives with respect to positions, velocities and accelerations at each instant.
    """

    value: float
    by_q: Array
    by_dq: Array
    by_ddq: Array


class CostTerm(Protocol):
    """Cost term of a planned motion: the integral over time of a function of the motion."""

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term's value for a motion that is sampled at M instants, `dt` [s] apart."""
        ...


# The penalty begins below the limit, because it permits small violations, and between two
# instants a motion may be faster than at both.
_BEGIN = 0.97  # fraction of a limit at which the penalty begins


def excess(values: Array, limit: Array, penalty: float) -> tuple[float, Array]:
    """Return the penalty of values (M, n) beyond their limits (n,), and its slopes (M, n)."""
    beyond = np.maximum(np.abs(values) / limit - _BEGIN, 0.0)
    slope = (2.0 * penalty) * beyond * np.sign(values) / limit
    return penalty * float((beyond**2).sum()), slope


class LimitTerm:
    """Cost term: penalty of velocities and accelerations beyond their limits.

    Parameters
    ----------
    penalty : float
        Weight of (excess / limit)^2 [1/s].
    """

    def __init__(self, limits: MotionLimits, penalty: float) -> None:
        self._limits = limits
        self._penalty = penalty

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the penalty and its derivatives, see `TermValue`."""
        fast, by_dq = excess(motion.dq, self._limits.velocity, self._penalty)
        hard, by_ddq = excess(motion.ddq, self._limits.acceleration, self._penalty)
        return TermValue(dt * (fast + hard), np.zeros_like(motion.q), dt * by_dq, dt * by_ddq)


# [m] added to the required distance, because links may be closer between instants
_PAD = 0.01
_SCALE = 0.05  # [m]


class ClearanceTerm:
    """Cost term: penalty of distances (clearances) below the required distances.

    Parameters
    ----------
    penalty : float
        Weight of (missing distance / 50 mm)^2 [1/s].
    """

    def __init__(self, clearance: ClearanceChecker, penalty: float) -> None:
        self._clearance = clearance
        self._penalty = penalty / _SCALE**2
        # Postures (M, n) [rad] that were evaluated before, and their clearance margins [m].
        self._seen: tuple[Array, Array] | None = None

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the penalty and its derivatives, see `TermValue`."""
        nothing = np.zeros_like(motion.q)
        by_q, value = nothing.copy(), 0.0
        for k in np.flatnonzero(self._may_be_near(motion.q)).tolist():
            q = motion.q[k]
            missing = _PAD - self._look(k, q)
            if missing > 0.0:
                value += dt * self._penalty * missing**2
                slope = -2.0 * dt * self._penalty * missing
                by_q[k] = slope * self._clearance.margin_gradient(q)
        return TermValue(value, by_q, nothing, nothing)

    def _may_be_near(self, q: Array) -> npt.NDArray[np.bool_]:
        """Return a mask (M,) of the postures whose clearance may be small enough for a penalty."""
        if self._seen is None:
            self._seen = np.array(q), np.full(len(q), -np.inf)
        before, margin = self._seen
        nearer = np.abs(q - before) @ self._clearance.steepest
        return np.asarray(margin - nearer < _PAD)

    def _look(self, k: int, q: Array) -> float:
        assert self._seen is not None
        margin = self._clearance.margin(q)
        self._seen[0][k], self._seen[1][k] = q, margin
        return margin


# Widths over which the sign of a velocity [rad/s] and the sign of a power [W] are smoothed.
_FRICTION_WIDTH = 0.03
_POWER_WIDTH = 0.05


class DriveTerm:
    """Cost term: energy drawn from the supply [J], and penalty of torques beyond their limits.

    The derivatives are analytic, from the derivatives of inverse dynamics. Dry friction and the
    onset of recuperation, where a motor begins to brake, are smoothed over small velocities and
    powers.

    Parameters
    ----------
    effort_max : (n,) ndarray
        Usable torque [Nm].
    price : float
        Price per joule [-]; 0 means only the penalty.
    penalty : float
        Weight of (excess / limit)^2 [1/s].
    """

    def __init__(self, model: EnergyModel, effort_max: Array, price: float, penalty: float) -> None:
        self._dynamics = model.dynamics
        self._drives = model.drives
        self._friction = model.friction_of_width(_FRICTION_WIDTH)
        self._effort_max = effort_max
        self._price = price
        self._penalty = penalty

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the cost and its derivatives, see `TermValue`."""
        q, dq, ddq = motion
        shape = q.shape
        rigid, slopes = np.empty(shape), np.empty((3, *shape, shape[1]))
        for k in range(len(q)):
            rigid[k], slopes[0, k], slopes[1, k], slopes[2, k] = self._dynamics.inverse_with_slopes(
                q[k], dq[k], ddq[k]
            )
        rotors = self._dynamics.rotor_inertia
        # the gears do not transmit the torque that accelerates the rotors
        load = rigid - rotors * ddq
        tau = rigid + self._friction.torque(dq, load)
        value, by_tau, by_dq = self._density(tau, dq)
        friction_by_dq, friction_by_load = self._friction.slopes(dq, load)
        by_load = dt * by_tau * friction_by_load
        by_rigid = dt * by_tau + by_load
        by_q, by_dq_of_rigid, by_ddq = np.einsum('mi,dmij->dmj', by_rigid, slopes)
        by_dq = dt * (by_dq + by_tau * friction_by_dq) + by_dq_of_rigid
        return TermValue(dt * value, by_q, by_dq, by_ddq - by_load * rotors)

    def _density(self, tau: Array, dq: Array) -> tuple[float, Array, Array]:
        """Return the drives' cost per second, and its derivatives by torque and velocity."""
        drives = self._drives
        power = drives.electrical(tau, dq)
        # Power from the supply: power + (1 - recovery) max(-power, 0).
        root = np.sqrt(power**2 + _POWER_WIDTH**2)
        lost = 1.0 - drives.recovery
        taken = power + lost * 0.5 * (root - power)
        by_power = self._price * (1.0 + lost * 0.5 * (power / root - 1.0))
        strong, slope = excess(tau, self._effort_max, self._penalty)
        by_tau = by_power * (2.0 * drives.copper_per_torque2 * tau + drives.shaft * dq)
        by_dq: Array = by_power * drives.shaft * tau
        return self._price * float(taken.sum()) + strong, by_tau + slope, by_dq


class SmoothnessTerm:
    """Cost term: integral of the squared joint accelerations.

    The motion of a light joint hardly affects the energy. Without this term the search may
    therefore return very slow motions, in which dry friction keeps the joint away from its
    reference. A price on acceleration makes such a joint move evenly.

    Parameters
    ----------
    price : (n,) ndarray
        Price of each joint [J s^3/rad^2], see `prices_by_lightness`.
    """

    def __init__(self, price: Array) -> None:
        self._price = price

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the cost and its derivatives, see `TermValue`."""
        slope = 2.0 * self._price * dt * motion.ddq
        nothing = np.zeros_like(motion.q)
        return TermValue(0.5 * float((slope * motion.ddq).sum()), nothing, nothing, slope)


def prices_by_lightness(price: float, inertia: Array) -> Array:
    """Return the cost per squared acceleration of each joint, (n,) [J s^3/rad^2].

    A torque error causes an acceleration error, and under computed torque control a tracking
    error, that are inversely proportional to the joint's inertia. The price is therefore
    inversely proportional to the inertia. For light joints a high price costs little energy.

    Parameters
    ----------
    price : float
        Price of the joint with the largest inertia [J s^3/rad^2].
    inertia : (n,) ndarray
        Inertia that each joint moves while the other joints are at rest [kg m^2].
    """
    lightness: Array = inertia.max() / inertia
    return price * lightness


class MotionCost:
    """Sum of cost terms, as a function of a spline's free points and, optionally, its duration.

    Parameters
    ----------
    start, end : (n,) ndarray
        Postures at rest [rad].
    terms : sequence of CostTerm
        Cost terms to add.
    second : float
        Price of a second of the motion, if its duration is free.
    """

    def __init__(
        self,
        basis: SplineBasis,
        start: Array,
        end: Array,
        terms: Sequence[CostTerm],
        second: float = 0.0,
    ) -> None:
        self._basis = basis
        self._ends = start, end
        self._terms = terms
        self._second = second

    def of(self, points: Array, duration: float) -> tuple[float, Array, float]:
        """Return the cost, and its derivatives by points (K, n) and logarithmic duration.

        Parameters
        ----------
        points : (K, n) ndarray
            Free control points [rad].
        duration : float
            Duration of the motion [s].
        """
        motion = self._basis.motion(points, *self._ends, duration)
        dt = duration / self._basis.samples
        parts = [term(motion, dt) for term in self._terms]
        value = sum(part.value for part in parts)
        # A relative change of the duration by e changes all velocities by -e and all accelerations
        # by -2 e.
        by_log = self._second * duration + value
        by_points = np.zeros_like(points)
        rows = ([getattr(part, name) for part in parts] for name in ('by_q', 'by_dq', 'by_ddq'))
        for order, (slopes, matrix) in enumerate(zip(rows, self._basis.matrices, strict=True)):
            slope = np.sum(slopes, axis=0)
            by_points += matrix.T @ slope * duration**-order
            by_log -= order * float((slope * motion[order]).sum())
        return self._second * duration + value, by_points, by_log
