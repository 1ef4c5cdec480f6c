"""Tool reference in the world: set points, timed paths, stops, and jumps of the odometry."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks import RejectedInputError, checked_vector, positive
from aerarm_ros.control.laws.kinematic_control import DampedInverse
from aerarm_ros.control.references.joint_trajectory import Rows, checked_rows, checked_times, slopes
from aerarm_ros.control.references.target_follower import TargetFollower
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array, JointReference, TaskReference
from aerarm_ros.world.base_pose import BasePose, BasePoseEstimator
from aerarm_ros.world.rotor_governor import RotorGovernor
from aerarm_ros.world.tool_force import ToolForce
from aerarm_ros.world.world_law import WorldReference

_ORIGIN = np.zeros(3)
_PLACE_MAX = 1e4  # [m]; a target beyond this is in another unit
_LATEST, _EARLIEST = 1.0, 60.0  # [s] from now, bounds of a path's start
_OFF_TIME = 0.3  # [s] for which the tool may be off its target before the arm stops
_AT_REST = 1e-3  # [m/s]
_LOOK = 0.1  # [s] between two checks whether the target is reachable
_FIRST_STEP = 0.02  # [m] in which the tool must be able to move along a force
_RESUME = 0.5  # [s] without a problem before the motion continues


_STOPPED = WorldReference(_ORIGIN, _ORIGIN, _ORIGIN, None, None)


class WorldPath:
    """Tool path of quintics through points in the world; the tool rests at the end.

    Parameters
    ----------
    times : (M,) sequence
        Times of the points from the start [s], rising, the first not negative.
    places : (M, 3) sequence
        Points of the tool in the world [m].
    velocities, accelerations : (M, 3) sequences, optional
        Velocities [m/s] and accelerations [m/s^2] at the points; by default slopes between the
        neighbouring points, and zero at both ends.
    velocity_max, acceleration_max : float
        Limits of the tool [m/s], [m/s^2].

    Raises
    ------
    RejectedInputError
        If a number is missing or not finite, times do not rise, or the path is too fast.
    """

    def __init__(
        self,
        times: Sequence[float],
        places: Rows,
        velocities: Rows | None = None,
        accelerations: Rows | None = None,
        velocity_max: float = np.inf,
        acceleration_max: float = np.inf,
    ) -> None:
        what = 'tool path'
        t = checked_times(what, times)
        p = checked_rows(f'{what}: positions', places, len(t), 3)
        dp = checked_rows(f'{what}: velocities', velocities, len(t), 3)
        ddp = checked_rows(f'{what}: accelerations', accelerations, len(t), 3)
        if p is None or len(t) < 2:
            raise RejectedInputError(
                f'{what}: two points or more are needed, each with a time and a position'
            )
        dp = slopes(t, p) if dp is None else dp
        ddp = slopes(t, dp) if ddp is None else ddp
        if np.linalg.norm(dp[-1]) > _AT_REST:
            raise RejectedInputError(
                f'tool path: the last point has velocity {np.linalg.norm(dp[-1]):.2f} m/s '
                'instead of zero'
            )
        self._path = PolynomialPath.quintic(t - t[0], p, dp, ddp)
        self._begin = float(t[0])
        self.duration = float(t[-1])
        self.places = p
        samples = self._path.sample()
        fastest = float(np.linalg.norm(samples.dq, axis=1).max())
        hardest = float(np.linalg.norm(samples.ddq, axis=1).max())
        if fastest > velocity_max or hardest > acceleration_max:
            raise RejectedInputError(
                f'tool path: the path needs {fastest:.2f} m/s and {hardest:.1f} m/s^2 (limits '
                f'{velocity_max:g} and {acceleration_max:g}); give its points more time'
            )

    def at(self, time: float) -> TaskReference:
        """Return position, velocity and acceleration of the tool `time` [s] after the start."""
        return TaskReference(*self._path.evaluate(float(time - self._begin)))


class _Goal(NamedTuple):
    """Goal of the tool: a point, or a path with its start time [s]; and an orientation."""

    place: Array
    path: WorldPath | None
    begin: float
    rotation: Array | None

    def at(self, now: float) -> TaskReference:
        if self.path is None:
            return TaskReference(self.place, _ORIGIN, _ORIGIN)
        return self.path.at(now - self.begin)


class WorldToolReference:
    """Computes `WorldReference` from the user's targets and from the base's pose.

    The reference is the goal plus two offsets that decay to zero. The fast offset connects set
    points within the tool's limits of velocity and acceleration. The slow offset, at
    `recovery_speed`, moves the tool to its goal after a stop or a jump of the odometry. A jump of
    the odometry moves the goal but not the tool.

    During a problem (no valid odometry, an unreachable target) the reference has no base, so the
    arm stops in the base frame. After 0.5 s without a problem the tool continues toward its goal.
    An interrupted timed path ends where the tool stopped.

    Parameters
    ----------
    kinematics : Kinematics
        Kinematics of the tool frame that is held.
    followers : tuple of TargetFollower
        Filters that compute the fast offset and the slow offset.
    reach : callable
        Returns the largest distance [m] by which points (M, 3) in the base frame are out of reach,
        0 if none. The search starts at a posture (n,).
    error_max : float
        Largest error of the tool [m] before the arm stops.

    Attributes
    ----------
    force : ToolForce or None
        Set force along one direction; None if the arm cannot measure it.
    reason : str
        Reason why the tool is not held in the world; empty if it is held.
    stops : int
        Number of times that a problem stopped the arm in the base frame.
    error : float
        Distance of the tool from its reference [m].
    reference : WorldReference or None
        The last computed reference, None while the arm is stopped.
    """

    def __init__(
        self,
        base: BasePoseEstimator,
        kinematics: Kinematics,
        followers: tuple[TargetFollower, TargetFollower],
        reach: Callable[[Array, Array], float] = lambda places, q: 0.0,
        error_max: float = 0.05,
    ) -> None:
        self.base = base
        self._kinematics = kinematics
        self._quick, self._slow = followers
        self._reach = reach
        self._error_max = positive('error_max', error_max)
        self.force: ToolForce | None = None
        self.governor: RotorGovernor | None = None
        self.stops = 0
        self._q = np.zeros(kinematics.robot.n)
        self.take_over(self._q)

    def take_over(self, q: Array) -> None:
        """Start at the present posture and hold the tool at its present position."""
        self._goal: _Goal | None = None
        self.reference: WorldReference | None = None
        self._off_since: float | None = None
        self._wrong_at = self._looked = -np.inf
        # No target in the frame of an earlier odometry is left.
        self.base.accept_next()
        self._jumps, self._place = self.base.jumps, _ORIGIN  # of the tool, in the world
        self.reason = 'control has just started'
        self.error = 0.0
        self._q = q
        if self.force is not None:
            self.force.reset()

    # Targets.

    @property
    def goal(self) -> Array | None:
        """Goal (3,) of the tool in the world [m], None before control begins."""
        if self._goal is None:
            return None
        return self._goal.place if self._goal.path is None else self._goal.path.places[-1]

    def go_to(self, place: npt.ArrayLike, now: float, rotation: Array | None = None) -> None:
        """Set a target (3,) [m] in the world, and optionally an orientation (3, 3).

        Raises
        ------
        RejectedInputError
            If the target is not finite, or out of reach.
        """
        target = checked_vector('tool target', place, 'm')
        self._require_reach('tool target', target[np.newaxis], now)
        self._begin(_Goal(target, None, now, rotation), now)

    def follow(
        self, path: WorldPath, begin: float, now: float, rotation: Array | None = None
    ) -> None:
        """Follow a timed path that begins at the time `begin` [s].

        Raises
        ------
        RejectedInputError
            If the path begins too late or too early, or is out of reach.
        """
        if not -_LATEST < begin - now < _EARLIEST:
            raise RejectedInputError(
                f'tool path: the path begins {begin - now:+.1f} s from now; set the stamp to zero '
                '("now"), and check the clocks'
            )
        self._require_reach('tool path', path.places, now)
        self._begin(_Goal(path.places[0], path, begin, rotation), now)

    def push(self, force: npt.ArrayLike, now: float) -> None:
        """Press the tool against a wall with a force (3,) [N], given in world axes.

        The tool follows its target only across the force. A force of zero ends the contact, and
        the tool returns to its target.

        Raises
        ------
        RejectedInputError
            If the force is not finite, too large or in another direction than the present one, or
            if the tool is not held in the world.
        """
        pusher = self.force
        if pusher is None:
            raise RejectedInputError('tool force: set observer_gain, which measures the force')
        if self.reason or self.base.problem(now):
            raise RejectedInputError(
                f'tool force: the tool is not held in the world: {self.reason}'
            )
        vector = checked_vector('tool force', force, 'N')
        if np.any(vector):
            self._require_rotors(vector, now)
        if not pusher.is_active:
            nearest = self._place + _FIRST_STEP * vector / (np.linalg.norm(vector) + 1e-9)
            self._require_reach('the wall of the tool force', nearest[np.newaxis], now)
        if not pusher.push(vector, self._place, now):
            pusher.reason = ''
            if pusher.is_active:
                pusher.reset()
                self._return(now)

    def _require_rotors(self, force: Array, now: float) -> None:
        """Raise RejectedInputError if the drone's rotors could not balance a tool force."""
        if self.governor is None:
            return
        on_wall = self.base.pose(now).rotation.T @ force
        used = self.governor.usage_in_contact(self._q, on_wall, self._kinematics.position(self._q))
        if used > self.governor.share:
            raise RejectedInputError(
                f'tool force of {np.linalg.norm(force):.1f} N needs {100.0 * used:.0f} % of the '
                f"rotors' range, but rotor_share is {100.0 * self.governor.share:.0f} %: reduce "
                'the force, or choose a posture with a shorter lever'
            )

    def _return(self, now: float) -> None:
        """Move the tool from its present place to its target, at the slow recovery speed."""
        assert self._goal is not None
        self._quick.start(_ORIGIN)
        self._slow.start(self._place - self._goal.at(now).p, _ORIGIN, _ORIGIN)

    def _require_reach(self, what: str, places: Array, now: float) -> None:
        if np.abs(places).max() > _PLACE_MAX:
            raise RejectedInputError(f'{what} is more than {_PLACE_MAX:g} m away: check its unit')
        if self.base.problem(now):
            self.base.accept_next()
            return  # checked again before the motion continues
        pose = self.base.pose(now)
        beyond = self._reach((places - pose.position) @ pose.rotation, self._q)
        if beyond > 0.0:
            raise RejectedInputError(
                f'{what} {np.round(places[-1], 3).tolist()} is {beyond:.3f} m out of reach of '
                'the arm at the present base pose (too near or too far): move the drone, or check '
                'frame and unit'
            )

    def _begin(self, goal: _Goal, now: float) -> None:
        """Replace the goal; the reference moves smoothly from its present motion to the goal."""
        reference = self.reference
        self._goal = goal
        self._off_since = None
        if reference is not None:
            there = goal.at(now)
            slow = self._slow  # an unfinished return stays slow
            off, faster = reference.p - there.p - slow.place, reference.dp - there.dp
            self._quick.start(off, faster - slow.velocity, _ORIGIN)

    # The reference.

    def update(self, q: Array, now: float, dt: float) -> WorldReference:
        """Return the reference after a cycle of `dt` [s] that ends at `now` [s]."""
        self._q = q
        problem = self.base.problem(now) or self._off_target(now)
        if problem:
            return self._stop(problem, now)
        pose = self.base.pose(now)
        if self.reason and not self._may_resume(pose, q, now):
            return _STOPPED
        place = pose.to_world(self._kinematics.position(q))
        if self.reason or self._goal is None:
            self._resume(pose, place, q, now)
        elif self._jumps != self.base.jumps:
            assert self.reference is not None
            self._slow.start(self._slow.place + place - self._place, self._slow.velocity, _ORIGIN)
            if self.force is not None:
                self.force.shift(place - self._place)
        self._jumps, self._place = self.base.jumps, place
        reference = self._next(pose, now, dt)
        if self.reason:  # a contact has just ended
            return reference
        self.error = float(np.linalg.norm(reference.p - place))
        return reference

    def ahead(self, times: Array) -> list[TaskReference] | None:
        """Return the planned motion at times (M,) [s]; None while the arm is stopped.

        The plan is only the goal's own motion. The plan excludes the base's motion, the tool's
        return to its goal, and with a set force the goal's motion along the force.
        """
        if self._goal is None or self.reason:
            return None
        planned = [self._goal.at(time) for time in times.tolist()]
        if self.force is not None and self.force.is_active:
            planned = [self.force.across(motion) for motion in planned]
        return planned

    def _next(self, pose: BasePose, now: float, dt: float) -> WorldReference:
        goal = self._goal
        assert goal is not None
        parts = (
            goal.at(now),
            self._quick.update(_ORIGIN, now, dt),
            self._slow.update(_ORIGIN, now, dt),
        )
        motion = TaskReference(*(parts[0][k] + parts[1][k] + parts[2][k] for k in range(3)))
        contact, pusher = _ORIGIN, self.force
        if pusher is not None and pusher.is_active:
            pressed = pusher.update(motion, pose, self._place, now, dt)
            if pressed is None:
                self._goal = _Goal(self._place, None, now, goal.rotation)
                return self._stop(pusher.reason, now)
            motion, contact = pressed, pusher.on_tool
        self.reference = WorldReference(*motion, goal.rotation, pose, contact)
        return self.reference

    def _off_target(self, now: float) -> str:
        """Return a text if the tool is too far from its target, otherwise an empty string."""
        reference = self.reference
        if self.reason or reference is None or self.error <= self._error_max:
            self._off_since = None
            return ''
        if self._off_since is None:
            self._off_since = now
        if now - self._off_since < _OFF_TIME:
            return ''
        return (
            f'the tool is {1e3 * self.error:.0f} mm off its target: the target is out of '
            'reach, or something pushes the tool'
        )

    def _may_resume(self, pose: BasePose, q: Array, now: float) -> bool:
        """Return whether the arm may move again: all problems ended long enough ago."""
        goal = self._goal
        if goal is not None and goal.path is None and now - self._looked > _LOOK:
            self._looked = now
            beyond = self._reach(pose.to_base(goal.place)[np.newaxis], q)
            if beyond > 0.0:
                self.reason = (
                    f'the target is {beyond:.3f} m out of reach (too near or too far): move the '
                    'drone'
                )
                self._wrong_at = now
        return now - self._wrong_at > _RESUME

    def _stop(self, problem: str, now: float) -> WorldReference:
        if not self.reason:
            self.stops += 1
            if self._goal is not None and self._goal.path is not None:
                # The part of the path that the tool would have missed is unknown.
                self._goal = None
        self.reason, self._wrong_at, self._off_since = problem, now, None
        if self.force is not None and self.force.is_active:
            self.force.stop('the tool is not held in the world', now)
        self.reference = None
        return _STOPPED

    def _resume(self, pose: BasePose, place: Array, q: Array, now: float) -> None:
        if self._goal is None:
            self._goal = _Goal(place, None, now, None)
        self.reason, self.error, self._off_since = '', 0.0, None
        self._quick.start(_ORIGIN)
        # The arm rests in the base frame, so the tool moves with the base.
        velocity = pose.velocity + pose.rotation @ np.cross(pose.rate, self._kinematics.position(q))
        self._slow.start(place - self._goal.at(now).p, velocity, _ORIGIN)


def planned_joints(
    kinematics: Kinematics,
    inverse: DampedInverse,
    q: Array,
    pose: BasePose | None,
    planned: list[TaskReference] | None,
    times: Array,
) -> JointReference:
    """Return the joints' motion (M, n) for the tool's planned motion, over a resting base.

    The motion excludes the arm's reaction to the base, because feedforward of this reaction to the
    drone would close a feedback loop.

    Parameters
    ----------
    kinematics : Kinematics
        Kinematics of the tool frame that is held.
    q : (n,) ndarray
        Present posture [rad].
    planned : list of TaskReference or None
        Tool motion in the world at `times`; None for an arm that stays where it is.
    times : (M,) ndarray
        Times of the planned points [s].
    """
    still = np.zeros(len(q))
    if planned is None or pose is None:
        at_rest = JointReference(q, still, still)
        return JointReference(*(np.tile(part, (len(times), 1)) for part in at_rest))
    rows: list[JointReference] = []
    for step, wanted in zip(np.diff(times, prepend=times[0]).tolist(), planned, strict=True):
        if rows:
            q = q + step * (rows[-1].dq + 0.5 * step * rows[-1].ddq)
        found = inverse.of(kinematics.position_jacobian(q)).inverse
        dq = found @ (pose.rotation.T @ wanted.dp)
        bias = kinematics.acceleration_bias(q, dq)[:3]
        ddq = found @ (pose.rotation.T @ wanted.ddp - bias)
        if rows:
            # A quintic through the points has these accelerations between the points too.
            before = rows[-1]
            q = before.q + 0.5 * step * (before.dq + dq) + step**2 / 12.0 * (before.ddq - ddq)
        rows.append(JointReference(q, dq, ddq))
    return JointReference(*map(np.array, zip(*rows, strict=True)))
