"""Designs one trajectory from one random start."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from aerarm_ros.excitation.condition_criterion import ConditionCriterion
from aerarm_ros.excitation.design_constraints import DesignConstraints
from aerarm_ros.excitation.design_problem import DesignProblem
from aerarm_ros.excitation.design_specification import DesignSpecification
from aerarm_ros.excitation.excitation_error import InfeasibleError
from aerarm_ros.excitation.feasibility_report import FeasibilityReport
from aerarm_ros.excitation.fourier_trajectory import FourierTrajectory
from aerarm_ros.excitation.identifiable_space import IdentifiableSpace
from aerarm_ros.excitation.information_criterion import InformationCriterion
from aerarm_ros.excitation.joint_reference import FloatArray, JointReference
from aerarm_ros.excitation.smooth_regressor import SmoothRegressor
from aerarm_ros.excitation.state_basis import StateBasis

# SLSQP's exit modes.
_CONVERGED, _OUT_OF_ITERATIONS = 0, 9


@dataclass(frozen=True)
class Quality:
    """How good a trajectory is.

    Parameters
    ----------
    objective : value of the objective, smaller is better.
    condition_number : thesis (5.2), without rotor columns.
    scaled_condition_number : of the base regressor, columns of norm one, rotors included.
    log_deviation : mean logarithm of the standard deviations, see `InformationCriterion`.
    """

    objective: float
    condition_number: float
    scaled_condition_number: float
    log_deviation: float


@dataclass(frozen=True)
class DesignResult:
    """A feasible trajectory, how good it is and where it comes from.

    Parameters
    ----------
    trajectory : the Fourier series.
    quality : its figures.
    report : margins to all limits.
    start : number of the random start.
    seconds : time taken [s].
    """

    trajectory: FourierTrajectory
    quality: Quality
    report: FeasibilityReport
    start: int
    seconds: float


class TrajectoryDesigner:
    """Sequential quadratic programming from random feasible trajectories.

    Parameters
    ----------
    specification : what is to be designed.
    """

    _SHRINKING = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15, 0.1)
    """Amplitudes tried for a feasible start, times the specification's."""
    _REPORT_SAMPLES = 2000
    _RESTARTS = 4
    """Attempts if the solver's quadratic subproblem fails: a new one forgets the curvature."""
    _REPAIR = (1.0, 0.995, 0.99, 0.98, 0.96, 0.93, 0.9, 0.85, 0.8)
    """Scales about the bias tried for an optimum that breaks a limit between its samples."""

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
        self.regressor = SmoothRegressor(setup.robot)
        # Results are told with the velocity's true sign, and at the rate of a fine plot.
        self._exact_regressor = SmoothRegressor(setup.robot, width=1e-9)
        everything = slice(None)
        thesis_columns = self.regressor.thesis_columns
        space = IdentifiableSpace.of_regressor(setup.robot, self.regressor, everything)
        thesis_space = IdentifiableSpace.of_regressor(setup.robot, self.regressor, thesis_columns)
        self._thesis = ConditionCriterion(thesis_space, thesis_columns)
        self._scaled = ConditionCriterion(space, everything, scaled=True)
        self.optimality = InformationCriterion(space, specification.torque_noise())
        self._criterion = specification.criterion(self._thesis, self._scaled, self.optimality)
        self._problem = self._build_problem()
        self._candidates = setup.random_trajectory(
            specification.amplitude, specification.fundamental, specification.harmonics
        )

    def initial(self, start: int) -> DesignResult:
        """Return the random feasible trajectory that `start` begins with.

        Raises
        ------
        InfeasibleError
            If there is none even with a tenth of the amplitude; names the limit that binds.
        """
        began = time.monotonic()
        seed = int(np.random.SeedSequence([self.specification.seed, start]).generate_state(1)[0])
        error = None
        for shrink in self._SHRINKING:
            candidates = replace(self._candidates, amplitude=shrink * self.specification.amplitude)
            try:
                trajectory, report = candidates.draw_feasible(
                    seed, self._setup.checker, self._setup.config.ramp_time, attempts=40
                )
            except InfeasibleError as refusal:
                error = refusal
                continue
            return self._result(trajectory, report, start, began)
        raise error if error is not None else InfeasibleError('no amplitude to try')

    def design(self, start: int) -> DesignResult:
        """Return the best feasible trajectory found from `start`, at least the initial one.

        Raises
        ------
        InfeasibleError
            As `initial`.
        """
        began = time.monotonic()
        initial = self.initial(start)
        optimum = self._optimise(self._basis.coefficients(initial.trajectory))
        for scale in self._REPAIR:
            coefficients = optimum.copy()
            coefficients[1:] *= scale
            trajectory = self._basis.trajectory(coefficients)
            report = self._setup.checker.check_trajectory(trajectory, self._setup.config.ramp_time)
            if report.feasible:
                result = self._result(trajectory, report, start, began)
                better = result.quality.objective < initial.quality.objective
                return result if better else initial
        return initial

    def states(self, trajectory: FourierTrajectory) -> JointReference:
        """Return the states of one period, fine enough to judge the trajectory by."""
        time = np.arange(self._REPORT_SAMPLES) * trajectory.period / self._REPORT_SAMPLES
        return trajectory.evaluate(time)

    def stacked(self, states: JointReference) -> FloatArray:
        """Return the regressor (M, n, p) of (M, n) states, not smoothed."""
        return self._exact_regressor.stack(states)

    def quality(self, states: JointReference) -> Quality:
        """Return the figures of a motion, given by (M, n) states at equal intervals."""
        stacked = self.stacked(states)
        return Quality(
            self._criterion.evaluate(stacked)[0],
            self._thesis.condition_number(stacked),
            self._scaled.condition_number(stacked),
            self.optimality.evaluate(stacked)[0],
        )

    def _optimise(self, coefficients: FloatArray) -> FloatArray:
        limits, problem = self._setup.usable_limits, self._problem
        # Beyond these no trajectory is feasible, and a line search has no business there.
        reach = np.minimum(0.5 * (limits.position_max - limits.position_min), np.pi)
        low, high = (
            np.tile(-reach, (2, len(coefficients), 1)) * np.array([1.0, -1.0])[:, None, None]
        )
        low[0] = np.maximum(limits.position_min, -2.0 * np.pi)
        high[0] = np.minimum(limits.position_max, 2.0 * np.pi)
        best = coefficients.ravel()
        for _ in range(self._RESTARTS):
            result = minimize(
                problem.value,
                best,
                jac=problem.gradient,
                bounds=np.column_stack([low.ravel(), high.ravel()]),
                constraints={'type': 'ineq', 'fun': problem.constraints, 'jac': problem.jacobian},
                method='SLSQP',
                options={'maxiter': 200, 'ftol': 1e-4},
            )
            if not np.isfinite(result.x).all():
                break
            best = result.x
            if result.status in (_CONVERGED, _OUT_OF_ITERATIONS):
                break
        return best.reshape(coefficients.shape)

    def _build_problem(self) -> DesignProblem:
        setup, limits = self._setup, self._setup.usable_limits
        with np.errstate(invalid='ignore'):  # no current limit times no torque constant
            by_current = np.nan_to_num(limits.current * setup.torque_per_ampere, nan=np.inf)
        robot = setup.robot
        prior = np.concatenate(
            [robot.inertial_parameters.ravel(), robot.viscous, robot.coulomb, setup.rotor_inertia]
        )
        return DesignProblem(
            self._basis,
            self.regressor,
            self._criterion,
            DesignConstraints(limits, np.minimum(limits.effort, by_current), setup.clearance),
            prior,
        )

    def _result(
        self, trajectory: FourierTrajectory, report: FeasibilityReport, start: int, began: float
    ) -> DesignResult:
        seconds = time.monotonic() - began
        quality = self.quality(self.states(trajectory))
        return DesignResult(trajectory, quality, report, start, seconds)
