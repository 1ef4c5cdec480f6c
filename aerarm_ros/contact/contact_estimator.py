"""Contact in flight from what comes of drone and arm, at different times and not always."""

from collections import deque
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.contact.contact_observer import ContactObserver
from aerarm_ros.contact.contact_zero import ContactZero
from aerarm_ros.control.base.rotor_wrench import RotorWrench
from aerarm_ros.control.checks.gains import positive
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.control.compensation.fade import Fade
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.flight_estimator import FlightEstimator
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.flight.odometry_sample import OdometrySample
from aerarm_ros.flight.stamped_values import StampedValues

Array = npt.NDArray[np.float64]

FADE_STEP = 0.01
"""[s] between two words on an estimate that fades."""

_FADE = 0.2  # [s] in which it does
_PIECE = 0.004  # [s] over which the rotors' wrench may be taken as straight
_GAP = 0.05  # [s] without odometry: what the rotors did meanwhile need not have been heard
_WAITING = 16  # odometry messages that wait for their joint state
_OTHER_CLOCK = 1.0  # [s]


class ContactEstimator:
    """Joins odometry, rotor commands and joint states by their stamps, for a `ContactObserver`.

    All stamps must be of one clock: a command acts from its stamp (that of the odometry that it
    answers) plus the latency of the rotors' wrench on. Where an input is missing the last estimate
    fades to nothing, and what comes back begins anew.

    Parameters
    ----------
    drone : DroneConfig
    observer : ContactObserver
    rotors : RotorWrench
        An instance of its own.
    hold_time : float
        Silence of the odometry [s] after which it counts as missing.

    Attributes
    ----------
    observer : ContactObserver
    zero : ContactZero
        What is subtracted.
    """

    def __init__(
        self,
        drone: DroneConfig,
        observer: ContactObserver,
        rotors: RotorWrench,
        hold_time: float = 0.1,
    ) -> None:
        self.observer = observer
        self.zero = ContactZero()
        self._turn = drone.mount.rotation
        self._rotors = rotors
        self._hold_time = positive('hold_time', hold_time)
        self._flight = FlightEstimator(drone)
        self._joints = StampedValues(0.0)
        self._now = -np.inf
        self._offered = self._told_at = -np.inf
        self._waiting: deque[tuple[float, FlightState]] = deque(maxlen=_WAITING)
        self._taken: float | None = None
        self._wrench: Array | None = None
        self._fade = Fade(_FADE, share=1.0)

    def offer_odometry(self, sample: OdometrySample) -> None:
        """Take an odometry sample; raises RejectedInputError with what is wrong."""
        if sample.stamp == self._offered:
            return  # told again
        self._check_clock('odometry', sample.stamp)
        self._offered = sample.stamp
        self._flight.offer_odometry(sample)
        state = self._flight.state()
        if state is not None:
            self._waiting.append((sample.stamp, state))

    def offer_rotors(self, names: Sequence[str], thrust: Array, stamp: float) -> None:
        """Take commanded thrusts [N] of named rotors; raises RejectedInputError if they are none.

        They act from their stamp [s] on.
        """
        self._check_clock('rotor_command', stamp)
        self._rotors.offer(names, thrust, stamp, stamp)

    def offer_joints(self, stamp: float, q: Array, dq: Array) -> None:
        """Take positions [rad] and velocities [rad/s] (n,) of the joints at a stamp [s]."""
        self._now = stamp
        self._joints.add(stamp, np.concatenate([q, dq]))

    def problem(self) -> str:
        """Return why nothing can be told now, '' if it can."""
        now = self._now
        if np.isinf(now):
            return 'no joint states yet'
        if np.isinf(self._offered):
            return 'no odometry yet'
        if self._flight.state() is None or abs(now - self._offered) > self._hold_time:
            return f'no good odometry for {abs(now - (self._flight.stamp or 0.0)):.2f} s'
        return self._rotors.problem(now)

    def update(self) -> tuple[float, Array] | None:
        """Return the newest wrench (6,) with its time [s], None if there is nothing new to tell.

        See `ContactObserver.update`.
        """
        if self.problem():
            self._waiting.clear()
            due = self._now - self._told_at
            return self.fade(due) if due >= FADE_STEP or due < 0.0 else None
        told = None
        while self._waiting and self._waiting[0][0] <= self._now:
            told = self._take(*self._waiting.popleft()) or told
        return told

    def fade(self, dt: float) -> tuple[float, Array] | None:
        """Let the last estimate fade over `dt` [s]; return what is left, None once that is told."""
        if self._wrench is None:
            return None
        # What was told last is some time ago; nothing may jump for that.
        share = self._fade.update(FADE_STEP, is_on=False)
        self._told_at = self._told_at + dt if dt > 0.0 else self._now
        told = self._told_at, share * self._wrench
        if share == 0.0:
            self._wrench = self._taken = None
            self.observer.reset()
        return told

    def _take(self, stamp: float, state: FlightState) -> tuple[float, Array] | None:
        joints = self._joints.at(stamp)
        if joints is None:
            return None
        dt = 0.0 if self._taken is None else stamp - self._taken
        if not 0.0 < dt < _GAP:
            self.observer.pause()
        self._taken, self._told_at = stamp, stamp
        q, dq = np.split(joints, 2)
        wrench = self.observer.update(state, q, dq, self._mean_wrench(stamp, dt), dt)
        wrench = self.zero.apply(wrench, state.rotation @ self._turn, min(dt, _GAP))
        self._wrench, self._fade.share = wrench, 1.0
        return stamp, wrench

    def _mean_wrench(self, end: float, length: float) -> Array:
        """Return the rotors' mean wrench over a time [s] before `end` [s]."""
        pieces = max(1, round(min(length, _GAP) / _PIECE))
        middles = end - length * (np.arange(pieces) + 0.5) / pieces
        wrenches = [self._rotors.wrench(float(middle)) for middle in middles]
        return np.asarray(np.mean(wrenches, axis=0))

    def _check_clock(self, what: str, stamp: float) -> None:
        ahead = stamp - self._now
        if np.isfinite(ahead) and abs(ahead) > _OTHER_CLOCK:
            raise RejectedInputError(
                f'{what}: it is stamped {ahead:+.3g} s from joint_states; contact needs both on '
                "one clock: synchronise the drone's with this host's"
            )
