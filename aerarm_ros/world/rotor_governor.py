"""Slows the arm's motions down, so that the rotors of its drone can balance them."""

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.rotor_wrench import wrench_per_thrust
from aerarm_ros.control.checks import RejectedInputError, non_negative_number, positive
from aerarm_ros.control.references.reference_chase import MotionLimit
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.model.inertia import cross
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array, JointReference
from aerarm_ros.world.heading import HeadingControl

_STEP = 0.02  # [s] of the motion's own time between two checked points
_SMOOTHED = 0.4  # [s] over which the pace changes
_JOINED = 0.2  # [s] over which a running motion reaches the pace
_TILTED = 0.2  # [s] over which the force that tilts the drone is averaged
_SLOWEST = 0.02  # of the motion's own pace
_LEAST_SLOWER, _MOST_SLOWER = 0.97, 0.7  # per attempt
_ATTEMPTS = 30
_LEAST_SHARE = 0.02  # of the joints' own accelerations, which always stays for braking
_LASTING = 0.1  # [s]
_TILT_RATE = 10.0  # [rad/s]
_DOUBLINGS, _HALVINGS = 6, 7
_LOOKS = 250  # largest number, because a controller checks between two states
_ROUNDING = 1e-9


class PacedMotion(Protocol):
    """Interface of a joint motion that is a function of time."""

    @property
    def duration(self) -> float:
        """Time at which the motion ends [s]."""
        ...

    def evaluate(self, time: float) -> JointReference:
        """Return the reference (n,) at `time` [s]."""
        ...


class _Course(NamedTuple):
    """Samples of a motion at M times [s], with the rotor thrusts that each sample needs.

    At the pace r with its rate r' the thrusts [N] are `along r' + across r^2 + still`, from the
    middle of each rotor's range, (M, m) each. `sideways` (2, M, 3) is the horizontal force [N] for
    which a drone with rotors in one plane tilts, along and across. `inertia` (M, 3, 3) is that of
    drone and arm [kg m^2], and `momentum` and `carried` (M,) those of the arm and of
    the unknown payload about the vertical [Nms].
    """

    times: Array
    points: list[JointReference]
    along: Array
    across: Array
    still: Array
    sideways: Array
    inertia: Array
    momentum: Array
    carried: Array


class RotorGovernor:
    """Slows a motion along its path, so that rotor thrusts and heading respect their limits.

    The pace r is the speed relative to the given motion, and r' [1/s] is its rate. At a point of
    the motion, a level, hovering drone needs these thrusts::

        W = M_bb (-g) + M_bj (ddq r^2 + dq r') + c_b(q, dq) r^2
        thrusts = A^+ W

    with the Coriolis and centrifugal wrench `c_b` on the base. A drone with rotors in one plane
    tilts for the horizontal part f of the force. W then lacks f, and contains the moment
    `J (up x f'') / (m g)` that tilts the drone in time, with f averaged over 0.2 s. `share` is the
    used fraction of the distance from the middle of each rotor's thrust range to its limits. The
    remaining thrust is for feedback, wind and an unknown payload.

    The pace is first computed with r' = 0 and smoothed over 0.4 s without exceeding it. In a
    second step the pace is lowered everywhere until the whole motion, with its r' and the tilt,
    respects the limits of rotors and heading.

    Parameters
    ----------
    whole : WholeBodyDynamics
        Model of arm and drone, an instance for this governor alone; the caller sets its payload.
    gravity_in_base : (3,) array_like
        Gravity of a level drone [m/s^2].
    share : float
        Fraction of the rotors' thrust range that the arm's motion may use [-].
    heading : HeadingControl, optional
        Model of the heading with its limit; without it only the thrusts are limited.
    unknown_payload : float
        Mass at the last link's frame [kg] that `whole` does not contain; the limit of the heading
        applies to the arm without and with this mass.

    Attributes
    ----------
    last_stretch : float
        Duration of the last motion, divided by its original duration.
    """

    def __init__(
        self,
        whole: WholeBodyDynamics,
        drone: DroneConfig,
        gravity_in_base: npt.ArrayLike,
        share: float = 0.7,
        heading: HeadingControl | None = None,
        unknown_payload: float = 0.0,
    ) -> None:
        self.whole = whole
        self._unknown = non_negative_number('unknown_payload', unknown_payload)
        self._tool = Kinematics(whole.robot, whole.robot.end_link)
        self._share = min(positive('share', share), 1.0)
        self._heading = heading
        self._felt = np.concatenate([-np.array(gravity_in_base, dtype=float), np.zeros(3)])
        gravity = float(np.linalg.norm(self._felt[:3]))
        self._up, self._weight = self._felt[:3] / gravity, whole.mass * gravity
        low, high = drone.column('thrust_min'), drone.column('thrust_max')
        self._middle, self._half = 0.5 * (low + high), 0.5 * (high - low)
        self._mixer = np.linalg.pinv(wrench_per_thrust(drone), rcond=1e-6)
        self._per_turn = self._mixer[:, 3:] @ self._up  # [N/Nm] about the vertical
        self._project = np.eye(3)
        if not drone.is_fully_actuated:
            sideways = drone.mount.rotation.T[:, :2]
            self._project = self._project - sideways @ sideways.T
        self.last_stretch = 1.0

    def _wrenches(self, motion: JointReference) -> tuple[Array, Array, Array]:
        """Return the wrenches (6,) for r', r^2 and hovering at a point, see the class."""
        zero, rest = np.zeros(self.whole.n), np.zeros(3)
        q, dq, ddq = motion
        still = self.whole.forces(q, zero, zero, rest, self._felt)[:6]
        across = self.whole.forces(q, dq, ddq, rest)[:6]
        along = self.whole.forces(q, zero, dq, rest)[:6]
        return along, across, still

    def _given(self, wrench: Array, com: Array) -> Array:
        """Return the part (6,) of a wrench that the rotors of a level drone can produce.

        The result lacks the horizontal force of a drone with rotors in one plane, and keeps the
        moment about the centre of mass.
        """
        force = self._project @ wrench[:3]
        return np.concatenate([force, wrench[3:] + cross(com, force - wrench[:3])])

    def _carried(self, motion: JointReference, com: Array, linear: Array) -> float:
        """Return the angular momentum of the unknown payload about the vertical [Nms].

        The momentum is about the centre of mass and relative to its velocity; `linear` (3,) is the
        linear momentum of the arm [Ns].
        """
        q, dq, _ = motion
        if self._unknown == 0.0:
            return 0.0
        lever = cross(self._up, self._tool.position(q) - com)
        velocity = self._tool.position_jacobian(q) @ dq - linear / self.whole.mass
        return self._unknown * float(lever @ velocity)

    def govern(self, motion: PacedMotion) -> PacedMotion:
        """Return the motion, slowed along its path as far as the rotors require.

        Raises
        ------
        RejectedInputError
            If the drone could not hover under a posture of the path, or no pace is slow enough.
        """
        self.last_stretch = 1.0
        if motion.duration < _STEP:
            return motion
        course = self._course(motion, _LOOKS)
        pace = _smoothed(self._static_pace(course), course.times)
        if pace.min() >= 1.0 - _ROUNDING and self._factor(course, np.ones(len(pace))) == 1.0:
            return motion
        moves = bool(np.any(np.abs(course.points[0].dq) > 1e-6))
        for _ in range(_ATTEMPTS):
            tried = _joined_to_begin(pace, course.times) if moves else pace
            factor = self._factor(course, tried)
            if factor == 1.0:
                return self._paced(course, tried)
            pace = factor * pace
        raise RejectedInputError(
            'trajectory rejected, because it demands too much of the rotors at any speed: choose '
            'a motion that moves fewer links at once'
        )

    def slowdown(self, motion: PacedMotion) -> float:
        """Return the factor, 1 or more, by which a motion must be longer to respect the limits.

        One factor for the whole motion keeps the shape of an excitation.

        Raises
        ------
        RejectedInputError
            As `govern`.
        """
        course = self._course(motion)
        factor = float(1.0 / self._static_pace(course).min())

        def is_held(factor: float) -> bool:
            return self._factor(course, np.full(len(course.times), 1.0 / factor)) == 1.0

        if is_held(factor):
            return factor
        low, high = factor, 2.0 * factor
        for _ in range(_DOUBLINGS):
            if is_held(high):
                break
            low, high = high, 2.0 * high
        else:
            raise RejectedInputError(
                "trajectory rejected, because it turns the drone's heading too far at any speed: "
                'choose smaller motions about the vertical axis, a larger heading_max or a '
                'smaller unknown_payload'
            )
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if is_held(middle) else (middle, high)
        return high

    def limited(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return a joint acceleration (n,) [rad/s^2], reduced as the rotor thrusts require.

        If the thrusts are beyond their share without acceleration, a fraction of it stays, with
        which the arm can brake.

        Parameters
        ----------
        q, dq, ddq : (n,) ndarray
            Posture [rad], velocity [rad/s] and wanted acceleration [rad/s^2].
        """
        coupling, com, _, still = self._hovering(q, dq)
        moved = self._mixer @ self._given(coupling @ ddq, com)
        left = self._share * self._half - np.sign(moved) * still
        share = float((left / np.maximum(np.abs(moved), _ROUNDING)).min())
        return min(max(share, _LEAST_SHARE), 1.0) * ddq

    @property
    def share(self) -> float:
        """Fraction of the rotors' thrust range that the arm's motion may use [-]."""
        return self._share

    def usage_in_contact(self, q: Array, force: Array, place: Array) -> float:
        """Return the largest use of a rotor's range while the tool presses: 1 at its limits.

        Parameters
        ----------
        q : (n,) ndarray
            Posture [rad]; joints and drone rest.
        force, place : (3,) ndarray
            Force on the wall [N] and position of the tool [m], in base axes.
        """
        _, com, _, still = self._hovering(q, np.zeros(self.whole.n))
        pressing = self._mixer @ self._given(np.concatenate([force, cross(place, force)]), com)
        return float((np.abs(still + pressing) / self._half).max())

    def motion_limits(self, q: Array, dq: Array, most: Array) -> MotionLimit:
        """Return limits for a streamed motion, whose further path is unknown.

        The thrusts stay within their share, whatever signs the accelerations of the joints have.
        Each joint may use an equal part of the rotors' range beside hovering and the moment that
        the velocity needs; what a joint at its own limit leaves is for the others. A drone with
        rotors in one plane tilts for a horizontal force that may change at 10 rad/s.

        Parameters
        ----------
        q, dq, most : (n,) ndarray
            Posture [rad], velocity [rad/s] and own limits of acceleration [rad/s^2].
        """
        coupling, com, inertia, still = self._hovering(q, dq)
        room = np.maximum(self._share * self._half - np.abs(still), 0.0)
        lever = _TILT_RATE**2 / self._weight
        moved, turning = [], []
        for column in coupling.T:  # numpy.cross is slower than all the rest
            direct = self._mixer @ self._given(column, com)
            sideways = column[:3] - self._project @ column[:3]
            tilting = self._mixer[:, 3:] @ (inertia @ cross(self._up, sideways)) * lever
            moved.append(np.abs(direct) + np.abs(tilting))
            turning.append(float(self._up @ (column[3:] - cross(com, column[:3]))))
        acceleration = np.maximum(_shared(room, np.array(moved), most), _LEAST_SHARE * most)
        turned = np.array(turning) / float(self._up @ inertia @ self._up)
        turn_max = np.inf if self._heading is None else self._heading.turn_max
        return MotionLimit(acceleration, turned, turn_max)

    def _hovering(self, q: Array, dq: Array) -> tuple[Array, Array, Array, Array]:
        """Return `M_bj` (6, n), centre of mass, inertia, and thrusts (m,) for `ddq = 0`.

        The thrusts [N] are those from the middle of each rotor's range.
        """
        coupling = self.whole.inertia_matrix(q)[:6, 6:].copy()
        _, com, inertia = self.whole.composite_inertia(q)
        zero = np.zeros(self.whole.n)
        wrench = self.whole.forces(q, dq, zero, zero[:3], self._felt)[:6]
        return coupling, com, inertia, self._mixer @ self._given(wrench, com) - self._middle

    def _course(self, motion: PacedMotion, most: int | None = None) -> _Course:
        """Sample a motion every 20 ms, up to `most` times; check that the drone can hover."""
        count = max(2, int(np.ceil(motion.duration / _STEP)) + 1)
        times = np.linspace(0.0, motion.duration, count if most is None else min(count, most))
        points = [motion.evaluate(min(time, motion.duration)) for time in times.tolist()]
        rows = [self._row(point) for point in points]
        along, across, still, sideways, *turning = map(np.array, zip(*rows, strict=True))
        still = still - self._middle
        left = (self._share * self._half - np.abs(still)).min(axis=1)
        if np.any(left < 0.0):
            raise RejectedInputError(
                f'trajectory rejected, because {times[np.argmin(left)]:.1f} s after its start the '
                f'drone could not hover under the arm with {100.0 * self._share:.0f} % of its '
                "rotors' range: choose another posture"
            )
        sideways = np.swapaxes(sideways, 0, 1)
        return _Course(times, points, along, across, still, sideways, *turning)

    def _row(self, point: JointReference) -> tuple[Array | float, ...]:
        """Return one sample of a motion: the values of the fields of `_Course`."""
        _, com, inertia = self.whole.composite_inertia(point.q)
        wrenches = self._wrenches(point)
        along, across, still = (self._mixer @ self._given(wrench, com) for wrench in wrenches)
        left_out = np.array([wrench[:3] - self._project @ wrench[:3] for wrench in wrenches[:2]])
        momentum = wrenches[0][3:] - cross(com, wrenches[0][:3])  # M_bj dq about the centre
        carried = self._carried(point, com, wrenches[0][:3])
        return along, across, still, left_out, inertia, float(self._up @ momentum), carried

    def _static_pace(self, course: _Course) -> Array:
        """Return the highest constant pace (M,), at most 1, that respects the thrust limits."""
        limit = self._share * self._half
        across, still = course.across, course.still
        room = np.where(across > 0.0, limit - still, limit + still)
        with np.errstate(divide='ignore'):
            square = np.where(np.abs(across) > _ROUNDING, room / np.abs(across), np.inf)
        pace: Array = np.sqrt(np.clip(square.min(axis=1), _SLOWEST**2, 1.0))
        return pace

    def _factor(self, course: _Course, pace: Array) -> float:
        """Return 1 if a pace (M,) respects the limits, otherwise a factor for the next attempt."""
        times = _stretched(course.times, pace)
        change = np.gradient(pace, times)
        motion = course.along * change[:, None] + course.across * (pace**2)[:, None]
        motion = motion + self._tilting(course, times, pace, change)
        wanted = motion + course.still
        limit = self._share * self._half
        beyond = np.abs(wanted) > limit + 1e-6
        if np.any(beyond):
            left = limit - np.sign(wanted) * course.still
            return _factor_of(float((left[beyond] / np.abs(motion[beyond])).min()))
        if self._heading is None:
            return 1.0
        momentum = pace * course.momentum
        low, high = self._moments(wanted, np.gradient(momentum, times))
        inertia = course.inertia @ self._up @ self._up
        turned = max(
            self._heading.excursion(times, momentum, inertia, low, high, carried)
            for carried in ((0.0, pace * course.carried) if course.carried.any() else (0.0,))
        )
        if turned <= self._heading.limit:
            return 1.0
        return _factor_of(self._heading.limit / turned)

    def _moments(self, wanted: Array, moment: Array) -> tuple[Array, Array]:
        """Return the range (M,) [Nm] of vertical moments that other thrusts leave.

        `wanted` (M, m) are all thrusts from the middle of their range, including those for the
        `moment` (M,) about the vertical. Other thrusts beyond the limits leave no range.
        """
        others = wanted - moment[:, None] * self._per_turn
        limit = self._share * self._half
        ends = np.array([(-limit - others) / self._per_turn, (limit - others) / self._per_turn])
        low, high = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
        middle = 0.5 * (low + high)
        return np.minimum(low, middle), np.maximum(high, middle)

    def _tilting(self, course: _Course, times: Array, pace: Array, change: Array) -> Array:
        """Return the thrusts (M, m) [N] that tilt a drone with rotors in one plane."""
        if not course.sideways.any():
            return np.zeros_like(course.along)
        force = course.sideways[0] * change[:, None] + course.sideways[1] * (pace**2)[:, None]
        count = max(4, round(times[-1] / _STEP))
        grid = np.linspace(0.0, times[-1], count + 1)
        even = np.array([np.interp(grid, times, row) for row in force.T])
        window = np.hanning(2 * round(_TILTED / (2.0 * grid[1])) + 3)[1:-1]
        half = len(window) // 2
        padded = np.pad(even, ((0, 0), (2 * half, 2 * half)))  # no force before and after
        mean = np.array([np.convolve(row, window / window.sum(), 'same') for row in padded])
        curve = np.gradient(np.gradient(mean, grid[1], axis=1), grid[1], axis=1)
        curve = curve[:, 2 * half : 2 * half + len(grid)]
        spin = np.cross(self._up, np.array([np.interp(times, grid, row) for row in curve]).T)
        moment = np.einsum('mij,mj->mi', course.inertia, spin / self._weight)
        tilting: Array = moment @ self._mixer[:, 3:].T
        return tilting

    def _paced(self, course: _Course, pace: Array) -> PolynomialPath:
        times = course.times
        change = pace * np.gradient(pace, times)
        stretched = _stretched(times, pace)
        self.last_stretch = float(stretched[-1] / times[-1])
        rows = [
            point.paced(float(r), float(c))
            for point, r, c in zip(course.points, pace, change, strict=True)
        ]
        return PolynomialPath.quintic(stretched, *map(np.array, zip(*rows, strict=True)))


class ReactionLimit:
    """Limits the joint acceleration with which a control law reacts to the drone's motion.

    The drone itself moves against a short acceleration of the joints, without its rotors. So the
    mean over 0.1 s (first-order low-pass) must keep the thrusts within their share, and the
    remainder passes.

    Parameters
    ----------
    governor : RotorGovernor
        Limits of the rotors.
    """

    def __init__(self, governor: RotorGovernor) -> None:
        self._governor = governor
        self.reset()

    def reset(self) -> None:
        """Forget earlier accelerations."""
        self._lasting = np.zeros(self._governor.whole.n)

    def __call__(self, q: Array, dq: Array, ddq: Array, dt: float) -> Array:
        """Return the acceleration (n,) [rad/s^2], limited, for a cycle of `dt` [s]."""
        lasting = self._lasting + min(dt / _LASTING, 1.0) * (ddq - self._lasting)
        self._lasting = lasting
        return ddq - lasting + self._governor.limited(q, dq, lasting)


def _shared(room: Array, moved: Array, most: Array) -> Array:
    """Return accelerations (n,), at most `most`, that use up the thrust range `room` (m,)."""
    given = np.zeros(len(most))
    for _ in range(len(most)):
        is_open = given < most
        left = np.maximum(room - given @ moved, 0.0) / max(int(is_open.sum()), 1)
        more = (left / (moved + _ROUNDING)).min(axis=1)
        given = np.where(is_open, np.minimum(given + more, most), given)
    return given


def _factor_of(square: float) -> float:
    """Return a factor for the pace, the square root of a factor for the thrusts, within bounds."""
    return float(min(max(np.sqrt(square), _MOST_SLOWER), _LEAST_SLOWER))


def _stretched(times: Array, pace: Array) -> Array:
    """Return when [s] a slowed motion reaches the points of its original times, (M,)."""
    rates = 2.0 / (pace[1:] + pace[:-1])
    stretched: Array = np.concatenate([[0.0], np.cumsum(np.diff(times) * rates)])
    return stretched


def _smoothed(pace: Array, times: Array) -> Array:
    """Smooth a speed factor (M,) over 0.4 s; the result never exceeds the given factor."""
    width = max(1, round(_SMOOTHED / (times[1] - times[0])))
    padded = np.concatenate([np.full(2 * width, pace[0]), pace, np.full(2 * width, pace[-1])])
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1)
    lowest = windows.min(axis=1)  # as long as the input, plus a window width on each side
    weights = np.hanning(2 * width + 3)[1:-1]
    smooth: Array = np.convolve(lowest, weights / weights.sum(), mode='valid')
    return smooth


def _joined_to_begin(pace: Array, times: Array) -> Array:
    """Return a pace that begins at 1 and then joins the given pace, to replace a running motion."""
    share = np.clip(times / _JOINED, 0.0, 1.0)
    share = share**2 * (3.0 - 2.0 * share)
    joined: Array = 1.0 + share * (pace - 1.0)
    return joined
