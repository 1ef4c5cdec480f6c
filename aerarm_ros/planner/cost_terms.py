"""Cost terms of a planned motion, each with its analytic gradient."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.settings import MotionLimits
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import Array, JointReference
from aerarm_ros.planner.spline_basis import SplineBasis


class TermValue(NamedTuple):
    """An integral over a motion, and its derivatives by what the motion does at each instant.

    Attributes
    ----------
    value : float
    by_q, by_dq, by_ddq : (M, n) ndarray
        The sum over the instants is the integral's change with positions, velocities and
        accelerations.
    """

    value: float
    by_q: Array
    by_dq: Array
    by_ddq: Array


class CostTerm(Protocol):
    """An integral over time of something that the motion is at each instant."""

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the integral over M instants that stand for `dt` [s] each."""
        ...


# A penalty gives way a little, and between two instants a motion may be faster than at both.
_BEGIN = 0.97  # share of a limit


class Excess(NamedTuple):
    """A penalty, summed up, and its slope (M, n) by each value."""

    value: float
    slope: Array


def excess(values: Array, limit: Array, penalty: float) -> Excess:
    """Return the penalty of values (M, n) beyond limits (n,), infinite ones being none."""
    beyond = np.maximum(np.abs(values) / limit - _BEGIN, 0.0)
    slope = (2.0 * penalty) * beyond * np.sign(values) / limit
    return Excess(penalty * float((beyond**2).sum()), slope)


class LimitTerm:
    """Penalty of velocities and accelerations beyond their limits.

    Parameters
    ----------
    limits : MotionLimits
    penalty : float
        Of (excess / limit)^2 [1/s].
    """

    def __init__(self, limits: MotionLimits, penalty: float) -> None:
        self._limits = limits
        self._penalty = penalty

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        velocity = excess(motion.dq, self._limits.velocity, self._penalty)
        acceleration = excess(motion.ddq, self._limits.acceleration, self._penalty)
        value = dt * (velocity.value + acceleration.value)
        return TermValue(
            value, np.zeros_like(motion.q), dt * velocity.slope, dt * acceleration.slope
        )


_ROOM = 0.01  # [m] beyond the required distance: postures between two instants may be nearer
_SCALE = 0.05  # [m]


class ClearanceTerm:
    """Penalty of distances below what is required.

    Parameters
    ----------
    clearance : ClearanceChecker
    penalty : float
        Of (missing distance / 50 mm)^2 [1/s].
    """

    def __init__(self, clearance: ClearanceChecker, penalty: float) -> None:
        self._clearance = clearance
        self._penalty = penalty / _SCALE**2
        # Postures that were looked at (M, n) [rad], and their margins [m].
        self._seen: tuple[Array, Array] | None = None

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        nothing = np.zeros_like(motion.q)
        by_q, value = nothing.copy(), 0.0
        for k in np.flatnonzero(self._may_be_near(motion.q)).tolist():
            q = motion.q[k]
            missing = _ROOM - self._look(k, q)
            if missing > 0.0:
                value += dt * self._penalty * missing**2
                slope = -2.0 * dt * self._penalty * missing
                by_q[k] = slope * self._clearance.margin_gradient(q)
        return TermValue(value, by_q, nothing, nothing)

    def _may_be_near(self, q: Array) -> npt.NDArray[np.bool_]:
        """Return the rows whose margin is not known to suffice by a posture seen before."""
        if self._seen is None:
            self._seen = np.array(q), np.full(len(q), -np.inf)
        before, margin = self._seen
        nearer = np.abs(q - before) @ self._clearance.steepest
        return np.asarray(margin - nearer < _ROOM)

    def _look(self, k: int, q: Array) -> float:
        assert self._seen is not None
        margin = self._clearance.margin(q)
        self._seen[0][k], self._seen[1][k] = q, margin
        return margin


class DisturbanceTerm:
    """Moment of a motion's reaction on the base, its peak above all.

    The reaction is what links and rotors take to be moved, `M_bj ddq + c_b` of the free-base
    model: weight is left out, since where the arm is, is not the motion's to choose. The integral
    of ``scale^2 (|m| / scale)^(2 power)``.

    Parameters
    ----------
    body : WholeBodyDynamics
    price : float
        [J/(Nm)^2/s], at a moment of `scale`.
    scale : float
        Moment beyond which the price rises steeply [Nm].
    power : int
        The higher, the more the peak counts and the less the rest.
    """

    def __init__(self, body: WholeBodyDynamics, price: float, scale: float, power: int = 3) -> None:
        self._body = body
        self._price = price
        self._scale = scale
        self._power = power

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        count, n = motion.q.shape
        moment, slopes = np.empty((count, 3)), np.empty((3, count, 3, n))
        for k, row in enumerate(zip(*motion, strict=True)):
            wrench, *by = self._body.reaction_with_slopes(*row)
            moment[k] = wrench[3:]
            slopes[:, k] = [slope[3:] for slope in by]
        square = (moment**2).sum(axis=1) / self._scale**2
        value = dt * self._price * self._scale**2 * float((square**self._power).sum())
        factor = 2.0 * dt * self._price * self._power * square ** (self._power - 1)
        by_moment = factor[:, np.newaxis] * moment
        return TermValue(value, *np.einsum('mi,dmij->dmj', by_moment, slopes))


def peak_moment(body: WholeBodyDynamics, motion: JointReference) -> float:
    """Return the largest moment of a motion's reaction on the base [Nm], of M instants."""
    still = np.zeros(3)
    rows: list[Array] = [body.forces(*row, still)[3:6] for row in zip(*motion, strict=True)]
    return float(np.linalg.norm(rows, axis=1).max())


# Over these a sign becomes smooth: of velocity [rad/s], of power [W].
_FRICTION_WIDTH = 0.03
_POWER_WIDTH = 0.05


class DriveTerm:
    """Energy that the supply gives [J], and a penalty of too much torque.

    Analytic by the derivatives of inverse dynamics. Dry friction and the end of recovery, where a
    motor begins to brake, are rounded off over small velocities and powers.

    Parameters
    ----------
    model : EnergyModel
    effort_max : (n,) ndarray
        Usable torque [Nm].
    price : float
        Of a joule [-]; 0 leaves the penalty alone.
    penalty : float
        Of (excess / limit)^2 [1/s].
    """

    def __init__(self, model: EnergyModel, effort_max: Array, price: float, penalty: float) -> None:
        self._dynamics = model.dynamics
        self._drives = model.drives
        self._friction = model.friction_of_width(_FRICTION_WIDTH)
        self._effort_max = effort_max
        self._price = price
        self._penalty = penalty

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        q, dq, ddq = motion
        shape = q.shape
        rigid, slopes = np.empty(shape), np.empty((3, *shape, shape[1]))
        for k in range(len(q)):
            rigid[k], slopes[0, k], slopes[1, k], slopes[2, k] = self._dynamics.inverse_with_slopes(
                q[k], dq[k], ddq[k]
            )
        rotors = self._dynamics.rotor_inertia
        load = rigid - rotors * ddq  # what turns the rotors does not go through the gears
        tau = rigid + self._friction.torque(dq, load)
        value, by_tau, by_dq = self._density(tau, dq)
        friction_by_dq, friction_by_load = self._friction.slopes(dq, load)
        by_load = dt * by_tau * friction_by_load
        by_rigid = dt * by_tau + by_load
        by_q, by_dq_of_rigid, by_ddq = np.einsum('mi,dmij->dmj', by_rigid, slopes)
        by_dq = dt * (by_dq + by_tau * friction_by_dq) + by_dq_of_rigid
        return TermValue(dt * value, by_q, by_dq, by_ddq - by_load * rotors)

    def _density(self, tau: Array, dq: Array) -> tuple[float, Array, Array]:
        """Return the sum over the instants of cost a second, and its slopes by torque, velocity."""
        drives = self._drives
        power = drives.electrical(tau, dq)
        # From the supply comes power + (1 - recovery) max(-power, 0).
        root = np.sqrt(power**2 + _POWER_WIDTH**2)
        lost = 1.0 - drives.recovery
        taken = power + lost * 0.5 * (root - power)
        by_power = self._price * (1.0 + lost * 0.5 * (power / root - 1.0))
        too_much = excess(tau, self._effort_max, self._penalty)
        by_tau = by_power * (2.0 * drives.copper_per_torque2 * tau + drives.shaft * dq)
        by_dq: Array = by_power * drives.shaft * tau
        return self._price * float(taken.sum()) + too_much.value, by_tau + too_much.slope, by_dq


class SmoothnessTerm:
    """Integral of the accelerations squared.

    How a light joint goes its way makes hardly a difference to energy, so a search leaves it
    anywhere: creeping so slowly that dry friction holds the joint beside its reference. With a
    price of acceleration such a joint moves evenly.

    Parameters
    ----------
    price : (n,) ndarray
        Of each joint [J s^3/rad^2], see `prices_by_lightness`.
    """

    def __init__(self, price: Array) -> None:
        self._price = price

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        slope = 2.0 * self._price * dt * motion.ddq
        nothing = np.zeros_like(motion.q)
        return TermValue(0.5 * float((slope * motion.ddq).sum()), nothing, nothing, slope)


def prices_by_lightness(price: float, inertia: Array) -> Array:
    """Return what acceleration costs each joint, (n,) [J s^3/rad^2].

    Of a wrong torque a light joint takes more acceleration and, feedback of computed torque being
    an acceleration too, more error: both over its inertia. So does the price go; where there is
    little to move, evenness costs little energy.

    Parameters
    ----------
    price : float
        Of the joint that moves most inertia [J s^3/rad^2].
    inertia : (n,) ndarray
        That the joints move, each alone [kg m^2].
    """
    lightness: Array = inertia.max() / inertia
    return price * lightness


class MotionCost:
    """The sum of some terms, as a function of a spline's free points and maybe its duration.

    Parameters
    ----------
    basis : SplineBasis
    start, end : (n,) ndarray
        Postures at rest [rad].
    terms : sequence of CostTerm
    second : float
        What a second costs, where the duration is free.
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
        """Return the cost, and its derivatives by points (K, n) and by the logarithm of duration.

        Parameters
        ----------
        points : (K, n) ndarray
            [rad]
        duration : float
            [s]
        """
        motion = self._basis.motion(points, *self._ends, duration)
        dt = duration / self._basis.samples
        parts = [term(motion, dt) for term in self._terms]
        value = sum(part.value for part in parts)
        # Slower by a part in a thousand: so much longer, all velocities so much less, and
        # accelerations twice that.
        by_log = self._second * duration + value
        by_points = np.zeros_like(points)
        rows = ([getattr(part, name) for part in parts] for name in ('by_q', 'by_dq', 'by_ddq'))
        for order, (slopes, matrix) in enumerate(zip(rows, self._basis.matrices, strict=True)):
            slope = np.sum(slopes, axis=0)
            by_points += matrix.T @ slope * duration**-order
            by_log -= order * float((slope * motion[order]).sum())
        return self._second * duration + value, by_points, by_log
