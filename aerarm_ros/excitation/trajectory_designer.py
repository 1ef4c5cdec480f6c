"""Design of one optimal excitation trajectory from one random initial trajectory."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import exp, log

import numpy as np
import scipy

from aerarm_ros.excitation.criteria import (
    ConditionCriterion,
    DesignCriterion,
    IdentifiableSpace,
    InformationCriterion,
    SmoothRegressor,
    scaled_condition_number,
)
from aerarm_ros.excitation.design_problem import (
    DesignConstraints,
    DesignProblem,
    FeasibleIterates,
    StateBasis,
)
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.feasibility import FeasibilityReport, LimitMargin
from aerarm_ros.excitation.settings import ExcitationError, InfeasibleError, NothingDrawnError
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.motion.signals import Array, JointReference


@dataclass(frozen=True)
class Quality:
    """Measures of the quality of a trajectory for identification.

    Parameters
    ----------
    objective : value of the objective, smaller is better.
    condition_number : condition number (5.2) of the thesis, of the regressor without rotor
        columns.
    scaled_condition_number : condition number of the base regressor including rotor inertia, with
        columns of norm one.
    log_deviation : mean logarithm of the parameters' standard deviations, see
        `InformationCriterion`.
    """

    objective: float
    condition_number: float
    scaled_condition_number: float
    log_deviation: float

    def compared_with(self, other: Quality, name: str) -> str:
        """Return a text that compares the expected standard deviations with those of `other`."""
        gain = exp(other.log_deviation - self.log_deviation)
        if abs(gain - 1.0) < 0.005:
            return f'standard deviations equal to those of {name}'
        ratio, word = (gain, 'smaller') if gain >= 1.0 else (1.0 / gain, 'larger')
        return f'standard deviations {ratio:.2f} times {word} than those of {name}'


@dataclass(frozen=True)
class DesignResult:
    """Result of a design: a feasible trajectory with its quality.

    Parameters
    ----------
    trajectory : Fourier series of the joints.
    quality : quality figures.
    report : margins of the trajectory to all limits.
    start : number of the random start.
    seconds : computing time [s].
    remark : reason why the trajectory is not the optimum; '' for the optimum.
    """

    trajectory: FourierTrajectory
    quality: Quality
    report: FeasibilityReport
    start: int
    seconds: float
    remark: str = ''


@dataclass(frozen=True, eq=False)
class DesignSpecification:
    """Specification of a trajectory design: arm, family of trajectories, and objective.

    The objective is D-optimality under torque noise of 1 % of each joint's effort limit, with an
    upper bound of the condition number (`DesignCriterion`).

    Parameters
    ----------
    setup : arm with limits and surroundings.
    fundamental : frequency f0 [Hz].
    harmonics : number of harmonics N.
    condition_limit : upper bound of a smooth approximation of the condition number (5.2); the
        exact number is about a tenth lower.
    amplitude : largest coefficient of the random initial trajectories [rad].
    seed : seed of the random initial trajectories.

    Raises
    ------
    ExcitationError, ConfigError
        If a value is out of range.
    InfeasibleError
        If no trajectory can be feasible, because N f0 is too high or the centre is not allowed.
    """

    setup: ExcitationSetup
    fundamental: float = 0.1
    harmonics: int = 5
    condition_limit: float = 26.0
    amplitude: float = 0.35
    seed: int = 1

    def __post_init__(self) -> None:
        if not self.condition_limit > 1.0:
            raise ExcitationError(f'condition limit must exceed 1, got {self.condition_limit}')
        if self.seed < 0:
            raise ExcitationError(f'the seed must not be negative, got {self.seed}')
        # The constructor checks amplitude, fundamental and harmonics.
        self.setup.random_trajectory(self.amplitude, self.fundamental, self.harmonics)
        self._require_frequency()
        self.setup.require_bias()

    def _require_frequency(self) -> None:
        checker, highest = self.setup.checker, self.harmonics * self.fundamental
        limits = {
            'half the control rate': 0.5 / checker.CYCLE,
            'highest_frequency of the excitation configuration': checker.highest_frequency,
        }
        for name, limit in limits.items():
            if highest > limit * (1.0 + 1e-9):
                raise InfeasibleError(
                    f'the highest harmonic, N f0 = {self.harmonics} x {self.fundamental:g} Hz = '
                    f'{highest:g} Hz, exceeds {limit:g} Hz ({name}): lower the harmonics or the '
                    'fundamental'
                )

    def torque_noise(self) -> Array:
        """Return the standard deviation of each joint's torque measurement [Nm], (n,)."""
        effort = self.setup.limits.effort
        return np.where(np.isfinite(effort), 0.01 * effort, 0.1)

    def betters(self, found: Quality, other: Quality) -> bool:
        """Return whether the trajectory `found` is better than `other`.

        A better trajectory has a smaller objective, no larger standard deviations, and a larger
        condition number only if that stays below its limit.
        """
        return (
            found.objective < other.objective
            and found.log_deviation <= other.log_deviation
            and found.condition_number <= max(other.condition_number, self.condition_limit)
        )


# Exit modes of SLSQP.
_CONVERGED, _OUT_OF_ITERATIONS = 0, 9


class _StopDesignError(Exception):
    """Exception that the objective function raises to stop the optimizer."""


class TrajectoryDesigner:
    """Trajectory design by sequential quadratic programming from random feasible trajectories.

    Parameters
    ----------
    specification : specification of the design.
    """

    _SHRINKING = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15, 0.1)
    """Amplitude factors, relative to the specification, to try for a feasible start."""
    _REPORT_SAMPLES = 2000
    _RESTARTS = 4
    """Largest number of solver runs; a new run after a failure starts without curvature data.
    """
    _TOWARD_START = (0.97, 0.93, 0.85, 0.75, 0.6, 0.4)
    """Fractions of the way from start to optimum, to try if smaller amplitudes are infeasible.
    """
    _REPAIR = (1.0, 0.995, 0.99, 0.98, 0.96, 0.93, 0.9, 0.85, 0.8)
    """Amplitude factors to try if the optimum violates a limit between samples."""

    def __init__(self, specification: DesignSpecification) -> None:
        setup = specification.setup
        self.specification = specification
        self._setup = setup
        self._basis = StateBasis(
            specification.fundamental,
            specification.harmonics,
            setup.robot.n,
            setup.config.ramp_time,
        )
        self._regressor = SmoothRegressor(setup.robot)
        # Reported figures use the exact sign of the velocity, and a fine sampling rate.
        self._exact_regressor = SmoothRegressor(setup.robot, width=1e-9)
        thesis_columns = self._regressor.thesis_columns
        self._space = IdentifiableSpace.of_regressor(setup.robot, self._regressor, slice(None))
        thesis_space = IdentifiableSpace.of_regressor(setup.robot, self._regressor, thesis_columns)
        self._thesis = ConditionCriterion(thesis_space, thesis_columns)
        self._optimality = InformationCriterion(self._space, specification.torque_noise())
        limit = log(specification.condition_limit)
        self._criterion = DesignCriterion(self._optimality, self._thesis, limit)
        self._problem = self._build_problem()
        self._candidates = setup.random_trajectory(
            specification.amplitude, specification.fundamental, specification.harmonics
        )

    def initial(self, start: int, stop: Callable[[], bool] = lambda: False) -> DesignResult:
        """Return the random feasible trajectory from which design number `start` begins.

        Raises
        ------
        InfeasibleError
            If no random trajectory is feasible, even with a tenth of the amplitude; the message
            names the violated limit.
        DesignStoppedError
            If `stop` returned True before a trajectory was found.
        """
        began = time.monotonic()
        seed = int(np.random.SeedSequence([self.specification.seed, start]).generate_state(1)[0])
        binding = ''
        for shrink in self._SHRINKING:
            candidates = replace(self._candidates, amplitude=shrink * self.specification.amplitude)
            try:
                trajectory, report = candidates.draw_feasible(
                    seed, self._setup.checker, self._setup.config.ramp_time, 40, stop
                )
            except NothingDrawnError as error:
                binding = error.binding
                continue
            return self._result(trajectory, report, start, began)
        amplitude = self.specification.amplitude
        raise InfeasibleError(
            f'no random trajectory between a tenth and all of the amplitude {amplitude:g} rad is '
            f'feasible, because {binding}: lower the amplitude or the fundamental '
            f'({self.specification.fundamental:g} Hz), or check this limit and the bias'
        )

    def design(self, start: int, stop: Callable[[], bool] = lambda: False) -> DesignResult:
        """Return the best feasible trajectory of a design; if none is better, the initial one.

        Parameters
        ----------
        start : number of the random start.
        stop : function called at every step; True ends the search, and the best result is returned.

        Raises
        ------
        InfeasibleError, DesignStoppedError
            See `initial`.
        """
        began = time.monotonic()
        initial = self.initial(start, stop)
        iterates = FeasibleIterates()
        begin = self._basis.coefficients(initial.trajectory)
        optimum = self._optimise(begin, iterates, stop)
        # A search that was stopped gives no information about violated limits.
        stopped = optimum is None
        violation: LimitMargin | None = None
        for coefficients, remark in self._proposals(begin, optimum, iterates):
            trajectory = self._basis.trajectory(coefficients)
            report = self._check(trajectory)
            if report.feasible:
                remark = _explain(remark, violation)
                result = self._result(trajectory, report, start, began, remark)
                if self.specification.betters(result.quality, initial.quality):
                    return result
            elif violation is None and not stopped:
                violation = report.binding
        remark = _explain('the random initial trajectory is the best', violation)
        return replace(initial, seconds=time.monotonic() - began, remark=remark)

    def _check(self, trajectory: FourierTrajectory) -> FeasibilityReport:
        ramp_time = self._setup.config.ramp_time
        return self._setup.checker.check_trajectory(trajectory, ramp_time, stop_early=True)

    def _proposals(
        self, begin: Array, optimum: Array | None, iterates: FeasibleIterates
    ) -> Iterator[tuple[Array, str]]:
        """Yield coefficient matrices to check, the best first, each with a remark on its origin."""
        if optimum is not None:
            yield from self._shrunk(optimum, '')
        for coefficients, number in iterates.best():
            why = 'stopped after' if optimum is None else 'taken from'
            yield coefficients.reshape(self._basis.shape), f'{why} {number} steps'
        if optimum is None and iterates.last is not None:
            yield from self._shrunk(iterates.last.reshape(self._basis.shape), 'stopped early')
        # The initial trajectory satisfies all limits, and so do coefficients close to it.
        end = iterates.last if optimum is None else optimum
        if end is None:
            return
        for share in self._TOWARD_START:
            coefficients = begin + share * (end.reshape(self._basis.shape) - begin)
            yield coefficients, f'{100.0 * share:.0f} % of the way to the optimum'

    def _shrunk(self, coefficients: Array, remark: str) -> Iterator[tuple[Array, str]]:
        """Yield coefficient matrices with decreasing amplitudes about the same centre."""
        for scale in self._REPAIR:
            scaled = coefficients.copy()
            scaled[1:] *= scale
            texts = [remark, '' if scale == 1.0 else f'amplitudes times {scale:g}']
            yield scaled, ', '.join(filter(None, texts))

    def states(self, trajectory: FourierTrajectory) -> JointReference:
        """Return the states of one period, with the sampling for the reported quality."""
        time = np.arange(self._REPORT_SAMPLES) * trajectory.period / self._REPORT_SAMPLES
        return trajectory.evaluate(time)

    def quality(self, states: JointReference) -> Quality:
        """Return the quality of a trajectory, from (M, n) equally spaced states."""
        stacked = self._exact_regressor.stack(states)
        return Quality(
            self._criterion.evaluate(stacked)[0],
            self._thesis.condition_number(stacked),
            scaled_condition_number(self._space, stacked),
            self._optimality.evaluate(stacked)[0],
        )

    def _optimise(
        self, coefficients: Array, iterates: FeasibleIterates, stop: Callable[[], bool]
    ) -> Array | None:
        """Return the optimal coefficients; None after a stop. `iterates` collects all steps."""
        problem = self._problem

        def value(x: Array) -> float:
            if stop():
                raise _StopDesignError
            return problem.value(x)

        best = coefficients.ravel()
        try:
            for _ in range(self._RESTARTS):
                result = scipy.optimize.minimize(
                    value,
                    best,
                    jac=problem.gradient,
                    bounds=self._bounds(),
                    constraints={
                        'type': 'ineq',
                        'fun': problem.constraints,
                        'jac': problem.jacobian,
                    },
                    method='SLSQP',
                    options={'maxiter': 200, 'ftol': 1e-4},
                    callback=lambda x: iterates.see(x, problem.value(x), problem.constraints(x)),
                )
                if not np.isfinite(result.x).all():
                    break
                best = result.x
                if result.status in (_CONVERGED, _OUT_OF_ITERATIONS):
                    break
        except _StopDesignError:
            return None
        return np.asarray(best.reshape(coefficients.shape))

    def _bounds(self) -> Array:
        """Return lower and upper bound of each Fourier coefficient, (coefficients, 2) [rad]."""
        limits, rows = self._setup.usable_limits, self._basis.shape[0]
        # No trajectory beyond these bounds is feasible, so the line search must stay within them.
        reach = np.minimum(0.5 * (limits.position_max - limits.position_min), np.pi)
        low, high = np.tile(-reach, (2, rows, 1)) * np.array([1.0, -1.0])[:, None, None]
        low[0] = np.maximum(limits.position_min, -2.0 * np.pi)
        high[0] = np.minimum(limits.position_max, 2.0 * np.pi)
        return np.column_stack([low.ravel(), high.ravel()])

    def _build_problem(self) -> DesignProblem:
        setup, limits = self._setup, self._setup.usable_limits
        # both bounds may be infinite, but not 0
        by_current = limits.current * setup.torque_per_ampere
        robot = setup.robot
        prior = np.concatenate(
            [robot.inertial_parameters.ravel(), robot.viscous, robot.coulomb, setup.rotor_inertia]
        )
        return DesignProblem(
            self._basis,
            self._regressor,
            self._criterion,
            DesignConstraints(limits, np.minimum(limits.effort, by_current), setup.clearance),
            prior,
        )

    def _result(
        self,
        trajectory: FourierTrajectory,
        report: FeasibilityReport,
        start: int,
        began: float,
        remark: str = '',
    ) -> DesignResult:
        seconds = time.monotonic() - began
        quality = self.quality(self.states(trajectory))
        return DesignResult(trajectory, quality, report, start, seconds, remark)


def _explain(remark: str, violation: LimitMargin | None) -> str:
    return (
        remark
        if violation is None
        else f'{remark}, because the optimum exceeds a limit: {violation}'
    )
