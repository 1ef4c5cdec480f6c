"""Slow a motion of the arm to the capacity of the drone's rotors."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.rotor_wrench import wrench_per_thrust
from aerarm_ros.control.checks import RejectedInputError, positive
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.model.inertia import cross
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array, JointReference

_STEP = 0.02  # [s] of the motion's own time between two checked points
_SMOOTHED = 0.2  # [s] over which the pace changes
_SLOWEST = 0.02  # of the motion's own pace
_SLOWER = 0.85  # per attempt
_ATTEMPTS = 12
_LOOKS = 250  # largest number, because a controller checks between two states
_ROUNDING = 1e-9


class PacedMotion(Protocol):
    """Interface of a motion in time."""

    @property
    def duration(self) -> float:
        """Time at which the motion ends [s]."""
        ...

    def evaluate(self, time: float) -> JointReference:
        """Return the reference (n,) at `time` [s]."""
        ...


class RotorGovernor:
    """Slow a motion along its own path until all rotors keep a margin to their limits.

    The pace r is the speed relative to the given motion, and r' [1/s] is its rate. At a point of
    the motion, a level, hovering drone needs these thrusts::

        W = M_bb (-g) + M_bj (ddq r^2 + dq r') + c_b(q, dq) r^2
        thrusts = A^+ W

    with the Coriolis and centrifugal wrench `c_b` on the base. A drone with rotors in one plane
    tilts for the horizontal part of the force, so that part is left out of W. `share` is the used
    fraction of the distance from the middle of each rotor's thrust range to its limits. The
    remaining thrust is for feedback, wind and tilt. The thrusts include the moment about the
    vertical, so a heading that cannot be held shows as a rotor near its limit.

    The pace is first computed with r' = 0 and smoothed over 0.2 s without exceeding it. In a
    second step the pace is lowered everywhere until the whole motion, with its r', respects the
    limits.

    Parameters
    ----------
    whole : WholeBodyDynamics
        Model of arm and drone, an instance for this governor alone; the caller sets its payload.
    gravity_in_base : (3,) array_like
        Gravity of a level drone [m/s^2].
    share : float
        Used fraction of the rotors' thrust range [-].

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
    ) -> None:
        self.whole = whole
        self._share = min(positive('share', share), 1.0)
        self._felt = np.concatenate([-np.array(gravity_in_base, dtype=float), np.zeros(3)])
        low, high = drone.column('thrust_min'), drone.column('thrust_max')
        self._middle, self._half = 0.5 * (low + high), 0.5 * (high - low)
        self._mixer = np.linalg.pinv(wrench_per_thrust(drone), rcond=1e-6)
        self._project = np.eye(3)
        if not drone.is_fully_actuated:
            sideways = drone.mount.rotation.T[:, :2]
            self._project = self._project - sideways @ sideways.T
        self.last_stretch = 1.0

    def thrusts(self, motion: JointReference) -> tuple[Array, Array, Array]:
        """Return the thrusts `along`, `across` and `still`, (m,) [N] each, of a point of a motion.

        At the pace r with its rate r' the thrusts are `along r' + across r^2 + still`.
        """
        zero, rest = np.zeros(self.whole.n), np.zeros(3)
        q, dq, ddq = motion
        still = self.whole.forces(q, zero, zero, rest, self._felt)[:6]
        across = self.whole.forces(q, dq, ddq, rest)[:6]
        along = self.whole.forces(q, zero, dq, rest)[:6]
        _, com, _ = self.whole.composite_inertia(q)
        rows = [self._mixer @ self._given(wrench, com) for wrench in (along, across, still)]
        return rows[0], rows[1], rows[2]

    def _given(self, wrench: Array, com: Array) -> Array:
        """Return the part of a wrench that the rotors of a level drone can give.

        The result lacks the horizontal force of a drone with rotors in one plane, and keeps the
        moment about the centre of mass.
        """
        force = self._project @ wrench[:3]
        return np.concatenate([force, wrench[3:] + cross(com, force - wrench[:3])])

    def usage(self, motion: JointReference, pace: float = 1.0, change: float = 0.0) -> float:
        """Return the rotors' largest usage: 0 in the middle of the range, 1 at the limit."""
        along, across, still = self.thrusts(motion)
        wanted = along * change + across * pace**2 + still
        return float((np.abs(wanted - self._middle) / self._half).max())

    def govern(self, motion: PacedMotion) -> PacedMotion:
        """Return the motion unchanged, or its path at a lower pace.

        Raises
        ------
        RejectedInputError
            If the drone could not hover under a posture of the path, or no pace is slow enough.
        """
        self.last_stretch = 1.0
        if motion.duration < _STEP:
            return motion
        count = min(int(np.ceil(motion.duration / _STEP)) + 1, _LOOKS)
        times = np.linspace(0.0, motion.duration, count)
        points = [motion.evaluate(min(time, motion.duration)) for time in times.tolist()]
        rows = np.array([self.thrusts(point) for point in points])  # (M, 3, rotors)
        along, across, still = rows[:, 0], rows[:, 1], rows[:, 2] - self._middle
        limit = self._share * self._half
        if np.any(np.abs(still) > limit):
            worst = int(np.argmax(np.abs(still).max(axis=1)))
            raise RejectedInputError(
                f'trajectory rejected, because {times[worst]:.1f} s after its start the drone '
                f"could not hover under the arm with {100.0 * self._share:.0f} % of its rotors' "
                'range: choose another posture'
            )
        pace = _smoothed(_static_pace(across, still, limit), times)
        if pace.min() >= 1.0 - _ROUNDING:
            return motion
        moves = bool(np.any(np.abs(points[0].dq) > 1e-6))
        for _ in range(_ATTEMPTS):
            tried = _joined_to_begin(pace, times) if moves else pace
            change = tried * np.gradient(tried, times)
            wanted = along * change[:, None] + across * (tried**2)[:, None] + still
            if np.all(np.abs(wanted) <= limit + 1e-6):
                return self._paced(points, times, tried, change)
            pace = _SLOWER * pace
        raise RejectedInputError(
            'trajectory rejected, because it demands too much of the rotors at any speed: choose '
            'a motion that moves fewer links at once'
        )

    def _paced(
        self, points: list[JointReference], times: Array, pace: Array, change: Array
    ) -> PolynomialPath:
        rates = 2.0 / (pace[1:] + pace[:-1])
        stretched = np.concatenate([[0.0], np.cumsum(np.diff(times) * rates)])
        self.last_stretch = float(stretched[-1] / times[-1])
        rows = [
            point.paced(float(r), float(c))
            for point, r, c in zip(points, pace, change, strict=True)
        ]
        return PolynomialPath.quintic(stretched, *map(np.array, zip(*rows, strict=True)))


def _static_pace(across: Array, still: Array, limit: Array) -> Array:
    """Return the highest pace (M,), at most 1, with `across r^2 + still` within limits."""
    room = np.where(across > 0.0, limit - still, limit + still)
    with np.errstate(divide='ignore'):
        square = np.where(np.abs(across) > _ROUNDING, room / np.abs(across), np.inf)
    pace: Array = np.sqrt(np.clip(square.min(axis=1), _SLOWEST**2, 1.0))
    return pace


def _smoothed(pace: Array, times: Array) -> Array:
    """Return a pace that changes over 0.2 s and never exceeds the given one."""
    width = max(1, round(_SMOOTHED / (times[1] - times[0])))
    padded = np.concatenate([np.full(2 * width, pace[0]), pace, np.full(2 * width, pace[-1])])
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1)
    lowest = windows.min(axis=1)  # as long as the input, plus a window width on each side
    weights = np.hanning(2 * width + 3)[1:-1]
    smooth: Array = np.convolve(lowest, weights / weights.sum(), mode='valid')
    return smooth


def _joined_to_begin(pace: Array, times: Array) -> Array:
    """Return a pace that begins at 1, as required to replace a running motion."""
    share = np.clip(times / _SMOOTHED, 0.0, 1.0)
    share = share**2 * (3.0 - 2.0 * share)
    joined: Array = 1.0 + share * (pace - 1.0)
    return joined
