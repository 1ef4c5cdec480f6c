"""Planner of motions with least energy or shortest duration."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from aerarm_ros.energy.energy_model import EnergyModel, HoldingLoss
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.feasibility import EffortModel, FeasibilityChecker, FeasibilityReport
from aerarm_ros.excitation.settings import MotionLimits
from aerarm_ros.excitation.trajectory import standstill
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.polynomial_path import PolynomialPath, rest_to_rest_duration
from aerarm_ros.motion.signals import Array
from aerarm_ros.planner.cost_terms import (
    ClearanceTerm,
    CostTerm,
    DriveTerm,
    LimitTerm,
    MotionCost,
    SmoothnessTerm,
    prices_by_lightness,
)
from aerarm_ros.planner.motion_plan import (
    ENERGY,
    QUINTIC,
    TIME,
    MotionPlan,
    PlanError,
    PlanSettings,
)
from aerarm_ros.planner.spline_basis import SplineBasis

_SEEDS = 24
_STEPS = 30
_NEAR = 1e-4  # [m] tolerated distance of the tool from its target
_DAMPING = 1e-3  # [m/rad] below which a singular value is ignored
_LARGEST_STEP = 0.4  # [rad]
_SAME = 0.05  # [rad] largest difference of two postures that count as equal
_TRAVEL_PRICE = 0.5  # [J/rad^2] assumed price of a path that is not planned yet
# [W/rad^2] approximate largest curvature of the holding loss, for the step size
_LOSS_CURVATURE = 20.0
_GLANCE = 24  # number of instants at which a path is evaluated


class ToolPostures:
    """Search for postures in which the tool is at a position (inverse kinematics).

    From many random postures, Gauss-Newton steps move the tool to the target. Each resulting
    posture is then improved by motions that keep the tool at the target and reduce holding loss
    and path cost.

    Parameters
    ----------
    kinematics : Kinematics
        Kinematics of the tool frame.
    limits : MotionLimits
        Limits of the joints.
    hold_time : float
        Time that the arm will stay at the target [s].
    """

    def __init__(
        self, model: EnergyModel, kinematics: Kinematics, limits: MotionLimits, hold_time: float
    ) -> None:
        self._model = model
        self._kinematics = kinematics
        self._limits = limits
        self._loss = HoldingLoss(model)
        self._hold_time = hold_time

    def holding(self, q: Array) -> float:
        """Return the energy [J] that holding the posture q (n,) needs during the hold time."""
        return self._hold_time * self._loss.watts(q)

    def find(self, point: ArrayLike, start: Array, duration: float) -> list[Array]:
        """Return postures (n,) [rad] that reach a point, sorted by the cost of path and posture.

        Parameters
        ----------
        point : (3,) array_like
            Target of the tool in the base frame [m].
        start : (n,) ndarray
            Present posture [rad].
        duration : float
            Duration of the path [s].

        Raises
        ------
        PlanError
            If no posture within the limits was found.
        """
        place = np.array(point, dtype=float)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise PlanError(
                f'the tool goal needs three finite numbers [m], but is {place.tolist()}'
            )
        low, high = self._range(start)
        random = np.random.default_rng(0)  # fixed seed, so that equal goals give equal results
        seeds = [start, *random.uniform(low, high, (_SEEDS, len(start)))]
        found: list[Array] = []
        for seed in seeds:
            q = self._settled(place, seed, start, low, high)
            if q is not None and all(np.abs(q - other).max() > _SAME for other in found):
                found.append(q)
        if not found:
            raise PlanError(
                f'tool goal ({place[0]:.3f}, {place[1]:.3f}, {place[2]:.3f}) m is out of reach: '
                'choose a position that the tool reaches within the position limits'
            )
        return sorted(found, key=lambda q: self.holding(q) + self._way(start, q, duration))

    def _range(self, start: Array) -> tuple[Array, Array]:
        """Return position limits (n,) for the search; unlimited joints get one turn."""
        low, high = self._limits.position_min, self._limits.position_max
        return (
            np.where(np.isfinite(low), low, start - np.pi),
            np.where(np.isfinite(high), high, start + np.pi),
        )

    def _settled(
        self, place: Array, seed: Array, start: Array, low: Array, high: Array
    ) -> Array | None:
        """Return the posture that the search from `seed` finds; None if the tool misses `place`."""
        q, error = np.array(seed), np.inf
        steepness = self._hold_time * _LOSS_CURVATURE + 2.0 * _TRAVEL_PRICE
        for step in range(_STEPS):
            jacobian = self._kinematics.position_jacobian(q)
            away = place - self._kinematics.position(q)
            square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(3)
            inverse = jacobian.T @ np.linalg.inv(square)
            slope = self._hold_time * self._loss.gradient(q) + 2.0 * _TRAVEL_PRICE * (q - start)
            # Decreasing steps, so that the tool converges to the target.
            slide = (step / _STEPS - 1.0) / steepness * slope
            change = inverse @ away + slide - inverse @ (jacobian @ slide)
            q = q + change * min(1.0, _LARGEST_STEP / (np.abs(change).max() + 1e-12))
            q = np.minimum(np.maximum(q, low), high)
            error = float(np.linalg.norm(place - self._kinematics.position(q)))
        return q if error < _NEAR else None

    def _way(self, start: Array, q: Array, duration: float) -> float:
        """Return an estimate of the energy [J] of a straight path from `start` to q."""
        straight = PolynomialPath.rest_to_rest(start, q, duration)
        times = (np.arange(_GLANCE) + 0.5) * duration / _GLANCE
        power = self._model.drives.from_supply(self._model.power(straight, times))
        return float(power.sum() * duration / _GLANCE)


_SHORTEST, _LONGEST = 0.05, 60.0  # [s] bounds of a free duration
# Penalties of violated limits [1/s], tried in order.
_PENALTIES = (1e3, 3e4, 1e6)
_ITERATIONS = 60
_CHANGE = 1e-6  # relative change of the cost at which the search ends
_QUICK = 1e3  # price of a second if only the duration is minimized
_STRETCH = 1.02  # factor by which a motion of free duration is slowed per step
_STRETCHES = 40
_POINTS, _INSTANTS = 8, 32  # free points of each joint's spline, and evaluated instants
_GLANCES = 5  # postures on the straight path used to determine the joints' inertia
# Fractions by which a motion that slightly violates a limit is moved towards the straight motion.
_TOWARD_QUINTIC = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
_CANDIDATES = 2  # number of goal postures to which motions are planned
_TYPICAL = 2.0  # [s] assumed duration before it is known


class MotionPlanner:
    """Planner of motions from rest to rest, which are represented by splines.

    The search (L-BFGS-B) evaluates a motion at discrete instants, with limits as penalties;
    position limits are exact bounds. `FeasibilityChecker` then checks the result independently at
    every control cycle, and the planner returns it only if no limit is violated.

    Parameters
    ----------
    model : EnergyModel
        Model with friction and payload.
    setup : ExcitationSetup
        Limits, clearances and surroundings of the same arm.
    """

    def __init__(
        self, model: EnergyModel, setup: ExcitationSetup, settings: PlanSettings | None = None
    ) -> None:
        self._model = model
        self._setup = setup
        rotors = model.dynamics.rotor_inertia
        # The check uses the same friction as the planned energy.
        self._efforts = EffortModel(
            setup.robot, rotors, setup.torque_per_ampere, model.load_friction
        )
        self._set(settings or PlanSettings())

    def _set(self, settings: PlanSettings) -> None:
        self.settings, setup = settings, self._setup
        velocity, effort = settings.velocity_share, settings.effort_share
        self._limits = setup.limits.scaled(1.0, velocity, effort)
        self._effort_max = np.minimum(
            self._limits.effort, self._limits.current * setup.torque_per_ampere
        )
        self._checker = FeasibilityChecker(self._limits, setup.clearance, self._efforts)
        self._basis = SplineBasis.of(_POINTS, _INSTANTS)

    def with_settings(self, **changes: object) -> MotionPlanner:
        """Return a copy of the planner with changed settings."""
        other = copy(self)
        other._set(replace(self.settings, **changes))  # type: ignore[arg-type]
        return other

    @property
    def limits(self) -> MotionLimits:
        """Fraction of the arm's limits that a planned motion may use."""
        return self._limits

    def carry(self, payload: ArrayLike) -> None:
        """Add a payload (10,) to the last link, see `Dynamics.carry`; ValueError if impossible."""
        self._model.carry(payload)
        self._efforts.carry(payload)

    def plan_tool(
        self, start: ArrayLike, point: ArrayLike, frame: str = 'tool0', hold_time: float = 5.0
    ) -> MotionPlan:
        """Return a motion that ends with the tool at a point, in the posture of least cost.

        Motions to several goal postures (see `ToolPostures`) are planned, and the one with the
        least cost is returned.

        Parameters
        ----------
        start : (n,) array_like
            Initial posture [rad].
        point : (3,) array_like
            Target point in the base frame [m].
        frame : str
            Name of the tool frame.
        hold_time : float
            Time that the arm will stay at the target [s].

        Raises
        ------
        PlanError
            If no posture or motion was found; the message names the obstacle.
        """
        q0 = self._posture('start', start)
        kinematics = Kinematics(self._setup.robot, frame)
        postures = ToolPostures(self._model, kinematics, self._limits, hold_time)
        found = postures.find(point, q0, self.settings.duration or _TYPICAL)
        plans: list[MotionPlan] = []
        reason: PlanError | None = None
        for q in found:
            try:
                plans.append(self.plan(q0, q))
            except PlanError as error:
                reason = reason or error
            if len(plans) == _CANDIDATES:
                break
        if not plans and reason is not None:
            raise reason
        return min(plans, key=lambda plan: plan.balance.motors.sum() + postures.holding(plan.goal))

    def plan(self, start: ArrayLike, goal: ArrayLike) -> MotionPlan:
        """Return a motion between two postures (n,) [rad].

        Raises
        ------
        PlanError
            If the arm cannot rest at start or goal, or the motion is impossible in the given
            duration; the message names the limit.
        """
        q0, q1 = self._posture('start', start), self._posture('goal', goal)
        settings = self.settings
        if settings.objective == QUINTIC:
            return self._quintic(q0, q1)
        if settings.duration and settings.objective == ENERGY:
            return self._of_duration(q0, q1, settings.duration)
        standby = self._model.config.power_stage.standby
        price = _QUICK if settings.objective == TIME else settings.time_price + standby
        return self._of_free_duration(q0, q1, price)

    def _posture(self, what: str, q: ArrayLike) -> Array:
        posture = np.array(q, dtype=float)
        n = self._model.n
        if posture.shape != (n,) or not np.isfinite(posture).all():
            raise PlanError(f'{what} needs {n} finite joint angles, but is {posture.tolist()}')
        self._require(self._checker.check(standstill(posture)), f'the {what}')
        return posture

    def _quintic(self, q0: Array, q1: Array) -> MotionPlan:
        duration = self.settings.duration or self._quintic_duration(q0, q1)
        path = PolynomialPath.rest_to_rest(q0, q1, duration)
        report = self._checker.check(path)
        for _ in range(0 if self.settings.duration else _STRETCHES):
            if report.feasible:
                break
            path = PolynomialPath.rest_to_rest(q0, q1, _STRETCH * path.duration)
            report = self._checker.check(path)
        self._require(report, f'a quintic motion of {path.duration:.3g} s')
        return self._made(path, report)

    def _quintic_duration(self, q0: Array, q1: Array) -> float:
        limits = self._limits
        return rest_to_rest_duration(q1 - q0, limits.velocity, limits.acceleration, _SHORTEST)

    def _of_duration(self, q0: Array, q1: Array, duration: float) -> MotionPlan:
        near = PolynomialPath.rest_to_rest(q0, q1, duration)
        points = first = self._basis.points_near(near)
        further = self._smoothness_terms(near)
        checks_clearance = False
        for penalty in _PENALTIES:
            terms = [*self._terms(1.0, penalty, checks_clearance), *further]
            cost = MotionCost(self._basis, q0, q1, terms)
            points = self._searched(cost, points, duration)[0]
            path = self._basis.path(points, q0, q1, duration)
            report = self._checker.check(path, stop_early=True)
            if report.feasible:
                return self._made(path, report)
            # Skip distances if possible, because they take most of the time.
            checks_clearance = checks_clearance or 'clearance' in report.binding.limit
        for share in _TOWARD_QUINTIC:
            path = self._basis.path(points + share * (first - points), q0, q1, duration)
            if self._checker.check(path, stop_early=True).feasible:
                return self._made(path, self._checker.check(path))
        self._require(report, f'a motion of {duration:.3g} s', self._advice(q0, q1, duration))
        raise AssertionError  # motions that violate a limit were rejected before

    def _of_free_duration(self, q0: Array, q1: Array, second: float) -> MotionPlan:
        duration = 1.2 * self._quintic_duration(q0, q1)
        near = PolynomialPath.rest_to_rest(q0, q1, duration)
        points = self._basis.points_near(near)
        is_priced = self.settings.objective == ENERGY
        further = self._smoothness_terms(near) if is_priced else []
        checks_clearance = False
        for penalty in _PENALTIES:
            terms = [*self._terms(float(is_priced), 10.0 * penalty, checks_clearance), *further]
            cost = MotionCost(self._basis, q0, q1, terms, second)
            points, duration = self._searched(cost, points, duration, is_free=True)
            path, report = self._stretched(points, q0, q1, duration)
            if report.feasible:
                return self._made(path, report)
            # Skip distances if possible, because they take most of the time.
            checks_clearance = checks_clearance or 'clearance' in report.binding.limit
        self._require(report, 'every motion that the planner tried')
        raise AssertionError

    def _stretched(
        self, points: Array, q0: Array, q1: Array, duration: float
    ) -> tuple[PolynomialPath, FeasibilityReport]:
        """Return the motion with the first duration, from `duration` on, that keeps all limits."""
        for _ in range(_STRETCHES):
            path = self._basis.path(points, q0, q1, duration)
            report = self._checker.check(path, stop_early=True)
            if report.feasible or 'clearance' in report.binding.limit:
                break
            duration *= _STRETCH
        return path, self._checker.check(path)

    def _terms(self, price: float, penalty: float, checks_clearance: bool) -> Sequence[CostTerm]:
        terms: list[CostTerm] = [
            DriveTerm(self._model, self._effort_max, price, penalty),
            LimitTerm(self._limits, penalty),
        ]
        if checks_clearance and self._setup.clearance is not None:
            terms.append(ClearanceTerm(self._setup.clearance, penalty))
        return terms

    def _smoothness_terms(self, near: PolynomialPath) -> list[CostTerm]:
        """Return the cost term of the joint accelerations for motions near a given one."""
        if not self.settings.smoothness:
            return []
        postures = near.evaluate(np.linspace(0.0, near.duration, _GLANCES)).q
        matrices = [self._model.dynamics.inertia_matrix(q) for q in postures]
        inertia = np.mean([np.diag(matrix) for matrix in matrices], axis=0)
        return [SmoothnessTerm(prices_by_lightness(self.settings.smoothness, inertia))]

    def _searched(
        self, cost: MotionCost, points: Array, duration: float, is_free: bool = False
    ) -> tuple[Array, float]:
        """Return the free points (K, n) of least cost, and the duration (optimized if free)."""
        shape, size = points.shape, points.size
        bounds = list(
            zip(
                np.tile(self._limits.position_min, shape[0]),
                np.tile(self._limits.position_max, shape[0]),
                strict=True,
            )
        )
        x = points.ravel()
        if is_free:
            x = np.append(x, np.log(duration))
            bounds.append((np.log(_SHORTEST), np.log(_LONGEST)))

        def value(x: Array) -> tuple[float, Array]:
            length = float(np.exp(x[size])) if is_free else duration
            total, by_points, by_log = cost.of(x[:size].reshape(shape), length)
            slope = by_points.ravel()
            return total, np.append(slope, by_log) if is_free else slope

        found = scipy.optimize.minimize(
            value,
            x,
            jac=True,
            method='L-BFGS-B',
            bounds=bounds,
            options={'maxiter': _ITERATIONS, 'ftol': _CHANGE, 'maxcor': 20},
        ).x
        return found[:size].reshape(shape), float(np.exp(found[size])) if is_free else duration

    def _made(self, path: PolynomialPath, report: FeasibilityReport) -> MotionPlan:
        return MotionPlan(path, self._model.balance(path), report)

    def _advice(self, q0: Array, q1: Array, duration: float) -> str:
        """Return a clause on the fastest feasible motion; '' if more time does not help."""
        try:
            quickest = self.with_settings(objective=TIME, duration=0.0).plan(q0, q1)
        except PlanError:
            return ''
        needed = quickest.path.duration
        return f'the fastest motion takes {needed:.2f} s' if needed > duration else ''

    @staticmethod
    def _require(report: FeasibilityReport, what: str, advice: str = '') -> None:
        if not report.feasible:
            raise PlanError(
                f'{what} is infeasible: {report.binding}' + (f'; {advice}' if advice else '')
            )
