"""Contact estimation in flight from the asynchronous messages of drone and arm."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from aerarm_ros.control.base.rotor_wrench import RotorWrench
from aerarm_ros.control.checks import RejectedInputError, positive
from aerarm_ros.control.compensation import Fade
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.flight_estimator import FlightEstimator
from aerarm_ros.flight.flight_state import FlightState, OdometrySample, StampedValues
from aerarm_ros.model.inertia import cross
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import Array

_WEIGHT = np.array([0.0, 0.0, -GRAVITY])


class ContactObserver:
    """Estimates the contact wrench from the momentum that rotors and weight do not explain.

    p is the linear momentum, and L the angular momentum about the common centre of mass c, joints
    included, in the world::

        dp/dt = f + m g + f_c          dL/dt = M - c x f + M_c

    f and M are force and moment of the rotors, f_c and M_c those of the contact, and m g is the
    weight. The joints' torques are internal and do not appear, so any motion of the arm is
    possible, and no acceleration is needed. The remainder passes a first-order low-pass. The
    result is the observer `d = K (p - int(f + m g + d) dt)` of De Luca et al. (IROS 2006) for a
    free body.

    Parameters
    ----------
    drone : DroneConfig
        Drone with the mount of the arm's base.
    whole : WholeBodyDynamics
        Model of arm and drone, an instance for this observer alone; the caller sets its payload.
    bandwidth : float
        Bandwidth of the low-pass [Hz].

    Attributes
    ----------
    bandwidth : float
        May be changed.

    Raises
    ------
    ValueError
        If the bandwidth is not positive.
    """

    def __init__(self, drone: DroneConfig, whole: WholeBodyDynamics, bandwidth: float) -> None:
        self.bandwidth = positive('contact_bandwidth', bandwidth)
        self.whole = whole
        self._mount = np.array(drone.mount.position)
        self._turn = drone.mount.rotation
        self.reset()

    def reset(self) -> None:
        """Reset the observer, so that it estimates no contact."""
        self._estimate = np.zeros(6)
        self.pause()

    def pause(self) -> None:
        """Keep the estimate during a gap in the data, and restart from the next `update`."""
        self._before: tuple[Array, Array, Array] | None = None

    def update(self, state: FlightState, q: Array, dq: Array, rotors: Array, dt: float) -> Array:
        """Return the low-passed wrench of the contact on drone and arm.

        Parameters
        ----------
        state : FlightState
            State of the drone.
        q, dq : (n,) ndarray
            State of the joints at the same time [rad], [rad/s].
        rotors : (6,) ndarray
            Mean wrench of the rotors over the last `dt` [N], [Nm].
        dt : float
            Time since the last call [s], positive.

        Returns
        -------
        (6,) ndarray
            Wrench on drone and arm: force [N] and moment [Nm] about the origin of the arm's base
            frame, in its axes, like `rotors`.
        """
        rotation = state.rotation @ self._turn
        momentum, centre = self._momentum(state, q, dq, rotation)
        before, self._before = self._before, (momentum, rotation, centre)
        if before is not None:
            last, last_rotation, last_centre = before
            # The mean of both ends is of second order in the step.
            known = 0.5 * (
                self._known(rotors, last_rotation, last_centre)
                + self._known(rotors, rotation, centre)
            )
            gain = 1.0 - np.exp(-2.0 * np.pi * self.bandwidth * dt)
            rest = (momentum - last) / dt - known
            self._estimate = self._estimate + gain * (rest - self._estimate)
        force, moment = self._estimate[:3] @ rotation, self._estimate[3:] @ rotation
        return np.concatenate([force, moment + cross(centre, force)])

    def _momentum(
        self, state: FlightState, q: Array, dq: Array, rotation: Array
    ) -> tuple[Array, Array]:
        """Return the momentum (6,) in world axes, and the centre of mass in base axes."""
        in_body = state.velocity @ state.rotation + cross(state.rate, self._mount)
        twist = np.concatenate([in_body @ self._turn, state.rate @ self._turn])
        momentum = self.whole.centroidal_momentum(q, dq, twist)
        centre = self.whole.composite_inertia(q)[1]
        return np.concatenate([rotation @ momentum[:3], rotation @ momentum[3:]]), centre

    def _known(self, rotors: Array, rotation: Array, centre: Array) -> Array:
        """Return the rate of change (6,) of the momentum that rotors and weight cause."""
        force = rotation @ rotors[:3] + self.whole.mass * _WEIGHT
        moment = rotation @ (rotors[3:] - cross(centre, rotors[:3]))
        return np.concatenate([force, moment])


DURATION = 2.0
"""Time [s] over which the bias of the contact estimate is averaged."""


class ContactZero:
    """Subtracts the bias of the contact estimate that a wrong weight or thrust causes.

    While the drone hovers, a wrong mass or thrust appears as a constant force in the world frame,
    at a constant point of the drone. The bias therefore consists of a mean force in the world
    frame and a mean moment in the axes of the arm's base.
    """

    def __init__(self) -> None:
        self._force, self._moment = np.zeros(3), np.zeros(3)
        self._sum, self._time = np.zeros(6), 0.0
        self._is_averaging = False

    def begin(self) -> None:
        """Start to average the bias; the previous bias applies until the average is complete."""
        self._sum, self._time, self._is_averaging = np.zeros(6), 0.0, True

    def apply(self, wrench: Array, rotation: Array, dt: float) -> Array:
        """Return a contact wrench (6,), in base axes about the base's origin, without its bias.

        Parameters
        ----------
        wrench : (6,) ndarray
            Low-passed wrench of the contact [N], [Nm].
        rotation : (3, 3) ndarray
            Base to world.
        dt : float
            Time since the last call [s].
        """
        force = rotation @ wrench[:3]
        if self._is_averaging:
            self._sum = self._sum + dt * np.concatenate([force, wrench[3:]])
            self._time += dt
            if self._time >= DURATION:
                self._force, self._moment = np.split(self._sum / self._time, 2)
                self._is_averaging = False
        return np.concatenate([(force - self._force) @ rotation, wrench[3:] - self._moment])


FADE_STEP = 0.01
"""Interval [s] of the messages while the contact estimate fades out."""

_FADE = 0.2  # [s] duration of the fade
_PIECE = 0.004  # [s] over which the rotors' wrench is assumed linear
_GAP = 0.05  # [s] without odometry; commands in that time may be lost
_WAITING = 16  # number of odometry messages that wait for their joint state
_OTHER_CLOCK = 1.0  # [s]


class ContactEstimator:
    """Passes odometry, rotor commands and joint states of one time to a `ContactObserver`.

    All stamps must belong to one clock. A rotor command carries the stamp of the odometry that it
    answers. The command acts from this stamp plus the latency of the rotors' wrench. If an input is
    missing, the last estimate fades to zero, and the estimation starts again when the input
    returns.

    Parameters
    ----------
    rotors : RotorWrench
        An instance for this estimator alone.
    hold_time : float
        Time without odometry [s] after which the odometry counts as missing.

    Attributes
    ----------
    zero : ContactZero
        The subtracted bias.
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
        self._offered = self._estimated_at = -np.inf
        self._waiting: deque[tuple[float, FlightState]] = deque(maxlen=_WAITING)
        self._taken: float | None = None
        self._wrench: Array | None = None
        self._fade = Fade(_FADE, share=1.0)

    def offer_odometry(self, sample: OdometrySample) -> None:
        """Process an odometry sample; raises RejectedInputError."""
        if sample.stamp == self._offered:
            return  # no new data
        self._check_clock('odometry', sample.stamp)
        self._offered = sample.stamp
        self._flight.offer_odometry(sample)
        state = self._flight.state()
        if state is not None:
            self._waiting.append((sample.stamp, state))

    def offer_rotors(self, names: Sequence[str], thrust: Array, stamp: float) -> None:
        """Process commanded thrusts [N] of named rotors; raises RejectedInputError.

        The thrusts act from their stamp [s] on.
        """
        self._check_clock('rotor_command', stamp)
        self._rotors.offer(names, thrust, stamp, stamp)

    def offer_joints(self, stamp: float, q: Array, dq: Array) -> None:
        """Process the joints' positions [rad] and velocities [rad/s], (n,), with stamp [s]."""
        self._now = stamp
        self._joints.add(stamp, np.concatenate([q, dq]))

    def problem(self) -> str:
        """Return a text if the contact estimate is unavailable, otherwise an empty string."""
        now = self._now
        if np.isinf(now):
            return 'no joint states yet'
        if np.isinf(self._offered):
            return 'no odometry yet'
        if self._flight.state() is None or abs(now - self._offered) > self._hold_time:
            return f'no good odometry for {abs(now - (self._flight.stamp or 0.0)):.2f} s'
        return self._rotors.problem(now)

    def update(self) -> tuple[float, Array] | None:
        """Return time [s] and wrench (6,) of a new contact estimate, None without a new one.

        The wrench has the units and axes of `ContactObserver.update`.
        """
        if self.problem():
            self._waiting.clear()
            due = self._now - self._estimated_at
            return self.fade(due) if due >= FADE_STEP or due < 0.0 else None
        estimate = None
        while self._waiting and self._waiting[0][0] <= self._now:
            estimate = self._take(*self._waiting.popleft()) or estimate
        return estimate

    def fade(self, dt: float) -> tuple[float, Array] | None:
        """Reduce the last contact wrench; return time [s] and wrench (6,), None at zero."""
        if self._wrench is None:
            return None
        # The last estimate may be old, so fade by one step without a jump.
        share = self._fade.update(FADE_STEP, is_on=False)
        self._estimated_at = self._estimated_at + dt if dt > 0.0 else self._now
        estimate = self._estimated_at, share * self._wrench
        if share == 0.0:
            self._wrench = self._taken = None
            self.observer.reset()
        return estimate

    def _take(self, stamp: float, state: FlightState) -> tuple[float, Array] | None:
        joints = self._joints.at(stamp)
        if joints is None:
            return None
        dt = 0.0 if self._taken is None else stamp - self._taken
        if not 0.0 < dt < _GAP:
            self.observer.pause()
        self._taken, self._estimated_at = stamp, stamp
        q, dq = np.split(joints, 2)
        wrench = self.observer.update(state, q, dq, self._mean_wrench(stamp, dt), dt)
        wrench = self.zero.apply(wrench, state.rotation @ self._turn, min(dt, _GAP))
        self._wrench, self._fade.share = wrench, 1.0
        return stamp, wrench

    def _mean_wrench(self, end: float, length: float) -> Array:
        """Return the rotors' mean wrench (6,) over the time `length` [s] before `end` [s]."""
        pieces = max(1, round(min(length, _GAP) / _PIECE))
        middles = end - length * (np.arange(pieces) + 0.5) / pieces
        wrenches = [self._rotors.wrench(float(middle)) for middle in middles]
        return np.asarray(np.mean(wrenches, axis=0))

    def _check_clock(self, what: str, stamp: float) -> None:
        ahead = stamp - self._now
        if np.isfinite(ahead) and abs(ahead) > _OTHER_CLOCK:
            raise RejectedInputError(
                f'{what}: its stamp is {ahead:+.3g} s from that of joint_states; synchronise the '
                "drone's clock with this host's"
            )
