"""Feasibility of a motion: margins to limits of position, speed, acceleration and torque."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance import Clearance, ClearanceChecker
from aerarm_ros.excitation.settings import InfeasibleError, MotionLimits
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.regressor import viscous_coulomb
from aerarm_ros.motion.path_stop import Row, acceleration_rows
from aerarm_ros.motion.signals import Array, JointMotion, JointReference


class EffortModel:
    """Model of joint torques and motor currents, thesis (2.18), with rotors and friction.

    Parameters
    ----------
    robot : arm with prior inertial parameters and friction.
    rotor_inertia : (n,) or scalar, inertia reflected to the joints [kg m^2].
    torque_per_ampere : (n,) or scalar, joint torque per motor current [Nm/A]; infinite if unknown.
    load_friction : dry friction per torque transmitted by the gear [-]; None uses the value of
        `robot`.
    """

    def __init__(
        self,
        robot: Robot,
        rotor_inertia: ArrayLike = 0.0,
        torque_per_ampere: ArrayLike = np.inf,
        load_friction: ArrayLike | None = None,
    ) -> None:
        self._n = robot.n
        self._dynamics = Dynamics(robot, np.broadcast_to(rotor_inertia, robot.n))
        self._viscous, self._coulomb = robot.viscous, robot.coulomb
        self._load_friction = np.asarray(
            robot.load_friction if load_friction is None else load_friction
        )
        self._torque_per_ampere: Array = np.asarray(torque_per_ampere, dtype=float)

    def carry(self, payload: ArrayLike) -> None:
        """Add a payload to the last link of the model, see `Dynamics.carry`."""
        self._dynamics.carry(payload)

    def effort(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        """Return the joint torques (M, n) [Nm] of a motion with M states."""
        inverse = self._dynamics.inverse
        rigid = np.array(
            [inverse(*sample) for sample in zip(position, velocity, acceleration, strict=True)]
        ).reshape(-1, self._n)
        # The torque that accelerates the rotors is not transmitted by the gears.
        load = rigid - self._dynamics.rotor_inertia * acceleration
        dry = self._coulomb + self._load_friction * np.abs(load)
        return rigid + viscous_coulomb(velocity, self._viscous, dry)

    def current(self, effort: Array) -> Array:
        """Return the motor currents [A] that produce joint torques [Nm], thesis (4.2) and (4.7)."""
        return np.asarray(effort / self._torque_per_ampere)

    def torque(self, current: Array) -> Array:
        """Return the joint torques [Nm] that motor currents [A] produce, without gear friction."""
        return np.asarray(current * self._torque_per_ampere)


@dataclass(frozen=True)
class LimitMargin:
    """Margin between a motion and one limit of one joint or pair of links.

    Parameters
    ----------
    limit : name of the limit, for example 'velocity' or 'ground clearance'.
    subject : joint or pair of links.
    reached, allowed : extreme value during the motion, and its limit, in `unit`.
    unit : unit of `reached`, `allowed`, `margin` and `scale`.
    time : time of the extreme value [s].
    scale : margin that counts as 1, to compare different limits.
    is_lower : whether `allowed` is the smallest allowed value instead of the largest.
    """

    limit: str
    subject: str
    reached: float
    allowed: float
    unit: str
    time: float
    scale: float
    is_lower: bool = False

    @property
    def margin(self) -> float:
        """Distance to the limit in `unit`, negative if violated."""
        rest = self.allowed - self.reached
        return -rest if self.is_lower else rest

    @property
    def relative(self) -> float:
        """Margin as a fraction of `scale`."""
        return self.margin / self.scale

    def __str__(self) -> str:
        return (
            f'{self.limit} of {self.subject}: {self.reached:.4g} {self.unit} at '
            f't = {self.time:.2f} s, limit {self.allowed:.4g} {self.unit}'
        )


def peak_margins(
    limit: str, unit: str, names: Sequence[str], times: Array, values: Array, allowed: Array
) -> list[LimitMargin]:
    """Return the margin of each joint's largest absolute value to its limit, if finite.

    Parameters
    ----------
    limit, unit : as in `LimitMargin`.
    names : names of the n joints.
    times : (M,) times of the values [s].
    values : (M, n) values to check.
    allowed : (n,) positive limits.
    """
    size = np.abs(values)
    peaks = zip(names, allowed.tolist(), size.argmax(axis=0), size.T, strict=True)
    return [
        LimitMargin(limit, name, float(own[k]), bound, unit, float(times[k]), bound)
        for name, bound, k, own in peaks
        if np.isfinite(bound)
    ]


@dataclass(frozen=True)
class FeasibilityReport:
    """Margins of a motion to every checked limit.

    Parameters
    ----------
    margins : one margin per limit and subject.
    notes : texts on checks that were skipped or relaxed.
    """

    margins: Sequence[LimitMargin]
    notes: Sequence[str] = ()

    _ROUNDING = 1e-9

    @property
    def feasible(self) -> bool:
        """Whether the motion satisfies all checked limits."""
        return all(margin.margin >= -self._ROUNDING for margin in self.margins)

    @property
    def binding(self) -> LimitMargin:
        """Margin of the motion that is smallest relative to the limit."""
        return min(self.margins, key=lambda margin: margin.relative)

    def worst_of_each(self) -> list[LimitMargin]:
        """Return the smallest margin to each kind of limit, over all joints and pairs of links."""
        worst: dict[str, LimitMargin] = {}
        for margin in self.margins:
            if margin.limit not in worst or margin.relative < worst[margin.limit].relative:
                worst[margin.limit] = margin
        return list(worst.values())

    def require(self, what: str) -> None:
        """Raise InfeasibleError unless the motion satisfies all limits.

        Raises
        ------
        InfeasibleError
            If a limit is violated; the message names the motion (`what`) and the limit.
        """
        if not self.feasible:
            raise InfeasibleError(f'{what} is infeasible: {self.binding}')

    def as_table(self) -> str:
        """Return a text with the smallest margin to each kind of limit, followed by the notes."""
        rows = [
            f'  {m.limit:<17} {m.subject:<24} {m.reached:9.4g} of {m.allowed:9.4g} {m.unit:<8}'
            f' margin {m.margin:9.4g}'
            for m in self.worst_of_each()
        ]
        rows += [f'  note: {note}' for note in self.notes]
        return '\n'.join(rows)


def effort_margins(
    names: tuple[str, str],
    limits: MotionLimits,
    model: EffortModel,
    times: Array,
    states: JointReference,
) -> list[LimitMargin]:
    """Return the margins of a motion's joint torques and motor currents to their limits.

    Parameters
    ----------
    names : names of the torque limit and of the current limit.
    limits : limits of the joints.
    model : torque model with nominal parameters.
    times : (M,) times of the states [s].
    states : (M, n) states.
    """
    effort = model.effort(*states)
    current = model.current(effort)
    joints, (torque_name, current_name) = limits.joint_names, names
    return [
        *peak_margins(torque_name, 'Nm', joints, times, effort, limits.effort),
        *peak_margins(current_name, 'A', joints, times, current, limits.current),
    ]


# If the motion on the path requires almost all of a torque limit, a stop may still brake with
# this fraction of the motion's torque in addition, so that every stop ends.
_LEFT = 0.1


class StopLimits:
    """Limits of acceleration, torque and motor current while the arm stops along a motion.

    A stop (see `stop_along`) keeps the arm on the path of the motion, so all postures are those
    of the motion, and no joint becomes faster. Because stops are rare, a stop may use the full
    limits, and not only the fraction that an excitation may use. Between full speed and rest the
    torque lies between the torque of the motion, which the feasibility checker checks, and the
    torque at rest, which `margins` checks.

    Parameters
    ----------
    limits : full limits of the arm.
    effort_model : torque model with nominal parameters; None ignores torque and current.
    """

    _RESTS = 0.02
    """Time between two postures of the motion in which holding at rest is checked [s]."""

    def __init__(self, limits: MotionLimits, effort_model: EffortModel | None) -> None:
        self.limits = limits
        self._effort_model = effort_model
        self._acceleration_rows = acceleration_rows(limits.acceleration)
        self._effort = limits.effort
        if effort_model is not None:
            self._effort = np.minimum(limits.effort, effort_model.torque(limits.current))

    def rows(self, point: JointReference) -> Iterable[Row]:
        """Return acceleration, torque and current limits at a posture (n,), for `stop_along`."""
        rows = [*self._acceleration_rows(point)]
        if self._effort_model is not None:
            rows += self._effort_rows(self._effort_model, point)
        return rows

    def margins(self, motion: JointMotion) -> list[LimitMargin]:
        """Return the torque and current margins for holding the arm in any posture of `motion`."""
        if self._effort_model is None:
            return []
        times = np.append(np.arange(0.0, motion.duration, self._RESTS), motion.duration)
        rest = JointReference.at_rest(motion.evaluate(times).q)
        what = ('holding torque', 'holding current')
        return effort_margins(what, self.limits, self._effort_model, times, rest)

    def inertial_torque(self, q: Array, ddq: Array) -> Array | None:
        """Return the torque [Nm] that an acceleration needs, cut to limits; None without a model.

        All arrays are (n,).
        """
        if self._effort_model is None:
            return None
        zero = np.zeros_like(q)
        moved, still = self._effort_model.effort(
            np.array([q, q]), np.array([zero, zero]), np.array([ddq, zero])
        )
        torque: Array = np.clip(moved - still, -self.limits.effort, self.limits.effort)
        return torque

    def _effort_rows(self, model: EffortModel, point: JointReference) -> Iterable[Row]:
        """Return the constraints of `stop_along` on the torque and the current of each joint.

        Friction is assumed to fall with the squared speed during the stop. Real friction falls
        less, so a braking motor needs less torque than computed.
        """
        zero = np.zeros_like(point.q)
        still, pulled, moved = model.effort(
            np.array([point.q, point.q, point.q]),
            np.array([zero, zero, point.dq]),
            np.array([zero, point.dq, point.ddq]),
        )
        own: Array = np.maximum(np.abs(still), np.abs(moved))
        limit = np.maximum(self._effort, (1.0 + _LEFT) * own)
        columns = (pulled - still, moved - still, still, limit)
        return zip(*(column.tolist() for column in columns), strict=True)


_UNCHECKED = ('collisions are not checked: the arm may touch itself, its base or the ground',)


class FeasibilityChecker:
    """Checks of motions against joint limits, torque, motor current and clearance.

    A motion is evaluated at every control cycle, so every command is checked. Between two cycles
    a joint's position exceeds the positions at both cycles by at most ddq_max cycle^2 / 8 (2e-6
    rad at 15 rad/s^2 and 1 kHz), which is negligible. Clearance is checked between cycles as
    well.

    Parameters
    ----------
    limits : limits of the joints.
    clearance : distances to keep; None skips collision checks.
    effort_model : torque model with nominal parameters; None skips the torque and current checks.
    highest_frequency : largest allowed frequency of a harmonic [Hz], below resonances of the arm.
    stops : limits of a stop, used to check that the arm may rest at any point of the motion; None
        skips this check.
    """

    CYCLE = 1e-3
    """Control cycle [s]."""
    _GLANCE = 25
    """Number of control cycles between samples in the coarse check, which comes first."""

    def __init__(
        self,
        limits: MotionLimits,
        clearance: ClearanceChecker | None = None,
        effort_model: EffortModel | None = None,
        highest_frequency: float = 2.0,
        stops: StopLimits | None = None,
    ) -> None:
        self.highest_frequency = highest_frequency
        self.limits = limits
        self.clearance = clearance
        self.effort_model = effort_model
        self._stops = stops

    def check_trajectory(
        self, trajectory: FourierTrajectory, ramp_time: float, stop_early: bool = False
    ) -> FeasibilityReport:
        """Return the margins of one period of a trajectory with run-in and run-out.

        Further periods repeat the same postures, so one period suffices. Parameters as in `check`;
        `ramp_time` [s] as in `RampedExcitation`.
        """
        reached, allowed = trajectory.highest_frequency, self.highest_frequency
        what = ('frequency', 'highest harmonic')
        harmonic = LimitMargin(*what, reached, allowed, 'Hz', 0.0, allowed)
        if stop_early and not FeasibilityReport([harmonic]).feasible:
            return FeasibilityReport([harmonic])
        report = self.check(RampedExcitation(trajectory, 1, ramp_time), stop_early)
        return FeasibilityReport([harmonic, *report.margins], report.notes)

    def check(self, motion: JointMotion, stop_early: bool = False) -> FeasibilityReport:
        """Return the margins of `motion` to all limits.

        Parameters
        ----------
        motion : motion to check, from 0 to its duration.
        stop_early : whether to check a few samples first, and to skip the rest after a violation.
        """
        cycles = int(np.ceil(motion.duration / self.CYCLE))
        times = np.linspace(0.0, motion.duration, cycles + 1)
        if stop_early:
            coarse = times[:: self._GLANCE]
            glance = FeasibilityReport(self._joint_margins(coarse, motion.evaluate(coarse)))
            if not glance.feasible:
                return glance
        states = motion.evaluate(times)
        near: list[LimitMargin] = []
        if self.clearance is not None:
            found = self.clearance.sweep(states.q, stop_below=stop_early)
            near = [_clearance_margin(kind, c, times) for kind, c in found.items()]
        if stop_early and not FeasibilityReport(near).feasible:
            return FeasibilityReport(near)
        margins = [*self._joint_margins(times, states), *near]
        if self._stops is not None:
            margins += self._stops.margins(motion)
        return FeasibilityReport(margins, self.clearance.notes if self.clearance else _UNCHECKED)

    def _joint_margins(self, times: Array, states: JointReference) -> list[LimitMargin]:
        position, velocity, acceleration = states
        margins = self._position_margins(times, position)
        names, limits = self.limits.joint_names, self.limits
        margins += peak_margins('velocity', 'rad/s', names, times, velocity, limits.velocity)
        margins += peak_margins(
            'acceleration', 'rad/s^2', names, times, acceleration, limits.acceleration
        )
        if self.effort_model is not None:
            what = ('torque', 'motor current')
            margins += effort_margins(what, limits, self.effort_model, times, states)
        return margins

    def _position_margins(self, times: Array, position: Array) -> list[LimitMargin]:
        low, high = self.limits.position_min, self.limits.position_max
        # Position margins are relative to half the range, the largest possible margin.
        half = 0.5 * np.minimum(high - low, 2.0 * np.pi)
        ends = (position.argmin(axis=0), low, True), (position.argmax(axis=0), high, False)
        return [
            LimitMargin('position', name, float(position[k[j], j]), float(bound[j]), 'rad',
                        float(times[k[j]]), float(half[j]), is_lower)
            for j, name in enumerate(self.limits.joint_names)
            for k, bound, is_lower in ends
            if np.isfinite(bound[j])
        ]  # fmt: skip


def _clearance_margin(kind: str, found: Clearance, times: Array) -> LimitMargin:
    # Clearance margins are relative to 0.1 m, a distance at which an arm of this size counts as
    # free.
    time, bounds = float(times[found.sample]), (found.guaranteed, found.required)
    return LimitMargin(f'{kind} clearance', found.subject, *bounds, 'm', time, 0.1, is_lower=True)
