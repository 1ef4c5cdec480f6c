"""A motion of the arm at the pace that the rotors of its drone can bear."""

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

_STEP = 0.02  # [s] of the motion's own time between two looks
_SMOOTHED = 0.2  # [s] over which the pace changes
_SLOWEST = 0.02  # of the motion's own pace
_SLOWER = 0.85  # per attempt
_ATTEMPTS = 12
_LOOKS = 250  # at most: a controller governs between two states
_ROUNDING = 1e-9


class PacedMotion(Protocol):
    """What is executed in time."""

    @property
    def duration(self) -> float:
        """Time from which on it rests [s]."""
        ...

    def evaluate(self, time: float) -> JointReference:
        """Return the reference (n,) at `time` [s]."""
        ...


class RotorGovernor:
    """Slows a motion along its own path until no rotor comes near its limits.

    Passed at the pace r, with its change r' [1/s], a point of a motion takes of the rotors, on a
    drone that hovers level::

        W = M_bb (-g) + M_bj (ddq r^2 + dq r') + c_b(q, dq) r^2
        thrusts = A^+ W

    with `c_b` of Coriolis and centrifugal forces. A drone with rotors in one plane leans for the
    sideways part of the force, so that part is left out of W for it. `share` of the distance from
    the middle of each rotor's range to its limits is used; the rest is for feedback, wind, and for
    leaning. As thrusts hold the moment about the vertical too, a heading that cannot be held
    is a rotor near its limit.

    The pace follows from r' = 0 first, is smoothed over 0.2 s without ever exceeding that, and
    lowered everywhere until the whole motion keeps to the limits with its r'.

    Parameters
    ----------
    whole : WholeBodyDynamics
        Arm and drone; an instance of its own, to be told of a payload.
    drone : DroneConfig
    gravity_in_base : (3,) array_like
        Of a level drone [m/s^2].
    share : float
        Of the rotors' range [-].

    Attributes
    ----------
    last_stretch : float
        Duration of the last motion over what it would have been.
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
        """Return what a point of a motion takes of the rotors: along, across, still (m,) [N].

        At the pace r with its change r' the thrusts are `along r' + across r^2 + still`.
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
        """Return the part of a wrench that rotors give: a drone that leans turns about its centre.

        The moment about the centre of mass stays what it is without the force sideways.
        """
        force = self._project @ wrench[:3]
        return np.concatenate([force, wrench[3:] + cross(com, force - wrench[:3])])

    def usage(self, motion: JointReference, pace: float = 1.0, change: float = 0.0) -> float:
        """Return how near the nearest rotor is to its limit: 0 in the middle, 1 at the limit."""
        along, across, still = self.thrusts(motion)
        wanted = along * change + across * pace**2 + still
        return float((np.abs(wanted - self._middle) / self._half).max())

    def govern(self, motion: PacedMotion) -> PacedMotion:
        """Return the motion, or the same path at a lower pace.

        Raises
        ------
        RejectedInputError
            If the drone could not hover under a posture on the way, or not even slowly enough.
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
    """Return the highest pace (M,), 1 at most, at which `across r^2 + still` is within limits."""
    room = np.where(across > 0.0, limit - still, limit + still)
    with np.errstate(divide='ignore'):
        square = np.where(np.abs(across) > _ROUNDING, room / np.abs(across), np.inf)
    pace: Array = np.sqrt(np.clip(square.min(axis=1), _SLOWEST**2, 1.0))
    return pace


def _smoothed(pace: Array, times: Array) -> Array:
    """Return a pace that changes over 0.2 s and is nowhere above the one given."""
    width = max(1, round(_SMOOTHED / (times[1] - times[0])))
    padded = np.concatenate([np.full(2 * width, pace[0]), pace, np.full(2 * width, pace[-1])])
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1)
    lowest = windows.min(axis=1)  # as long as what is given, and a width on each side
    weights = np.hanning(2 * width + 3)[1:-1]
    smooth: Array = np.convolve(lowest, weights / weights.sum(), mode='valid')
    return smooth


def _joined_to_begin(pace: Array, times: Array) -> Array:
    """Return a pace that begins at 1, as a motion that replaces another one under way has to."""
    share = np.clip(times / _SMOOTHED, 0.0, 1.0)
    share = share**2 * (3.0 - 2.0 * share)
    joined: Array = 1.0 + share * (pace - 1.0)
    return joined
