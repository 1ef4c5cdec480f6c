"""Motion for a motor bench: velocity steps, acceleration runs and oscillations of each joint."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.feasibility import FeasibilityChecker
from aerarm_ros.excitation.settings import ExcitationError, MotionLimits
from aerarm_ros.excitation.trajectory import (
    FourierTrajectory,
    MotionSequence,
    RampedExcitation,
    Stage,
    SteadyStroke,
    transfer,
)
from aerarm_ros.motion.polynomial_path import rest_to_rest_duration
from aerarm_ros.motion.signals import Array, JointMotion


@dataclass(frozen=True)
class BenchMeasurement:
    """Evaluated section of a bench motion, in which one joint moves and all other joints rest.

    Attributes
    ----------
    joint : int
        Index of the moving joint.
    speed : float or None
        Commanded velocity [rad/s], signed; None for acceleration runs and oscillations.
    start, end : float
        Start and end time of the section [s].
    swings : bool
        Whether the joint oscillates about the posture, to measure backlash.
    """

    joint: int
    speed: float | None
    start: float
    end: float
    swings: bool = False


def split(
    measurements: Sequence[BenchMeasurement], path_time: Array
) -> Iterator[tuple[BenchMeasurement, slice]]:
    """Yield each measurement with its rows among the samples at `path_time` (M,) [s]."""
    for measurement in measurements:
        first, last = np.searchsorted(path_time, (measurement.start, measurement.end))
        yield measurement, slice(int(first), int(last))


@dataclass(frozen=True)
class BenchPlan:
    """Speeds, travels and numbers of repetitions of the motions in a motor bench run.

    Parameters
    ----------
    speeds : positive joint speeds of the velocity steps [rad/s].
    span : travel of a joint during velocity steps and acceleration runs, centred at the posture
        [rad].
    acceleration_share : fraction of the acceleration limits used by acceleration runs and by the
        ramps of velocity steps.
    runs : number of acceleration runs per joint, each in both directions; 0 for none.
    swings : number of sine oscillations per joint about the posture, to measure backlash; 0 for
        none.
    amplitude : amplitude of the oscillations [rad]; the oscillations are as fast as the usable
        fractions of the limits allow.

    Raises
    ------
    ExcitationError
        If a value is invalid.
    """

    speeds: tuple[float, ...] = (0.2, 0.4, 0.8, 1.2, 1.6, 2.0)
    span: float = 1.6
    acceleration_share: float = 0.5
    runs: int = 3
    swings: int = 0
    amplitude: float = 0.25

    def __post_init__(self) -> None:
        if len(set(self.speeds)) < 2 or min(self.speeds) <= 0.0:
            raise ExcitationError(
                f'speeds {list(self.speeds)} must contain two or more different positive values, '
                'to separate viscous from Coulomb friction (4.13)'
            )
        if not 0.0 < self.span < 2.0 * np.pi:
            raise ExcitationError(f'span {self.span:g} must lie between 0 and 2 pi rad')
        if self.swings and not 0.0 < self.amplitude <= 0.5 * self.span:
            raise ExcitationError(
                f'swing amplitude {self.amplitude:g} rad must be above 0 and at most half of the '
                f'span of {self.span:g} rad'
            )


# fraction of the velocity and acceleration limits used by motions between measurements
_TRANSFER_SHARE = 0.2
_SHORTEST_TRANSFER = 0.5  # [s]
_VELOCITY_SHARE = 0.6  # fraction of the velocity limits used by acceleration runs and oscillations
# [s] time at constant speed before a measurement, in which the velocity loop settles
_SETTLE = 0.1
_SHORTEST_STEADY = 0.15  # [s] shortest measurement at constant speed
_REST = 0.2  # [s] rest between two strokes


class BenchMotion:
    """Motion of all joints on a motor bench, with the sections that are evaluated.

    Each joint in turn performs its strokes while all others hold the posture. The joint passes
    the same positions in both directions, so gravity cancels in the difference of the torques.

    Parameters
    ----------
    plan : speeds, acceleration runs and oscillations to perform.
    limits : limits of the joints.
    start : (n,) posture at the beginning and the end [rad].
    posture : (n,) posture of the measurements [rad].
    joints : indices of the joints to measure.

    Raises
    ------
    ExcitationError
        If a joint's limits leave no travel, or a speed is too high to be constant for long enough.
    """

    def __init__(
        self,
        plan: BenchPlan,
        limits: MotionLimits,
        start: Array,
        posture: Array,
        joints: Sequence[int],
    ) -> None:
        self._plan = plan
        self._limits = limits
        self._posture = np.array(posture, dtype=float)
        self._stages: list[Stage] = []
        self._time = 0.0
        self._at = np.array(start, dtype=float)
        self.measurements: list[BenchMeasurement] = []
        for joint in joints:
            self._check(joint)
            self._measure(joint)
        self._move(start)
        self.sequence = MotionSequence(self._stages)

    def require_feasible(self, checker: FeasibilityChecker) -> None:
        """Raise InfeasibleError if the bench motion violates a limit."""
        checker.check(self.sequence, stop_early=True).require('the motion of the motor bench')

    def _check(self, joint: int) -> None:
        limits, plan = self._limits, self._plan
        name, middle = limits.joint_names[joint], self._posture[joint]
        free = 2.0 * min(middle - limits.position_min[joint], limits.position_max[joint] - middle)
        if free < plan.span:
            raise ExcitationError(
                f'{name} can move {max(free, 0.0):.3g} rad about {middle:.3g} rad, less than '
                'the '
                f'span of {plan.span:.3g} rad: choose a smaller span or another posture'
            )
        if max(plan.speeds) > limits.velocity[joint]:
            raise ExcitationError(
                f'the velocity limit of {name} is {limits.velocity[joint]:.3g} rad/s, below the '
                f'largest speed of {max(plan.speeds):.3g} rad/s: choose lower speeds'
            )

    def _measure(self, joint: int) -> None:
        plan, name = self._plan, self._limits.joint_names[joint]
        half = np.zeros(len(self._posture))
        half[joint] = 0.5 * plan.span
        self._move(self._posture - half)
        for speed in sorted(set(plan.speeds)):
            for travel in (plan.span, -plan.span):
                self._stroke(joint, travel, speed, name)
        begin = self._time
        for _ in range(plan.runs):
            for end in (self._posture + half, self._posture - half):
                self._move(
                    end, f'{name} acceleration', _VELOCITY_SHARE, plan.acceleration_share, 0.1
                )
        if plan.runs:
            self.measurements.append(BenchMeasurement(joint, None, begin, self._time))
        if plan.swings:
            self._swing(joint, name)

    def _stroke(self, joint: int, travel: float, speed: float, name: str) -> None:
        acceleration = self._plan.acceleration_share * float(self._limits.acceleration[joint])
        try:
            stroke = SteadyStroke(self._at, joint, travel, speed, acceleration)
        except ExcitationError as error:
            raise ExcitationError(f'{name}: {error}: choose a larger span') from None
        steady = stroke.steady_time - _SETTLE
        if steady < _SHORTEST_STEADY:
            raise ExcitationError(
                f'{name} runs at {speed:.3g} rad/s for only {stroke.steady_time:.2f} s, less '
                f'than {_SETTLE + _SHORTEST_STEADY:g} s: choose a larger span or lower speeds'
            )
        begin = self._time + stroke.ramp_time + _SETTLE
        signed = float(np.copysign(speed, travel))
        self.measurements.append(BenchMeasurement(joint, signed, begin, begin + steady))
        self._add(f'{name} {signed:+.2f} rad/s', stroke)
        self._add(name, transfer(self._at, self._at, _REST))

    def _swing(self, joint: int, name: str) -> None:
        plan, limits = self._plan, self._limits
        fastest = _VELOCITY_SHARE * limits.velocity[joint] / plan.amplitude
        hardest = plan.acceleration_share * limits.acceleration[joint] / plan.amplitude
        frequency = float(min(fastest, np.sqrt(hardest))) / (2.0 * np.pi)
        sine = np.zeros((len(self._posture), 1))
        sine[joint] = plan.amplitude
        wave = FourierTrajectory(frequency, self._posture, sine, np.zeros_like(sine))
        swings = RampedExcitation(wave, plan.swings, wave.period)
        self._move(swings.evaluate(0.0).q)
        begin = self._time + swings.ramp_time
        self.measurements.append(
            BenchMeasurement(joint, None, begin, begin + swings.periodic_duration, swings=True)
        )
        self._add(f'{name} swings', swings)

    def _move(
        self,
        end: Array,
        name: str = 'transfer',
        velocity_share: float = _TRANSFER_SHARE,
        acceleration_share: float = _TRANSFER_SHARE,
        shortest: float = _SHORTEST_TRANSFER,
    ) -> None:
        """Append a motion to the posture `end` with shares of the limits."""
        limits = self._limits
        velocity, acceleration = velocity_share * limits.velocity, limits.acceleration
        duration = rest_to_rest_duration(
            end - self._at, velocity, acceleration_share * acceleration, shortest
        )
        self._add(name, transfer(self._at, end, duration))

    def _add(self, name: str, motion: JointMotion) -> None:
        self._stages.append(Stage(name, motion))
        self._time += motion.duration
        # Use the actual end posture, so that rounding errors do not accumulate.
        self._at = np.array(motion.evaluate(motion.duration).q)


def bench_checker(setup: ExcitationSetup, mounted: bool) -> FeasibilityChecker:
    """Return the checker that compares a bench motion with the limits of the arm.

    Parameters
    ----------
    setup : setup of the arm.
    mounted : False for motors outside the arm, which carry no load and cannot collide.
    """
    limits = setup.limits
    if not mounted:
        return FeasibilityChecker(limits)
    return FeasibilityChecker(limits, setup.clearance, setup.effort_model, stops=setup.stops)
