"""Feasibility checks and excitation planner of one arm, from its description and configuration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.feasibility import (
    EffortModel,
    FeasibilityChecker,
    FeasibilityReport,
    LimitMargin,
    StopLimits,
)
from aerarm_ros.excitation.settings import (
    DesignStoppedError,
    ExcitationConfig,
    ExcitationError,
    InfeasibleError,
    MotionLimits,
    NothingDrawnError,
)
from aerarm_ros.excitation.trajectory import (
    FourierTrajectory,
    MotionSequence,
    RampedExcitation,
    Stage,
    standstill,
    transfer,
)
from aerarm_ros.motion.polynomial_path import rest_to_rest_duration
from aerarm_ros.motion.signals import Array, JointMotion


@dataclass(frozen=True, eq=False)
class RandomTrajectory:
    """Distribution of random trajectories, with bounds of Fourier coefficients and centre.

    Parameters
    ----------
    bias : (n,) centre of the motion [rad].
    bias_spread : (n,) or scalar, largest random offset of the centre [rad].
    amplitude : largest coefficient [rad].
    fundamental : frequency f0 [Hz].
    harmonics : number of harmonics N.

    Raises
    ------
    ExcitationError
        If a value is out of range.
    """

    bias: Array
    bias_spread: Array | float = 0.1
    amplitude: float = 0.35
    fundamental: float = 0.1
    harmonics: int = 5

    def __post_init__(self) -> None:
        if not (np.isfinite(self.amplitude) and self.amplitude > 0.0):
            raise ExcitationError(f'amplitude must be positive, got {self.amplitude} rad')
        if self.harmonics < 1 or self.harmonics != int(self.harmonics):
            raise ExcitationError(f'at least one harmonic is needed, not {self.harmonics}')
        if not (np.isfinite(self.fundamental) and self.fundamental > 0.0):
            raise ExcitationError(f'fundamental must be positive, got {self.fundamental} Hz')

    def draw(self, generator: np.random.Generator) -> FourierTrajectory:
        """Return a random trajectory, drawn with `generator`."""
        n = len(self.bias)
        spread = generator.uniform(-self.bias_spread, self.bias_spread, n)
        alpha, beta = generator.uniform(-self.amplitude, self.amplitude, (2, n, self.harmonics))
        return FourierTrajectory(self.fundamental, self.bias + spread, alpha, beta)

    def draw_feasible(
        self,
        seed: int,
        checker: FeasibilityChecker,
        ramp_time: float,
        attempts: int = 500,
        stop: Callable[[], bool] = lambda: False,
    ) -> tuple[FourierTrajectory, FeasibilityReport]:
        """Draw random trajectories from a seed, and return the first feasible one.

        Parameters
        ----------
        seed : random seed; equal seeds and limits give equal trajectories.
        checker : feasibility checker, applied to a whole period with run-in and run-out.
        ramp_time : duration of run-in and run-out [s].
        attempts : largest number of random trajectories.
        stop : function called before each attempt; True ends the search.

        Raises
        ------
        NothingDrawnError
            If no trajectory is feasible; the message names the limit most often violated.
        DesignStoppedError
            If `stop` returned True.
        """
        generator = np.random.default_rng(seed)
        broken: list[LimitMargin] = []
        for _ in range(attempts):
            if stop():
                raise DesignStoppedError(
                    'the design was stopped before a feasible random trajectory was found'
                )
            trajectory = self.draw(generator)
            report = checker.check_trajectory(trajectory, ramp_time, stop_early=True)
            if report.feasible:
                return trajectory, report
            broken.append(report.binding)
        raise self._error(broken, seed)

    def _error(self, broken: list[LimitMargin], seed: int) -> NothingDrawnError:
        (limit, subject), count = Counter((m.limit, m.subject) for m in broken).most_common(1)[0]
        best = max(
            (m for m in broken if (m.limit, m.subject) == (limit, subject)),
            key=lambda margin: margin.relative,
        )
        binding = (
            f'{limit} of {subject} exceeds its limit in {100 * count / len(broken):.0f} % of the '
            f'random trajectories (best value {best.reached:.4g} {best.unit}, limit '
            f'{best.allowed:.4g} '
            f'{best.unit})'
        )
        return NothingDrawnError(
            f'none of {len(broken)} random trajectories (seed {seed}) is feasible; {binding}. '
            f'Lower the amplitude ({self.amplitude:g} rad) or the fundamental '
            f'({self.fundamental:g} Hz), or check this limit and the bias',
            binding,
        )


APPROACH, EXCITATION, RETURN = 'approach', 'excitation', 'return'

Slowdown = Callable[[JointMotion], float]
"""Type of a function that returns the factor (1 or more) by which to slow a motion down."""


class ExcitationPlanner:
    """Planner and checker of complete motions: to a trajectory, along the trajectory, and back.

    Parameters
    ----------
    checker : limits of the excitation.
    transfer_checker : limits of approach and return. Approach and return may use the joints' full
        position range, because the initial posture may be outside the range of an excitation.
    ramp_time : duration of run-in and run-out along the trajectory [s].
    transfer_share : fraction of the velocity and acceleration limits of `transfer_checker` that
        approach and return use.
    """

    SHORTEST_TRANSFER = 1.0
    """Shortest duration of a transfer between postures [s]."""
    _SLOWED = 1.001  # factor at which a trajectory counts as slow enough

    def __init__(
        self,
        checker: FeasibilityChecker,
        transfer_checker: FeasibilityChecker,
        ramp_time: float = 2.0,
        transfer_share: float = 0.3,
    ) -> None:
        self._checker = checker
        self._transfer_checker = transfer_checker
        self._ramp_time = ramp_time
        limits = transfer_checker.limits
        # A robot without acceleration limits also needs a finite duration.
        self._velocity = transfer_share * np.minimum(limits.velocity, 10.0)
        self._acceleration = transfer_share * np.minimum(limits.acceleration, 10.0)

    def slowed(
        self, trajectory: FourierTrajectory, periods: int, slowdown: Slowdown
    ) -> FourierTrajectory:
        """Return a trajectory of the same shape, slowed down as far as `slowdown` requires."""
        while (factor := slowdown(self._excitation(trajectory, periods))) > self._SLOWED:
            trajectory = trajectory.slowed(factor)
        return trajectory

    def plan(
        self,
        trajectory: FourierTrajectory,
        periods: int,
        start: Array,
        go_back: bool = True,
        slowdown: Slowdown = lambda _: 1.0,
    ) -> MotionSequence:
        """Return a motion from rest at `start` through `periods` periods of the trajectory to rest.

        Parameters
        ----------
        trajectory : trajectory to play.
        periods : number of periods, a positive integer.
        start : (n,) present posture [rad].
        go_back : whether to end at `start` instead of the end of the run-out.
        slowdown : factor by which the duration of approach and return must grow; for the
            excitation see `slowed`.

        Raises
        ------
        InfeasibleError
            If the trajectory, the start posture or every path between them violates a limit.
        """
        self._checker.check_trajectory(trajectory, self._ramp_time, stop_early=True).require(
            'the trajectory'
        )
        self._transfer_checker.check(standstill(start)).require('the start posture')
        excitation = self._excitation(trajectory, periods)
        first = excitation.evaluate(0.0).q
        last = excitation.evaluate(excitation.duration).q
        stages = self._transfer(APPROACH, (start, first, trajectory.q0), slowdown)
        stages.append(Stage(EXCITATION, excitation))
        if go_back:
            stages += self._transfer(RETURN, (last, start, trajectory.q0), slowdown)
        return MotionSequence(stages)

    def _excitation(self, trajectory: FourierTrajectory, periods: int) -> RampedExcitation:
        return RampedExcitation(trajectory, periods, self._ramp_time)

    def _transfer(
        self, name: str, postures: tuple[Array, Array, Array], slowdown: Slowdown
    ) -> list[Stage]:
        """Return the first feasible candidate path between the first two postures of `postures`.

        The third posture is the centre, through which one candidate leads.
        """
        closest = None
        for way in _ways(*postures):
            stages = self._stages(name, way, slowdown)
            report = self._transfer_checker.check(MotionSequence(stages), stop_early=True)
            if report.feasible:
                return stages
            closest = closest or report.binding
        raise InfeasibleError(
            f'no feasible path was found for the {name} (direct path: {closest}): move the arm to '
            'another posture first'
        )

    def _stages(self, name: str, way: Sequence[Array], slowdown: Slowdown) -> list[Stage]:
        stages = []
        for leg, (a, b) in enumerate(pairwise(way)):
            duration = rest_to_rest_duration(
                b - a, self._velocity, self._acceleration, self.SHORTEST_TRANSFER
            )
            way_there = transfer(a, b, duration * slowdown(transfer(a, b, duration)))
            stages.append(Stage(name if leg == 0 else f'{name} {leg + 1}', way_there))
        return stages


def _ways(start: Array, end: Array, centre: Array) -> Iterator[list[Array]]:
    """Yield candidate paths as lists of postures: direct, through `centre`, joint by joint."""
    yield [start, end]
    yield [start, centre, end]
    for order in (range(len(start)), reversed(range(len(start)))):
        way, posture = [start], start
        for joint in order:
            posture = posture.copy()
            posture[joint] = end[joint]
            way.append(posture)
        yield way


@dataclass(frozen=True, eq=False)
class ExcitationSetup:
    """Robot model, limits and feasibility checker of one arm, for design and planning.

    A setup can be sent to another process, which builds its own checker.

    Parameters
    ----------
    robot : robot model of the arm.
    config : usable fractions of the limits, and surroundings of the arm.
    limits : full limits of the arm, of which excitations use a fraction.
    rotor_inertia : (n,) inertia reflected to the joints [kg m^2].
    torque_per_ampere : (n,) joint torque per motor current [Nm/A], infinite if unknown.
    package_directories : folders for `package://` meshes.
    """

    robot: Robot
    config: ExcitationConfig
    limits: MotionLimits
    rotor_inertia: Array
    torque_per_ampere: Array
    package_directories: tuple[Path, ...] = ()

    @classmethod
    def of_arm(
        cls,
        robot: Robot,
        arm: ArmConfig,
        config: ExcitationConfig,
        package_directories: Sequence[Path] = (),
    ) -> ExcitationSetup:
        """Return the setup of an arm, with limits from its drive train configuration."""
        return cls(
            robot,
            config,
            MotionLimits.of_arm(arm),
            arm.column('reflected_inertia'),
            arm.column('torque_per_ampere'),
            tuple(package_directories),
        )

    @classmethod
    def of_robot(
        cls,
        robot: Robot,
        config: ExcitationConfig,
        package_directories: Sequence[Path] = (),
        acceleration_limit: ArrayLike = np.inf,
    ) -> ExcitationSetup:
        """Return the setup of any arm, with limits from its URDF and without rotor inertia.

        Parameters
        ----------
        robot, config, package_directories : see the class.
        acceleration_limit : largest acceleration [rad/s^2], one for all joints or (n,).

        Raises
        ------
        ExcitationError
            If the number of values is neither one nor n, or a value is not positive.
        """
        limits = MotionLimits.of_robot(robot, acceleration_limit)
        folders, unknown = tuple(package_directories), np.full(robot.n, np.inf)
        return cls(robot, config, limits, np.zeros(robot.n), unknown, folders)

    @cached_property
    def usable_limits(self) -> MotionLimits:
        """Position, velocity, acceleration and torque limits that an excitation must keep."""
        config = self.config
        return self.limits.scaled(config.position_share, config.velocity_share, config.effort_share)

    @cached_property
    def effort_model(self) -> EffortModel:
        """Model of joint torques and motor currents with the arm's nominal parameters."""
        return EffortModel(self.robot, self.rotor_inertia, self.torque_per_ampere)

    @cached_property
    def clearance(self) -> ClearanceChecker | None:
        """Checker of distances between links, and between links and ground; None without a check.

        Building the checker raises ExcitationError without collision shapes.
        """
        if not self.config.check_clearance:
            return None
        return ClearanceChecker(
            self.robot,
            self.config.self_clearance,
            self.config.ground_clearance,
            self.config.ground_height,
            self.package_directories,
            self.config.unchecked_pairs,
        )

    @cached_property
    def stops(self) -> StopLimits:
        """Limits of acceleration, torque and current while the arm stops along a motion."""
        return StopLimits(self.limits, self.effort_model)

    @cached_property
    def checker(self) -> FeasibilityChecker:
        """Feasibility checker with the limits that an excitation may use."""
        return FeasibilityChecker(
            self.usable_limits,
            self.clearance,
            self.effort_model,
            self.config.highest_frequency,
            stops=self.stops,
        )

    @cached_property
    def planner(self) -> ExcitationPlanner:
        """Planner of motions from any posture through an excitation, and back to that posture."""
        transfers = FeasibilityChecker(
            self.limits, self.clearance, self.effort_model, stops=self.stops
        )
        return ExcitationPlanner(
            self.checker, transfers, self.config.ramp_time, self.config.transfer_share
        )

    def random_trajectory(
        self, amplitude: float, fundamental: float, harmonics: int
    ) -> RandomTrajectory:
        """Return the distribution of random trajectories about the configured centre.

        Parameters
        ----------
        amplitude : largest coefficient [rad].
        fundamental : frequency f0 [Hz].
        harmonics : number of harmonics N.
        """
        return RandomTrajectory(
            self.config.bias_of(self.robot),
            self.config.bias_spread_of(self.robot),
            amplitude,
            fundamental,
            harmonics,
        )

    def require_bias(self) -> None:
        """Check that resting at the centre `bias` of the configuration violates no limit.

        Nothing is checked without a configured centre, because random trajectories then have
        different centres.

        Raises
        ------
        ConfigError
            If the centre does not have one finite value per joint.
        InfeasibleError
            If the arm may not rest at the centre; the message names the violated limit.
        """
        centre = self.config.bias_of(self.robot)
        if self.config.bias is not None:
            report = self.checker.check(standstill(centre))
            report.require('the centre of the motion (bias)')

    def __getstate__(self) -> dict[str, Any]:
        # Collision geometry and solver data cannot be sent to another process, which builds its
        # own when needed.
        return {field.name: getattr(self, field.name) for field in fields(self)}
