"""Contact detection from joint torques, with confidence and distinction from payloads."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.checks import positive
from aerarm_ros.motion.signals import ArmState, Array
from aerarm_ros.online.external_torque import (
    LONGEST_GAP,
    ExternalTorque,
    ResidualBound,
    StateWindow,
    Unexplained,
)
from aerarm_ros.online.load_test import LoadTest
from aerarm_ros.online.payload_estimator import FROZEN_EFFORT, MOVING, FrozenSignal


class Cause(Enum):
    """Cause of unexplained joint torque; the enum's value is the text in reports."""

    CONTACT = 'contact'
    PAYLOAD = 'undeclared payload'
    RELEASED = 'end of the undeclared payload'
    MODEL = 'model error'


@dataclass(frozen=True)
class ContactSettings:
    """Settings of a `ContactDetector`; all are positive.

    Attributes
    ----------
    confirmation : float
        Time for which the threshold must be exceeded [s]. In this time the velocities distinguish
        the start of a motion from a push at rest.
    rest_speed : float
        Speed below which every joint counts as resting [rad/s].
    rest_share : float
        Change of torque at rest that counts as contact, as a fraction of the joint's dry friction.
    payload_mass, payload_size : float
        Standard deviation of a payload's mass [kg], and its distance from the last joint [m].
    """

    confirmation: float = 0.02
    rest_speed: float = 0.005
    rest_share: float = 0.15
    payload_mass: float = 2.0
    payload_size: float = 0.2

    def __post_init__(self) -> None:
        """Check that every setting of the detector is positive."""
        for field in fields(self):
            positive(field.name, getattr(self, field.name))


class ContactReport(NamedTuple):
    """Result of contact detection, updated with every joint state.

    Attributes
    ----------
    torque : (n,) ndarray
        External joint torque [Nm], positive along +q, without that of a detected payload.
    threshold : (n,) ndarray
        Largest external torque that model errors cause in free motion [Nm]; infinite if unknown.
    confidence : float
        Confidence of a contact, 0 to 1.
    cause : Cause or None
        Cause of the present event, None without an event.
    """

    torque: Array
    threshold: Array
    in_contact: bool
    confidence: float
    cause: Cause | None


@dataclass(eq=False)
class ContactEvent:
    """Event: interval in which the external joint torque exceeds the bound on model errors.

    Attributes
    ----------
    begin, end : float
        Start and end of the event [s]; the end is NaN during the event.
    joint : int
        Index of the joint with the largest ratio of torque to threshold.
    torque : (n,) ndarray
        Largest change of external torque [Nm].
    threshold : (n,) ndarray
        Threshold at the time of the largest change [Nm].
    q : (n,) ndarray
        Posture of the arm at the time of the largest change [rad].
    ratio : float
        Largest torque over its threshold.
    mass, mass_std : float
        Mass of a payload and its standard deviation [kg], NaN for another cause.
    reference : (n,) ndarray or float
        External torque before the event, which `torque` does not include [Nm].
    """

    begin: float
    joint: int
    torque: Array
    threshold: Array
    q: Array
    ratio: float
    cause: Cause = Cause.CONTACT
    end: float = float('nan')
    mass: float = float('nan')
    mass_std: float = float('nan')
    reference: Array | float = 0.0


class _Felt(NamedTuple):
    """Joint state with its external torque; `ratio` is torque divided by threshold."""

    state: ArmState
    now: float
    dt: float
    torque: Array
    threshold: Array
    ratio: Array
    change: Array
    change_ratio: Array


_NOISE = 5.0  # standard deviations of noise that a change at rest must exceed
_FOLLOWING = 0.15  # [s] time constant of a permitted drift of the torque at rest
_SLOW = 0.25  # [s] time constant of the torque that counts as steady
_SETTLING = 0.4  # [s] in which friction relaxes after a motion
_REST_TIME = 0.1  # [s] of rest before its torque is the reference
_AGAINST = 5e-5  # [rad/s] of motion against the torque, which indicates friction
_RELEASED = 0.4  # of the largest change, below which a push at rest has ended
_QUIET = 0.7  # of the threshold, below which a contact has ended
_QUIET_TIME = 0.1  # [s]
_STEADY_TIME = 1.0  # [s] of a constant torque that friction can hold
_SINCE_START = 0.3  # [s]; a torque present from the start is not a push
_ONE_OVER = np.log(2.0)  # gives a confidence of one half at the threshold
_GIVE_UP = 10.0  # [s] of motion with a torque that neither ends nor fits a payload
_CALM = 0.25  # s of such a torque for which 1 s of motion without it makes up
_LONGEST = 12.0  # [s] largest account of such a torque, so that `problem` soon ends after it
_MOVED = 0.2  # [s] of motion, after which a push at rest is one in motion
_HELD = 0.8  # of the largest change, above which a push at rest is still present
_SATURATED = 0.98  # of the largest torque, above which a measured one counts as limited
_DECLARED = 0.3  # [s] between a declaration of a payload and its pick-up
_OFF = 100.0  # share of dry friction with which no torque at rest counts
_BLIND = 0.5  # [s] without a complete window, after which there is a problem
_LATE = 10  # consecutive states with a much earlier time, after which the clock has changed
_UNKNOWN = 1.0  # [s] without states, in which the load may have changed
_FROZEN_ENCODER = (
    'position of {} stays at {:.4g} rad while the joint moves: check the encoder and its cable'
)


class ContactDetector:
    """Detector of contacts in external joint torque, which recognizes payloads and model errors.

    In motion, a joint's external torque counts if it exceeds the bound learnt from free motion. If
    all joints rest, static friction can hide a force, but the drives' torque is constant. A change
    of the torque at rest then counts if no joint moves against it. Friction always opposes motion,
    which distinguishes an arm that starts to move from a pushed arm.

    The torque of a payload, unlike that of a contact, follows gravity and inertia in all postures.
    The detector reports a payload once ten inertial parameters of the last link explain the torque
    in 2 s of motion (`LoadTest`), and then subtracts it until the payload is put down. A torque
    that lasts 10 s of motion is a model error. `problem` also names a torque that returns so often
    that it fills a fifth of the motion; it remains a contact, because a person may be the cause.

    Attributes
    ----------
    events : list of ContactEvent
        All events so far; the last one may not have ended.
    """

    def __init__(
        self,
        external: ExternalTorque,
        bound: ResidualBound,
        settings: ContactSettings | None = None,
        effort_max: npt.ArrayLike = np.inf,
    ) -> None:
        self._external = external
        self._largest = _SATURATED * np.broadcast_to(np.asarray(effort_max, float), external.n)
        self._saturated = ''
        self._bound = bound
        given = settings or ContactSettings()
        share = max(given.rest_share, bound.rest_share)
        self._settings = replace(given, rest_share=share)
        self._load = LoadTest(external, given.payload_mass, given.payload_size)
        self._window = StateWindow()
        self._report: ContactReport | None = None
        self.events: list[ContactEvent] = []
        names = external.dynamics.robot.joint_names
        self._encoders = FrozenSignal(names, _FROZEN_ENCODER)
        self._efforts = FrozenSignal(names, FROZEN_EFFORT)
        self._first: float | None = None
        self._last: float | None = None
        self._late = 0  # consecutive states with an earlier time
        self._blind = 0.0  # [s] since the last complete window
        self._seen = np.zeros(external.n)  # posture at its end
        self._free = 0.0  # [s] without an event
        self._unexplained = 0.0  # [s] of motion with events, less a share of the motion without
        self._declared = np.inf  # [s] since a payload was declared
        self._rest = _Rest(external.n, self._settings)
        self._begin()

    @property
    def event(self) -> ContactEvent | None:
        """Present event that has not ended yet; None without an event."""
        last = self.events[-1] if self.events else None
        return last if last is not None and np.isnan(last.end) else None

    @property
    def problem(self) -> str:
        """Reason why contacts cannot be detected at present; empty if detection is possible."""
        event = self.event
        if self._unexplained > _GIVE_UP:
            event = self.events[-1]
        elif event is not None and event.cause is not Cause.MODEL:
            event = None
        if event is not None:
            return (
                f'the model leaves {np.abs(event.torque).max():.3g} Nm of '
                f'{self._external.dynamics.robot.joint_names[event.joint]} unexplained, which is '
                'neither a contact nor a payload: check that the model belongs to this arm, or '
                'declare the payload'
            )
        watched = self._encoders.problem or self._saturated or self._efforts.problem
        if watched or self._blind < _BLIND:
            return watched
        return (
            'too many joint states are lost, so contacts have not been detectable for '
            f'{self._blind:.1f} s: '
            'check the CPU load and the publisher of joint_states'
        )

    @property
    def payload_mass(self) -> float | None:
        """Mass of the detected undeclared payload [kg], or None."""
        return self._load.mass if self._load.is_loaded else None

    def carry(self, payload: npt.ArrayLike) -> None:
        """Set the payload that the user declares; raise ValueError if it is not physical.

        The declaration may come before or after the pick-up, so no event begins within 0.3 s of it.
        """
        self._external.carry(payload)
        self._load.declare(payload)
        self._declared = self._unexplained = 0.0

    def update(
        self, state: ArmState, now: float, base: BaseMotion | None = None
    ) -> ContactReport | None:
        """Process a joint state at `now` [s]; return the report on the last complete window.

        Returns None until the first window is complete, also after a gap. Re-sent, late and invalid
        states are ignored. If states were lost in at most 1 s, detection continues with the next
        one, and a contact does not end.

        `state.tau` is the drives' torque in the cycle that ends now.
        """
        last = self._last
        if not np.isfinite(state.q.sum() + state.dq.sum() + state.tau.sum()):
            return self._report if last is not None and now - last < _UNKNOWN else None
        if last is not None and now <= last:
            self._late = self._late + 1 if last - now >= LONGEST_GAP else 0
            if self._late < _LATE:
                return self._report
        self._last, self._late = now, 0
        if last is None or not 0.0 < now - last < _UNKNOWN:
            self._start_again(now, last)
            return None
        dt = now - last
        self._blind += dt
        if self._window.has_lost(dt) or self._is_saturated(state):
            # The torque of this time is unknown.
            self._window.reset()
            self._external.rebase(state.q, state.dq, base)
            self._load.rebase(state.q, state.dq, base)
            if self._blind > LONGEST_GAP:
                self._pass_over(state)
            return self._report
        window = self._window.update(state, dt)
        if window is None:
            return self._report
        self._blind, self._seen = 0.0, state.q
        q = np.where(np.abs(state.dq) > MOVING, state.q, np.nan)  # constant at rest as well
        self._encoders.update(q, state.dq, window.dt)
        self._efforts.update(state.tau, state.dq, window.dt)
        if self._encoders.problem or self._efforts.problem:
            self._start_again(now, now)
            return None
        state, dt, _ = window
        row = self._external.update(window, base)
        threshold = self._bound.threshold(row)
        self._load.update(state, dt, row, threshold, base)
        self._report = self._judge(state, now, dt, row, threshold)
        return self._report

    def _is_saturated(self, state: ArmState) -> bool:
        """Return whether a joint's torque is at its limit, where contacts are undetectable."""
        self._saturated = ''
        saturated = np.abs(state.tau) >= self._largest
        if saturated.any():
            joint = int(np.argmax(saturated))
            name = self._external.dynamics.robot.joint_names[joint]
            self._saturated = (
                f'effort of {name} is at its limit of {self._largest[joint] / _SATURATED:.3g} Nm, '
                'where contacts are undetectable: slow the motion or check the load'
            )
        return bool(self._saturated)

    def _pass_over(self, state: ArmState) -> None:
        """Reset the reference torque at rest after a long time without a complete window."""
        if self.event is None:
            self._rest.reset(0.0)
        elif np.abs(state.q - self._seen).max() > self._settings.rest_speed * self._blind:
            self._rest.held, self.event.reference = None, 0.0

    def _start_again(self, now: float, last: float | None) -> None:
        self._free, self._saturated, self._blind = 0.0, '', 0.0
        self._external.reset()
        self._window.reset()
        self._report = None
        self._load.pause()
        self._rest.reset(np.inf)
        self._begin()
        self._first = now
        event = self.event
        if event is not None:
            event.end = now if last is None else max(event.begin, last)

    def _begin(self) -> None:
        self._above = self._below = self._lasting = self._steady = self._moving = 0.0
        self._peak = np.zeros(self._external.n)

    def _judge(
        self, state: ArmState, now: float, dt: float, row: Unexplained, threshold: Array
    ) -> ContactReport:
        assert self._first is not None
        torque = row.residual - self._load.torque
        threshold = threshold + self._load.doubt
        row = row._replace(dry=row.dry + self._load.doubt)  # a load adds friction
        self._declared += dt
        is_new = self._declared < _DECLARED and self.event is None
        if is_new:
            self._rest.reset(0.0)
        if is_new or now - self._first < 5.0 / self._external.gain:
            return ContactReport(torque, np.full_like(torque, np.inf), False, 0.0, None)
        is_event = self.event is not None
        change = self._rest.update(state, torque, dt, row, self._bound, is_event)
        ratio = np.abs(torque) / threshold
        felt = _Felt(state, now, dt, torque, threshold, ratio, *change)
        if self.event is not None:
            self._follow(self.event, felt)
        elif self._load.found or self._load.released:
            self._start(felt, felt.ratio, torque, threshold)
            self._follow(self.events[-1], felt)
        else:
            self._seek(felt)
        event = self.event
        if self._load.is_loaded:
            self._weigh()
        largest = float(max(ratio.max(), np.linalg.norm(felt.change_ratio)))
        cause = None if event is None else event.cause
        confidence = 1.0 - float(np.exp(-_ONE_OVER * largest**2))
        return ContactReport(torque, threshold, cause is Cause.CONTACT, confidence, cause)

    def _seek(self, felt: '_Felt') -> None:
        """Start an event if a threshold has been exceeded for the confirmation time."""
        if np.abs(felt.state.dq).max() > self._settings.rest_speed:
            self._unexplained = max(0.0, self._unexplained - _CALM * felt.dt)
        exceeds = felt.ratio.max() > 1.0
        rests = not exceeds and bool(np.linalg.norm(felt.change_ratio) > 1.0)
        self._above = self._above + felt.dt if exceeds or rests else 0.0
        if self._above == 0.0:
            self._free += felt.dt
            return
        if self._above < self._settings.confirmation + 0.5 * felt.dt:
            return
        size, value, limit = felt.ratio, felt.torque, felt.threshold
        if rests:
            size, value, limit = felt.change_ratio, felt.change, self._rest.limit
        event = self._start(felt, size, value, limit)
        if self._free < _SINCE_START:
            event.cause = Cause.MODEL
        self._load.suspect(felt.torque / felt.threshold, felt.threshold)
        self._rest.hold()
        event.reference = 0.0 if self._rest.held is None else self._rest.held.copy()

    def _start(self, felt: '_Felt', size: Array, value: Array, limit: Array) -> ContactEvent:
        """Start an event with torque `value`, threshold `limit`, and their ratio `size`."""
        joint, q = int(np.argmax(size)), felt.state.q.copy()
        ratio = float(np.linalg.norm(size))
        event = ContactEvent(felt.now, joint, value.copy(), limit.copy(), q, ratio)
        self.events.append(event)
        self._below = self._lasting = self._steady = self._moving = 0.0
        self._peak = np.abs(value)
        return event

    def _follow(self, event: ContactEvent, felt: '_Felt') -> None:
        """Update the present event: largest torque, cause and end."""
        moves = np.abs(felt.state.dq).max() > self._settings.rest_speed
        self._moving = self._moving + felt.dt if moves else 0.0
        if self._moving > _MOVED:
            # Friction no longer holds what it held at rest.
            self._rest.held, event.reference = None, 0.0
        is_rest = self._rest.held is not None
        value, limit = felt.torque, felt.threshold
        if is_rest:
            value, limit = felt.change, self._rest.limit
        share = np.abs(value) / limit
        if share.max() > event.ratio:
            event.torque, event.threshold = value.copy(), limit.copy()
            event.q, event.joint = felt.state.q.copy(), int(np.argmax(share))
            event.ratio = float(share.max())
        self._peak = np.maximum(self._peak, np.abs(value))
        if moves:
            self._lasting += felt.dt
            self._unexplained = min(self._unexplained + felt.dt, _LONGEST)
        if self._load.released:
            event.cause = Cause.RELEASED
            self._end(event, felt.now)
            return
        if self._load.found:
            event.cause = Cause.PAYLOAD
            event.mass, event.mass_std = self._load.mass, self._load.mass_std
            self._end(event, felt.now)
            return
        if self._lasting > _GIVE_UP:
            event.cause = Cause.MODEL
        within = bool(felt.ratio.max() < _QUIET)
        released = within and (not is_rest or self._is_released(value))
        self._below = self._below + felt.dt if released else 0.0
        is_over = within and self._rest.is_steady and not self._is_held(value)
        self._steady = self._steady + felt.dt if is_over else 0.0
        if self._below > _QUIET_TIME or self._steady > _STEADY_TIME:
            self._end(event, felt.now)

    def _pushed(self) -> Array:
        """Return a mask (n,) of the joints on which a push at rest mainly acts."""
        share = self._peak / self._rest.limit
        return np.asarray(share > 0.5 * share.max())

    def _is_released(self, change: Array) -> bool:
        """Return whether most of the external torque caused by a push at rest is gone."""
        falls = np.abs(change) < np.maximum(self._rest.limit, _RELEASED * self._peak)
        return bool(falls[self._pushed()].all())

    def _is_held(self, change: Array) -> bool:
        """Return whether a push at rest continues, for example because a person is clamped.

        After the end of a push, friction holds a part of its torque, but hardly all of it.
        """
        return bool((np.abs(change) > _HELD * self._peak)[self._pushed()].any())

    def _weigh(self) -> None:
        """Update the payload mass in the last event that a payload caused."""
        for event in reversed(self.events):
            if event.cause is Cause.PAYLOAD:
                event.mass, event.mass_std = self._load.mass, self._load.mass_std
                return

    def _end(self, event: ContactEvent, now: float) -> None:
        event.end = now
        self._rest.reset(0.0)
        self._begin()


class _Rest:
    """Monitor of changes of the external torque while all joints rest.

    The reference is the external torque when the arm came to rest, and follows slow drift. Friction
    relaxes after a motion, so the limit of the change is larger at first.
    """

    def __init__(self, n: int, settings: ContactSettings) -> None:
        self._settings = settings
        self._n = n
        self.reset(np.inf)

    def reset(self, since: float) -> None:
        """Restart the comparison of torques at rest; the arm stopped `since` [s] ago."""
        self.held: Array | None = None
        self._reference: Array | None = None
        self._since = since
        self._resting = 0.0
        self._motion = np.zeros(self._n)
        self._slow: Array | None = None
        self.is_steady = False
        self.limit = np.full(self._n, np.inf)

    def hold(self) -> None:
        """Store the present reference torque when a contact begins at rest."""
        self.held = self._reference

    def update(
        self,
        state: ArmState,
        torque: Array,
        dt: float,
        row: Unexplained,
        bound: ResidualBound,
        in_event: bool,
    ) -> tuple[Array, Array]:
        """Return the torque change at rest (n,) [Nm] and its ratio to the limit, or zeros."""
        settings, nothing = self._settings, np.zeros(self._n)
        # Without dry friction, the model's error at rest appears as it does in motion.
        least = np.maximum(settings.rest_share * row.dry, bound.constant - row.dry)
        least = least + _NOISE * bound.noise
        if settings.rest_share >= _OFF:
            least = np.full(self._n, np.inf)
        self._slow = torque if self._slow is None else self._slow
        self._slow = self._slow + min(1.0, dt / _SLOW) * (torque - self._slow)
        self.is_steady = bool((np.abs(torque - self._slow) < least).all())
        self._motion += min(1.0, dt / 0.03) * (state.dq - self._motion)
        if in_event:
            self.limit = least
            return (nothing if self.held is None else torque - self.held), nothing
        if np.abs(state.dq).max() > settings.rest_speed:
            self._reference, self._since, self._resting = None, 0.0, 0.0
            self.limit = least
            return nothing, nothing
        self._since += dt
        self._resting += dt
        if self._reference is None:
            if self._resting >= _REST_TIME:
                self._reference = torque.copy()
            self.limit = least
            return nothing, nothing
        change = torque - self._reference
        self.limit = least + row.dry * np.exp(-self._since / _SETTLING)
        ratio = np.abs(change) / self.limit
        if ratio.max() < 1.0:
            self._reference = self._reference + dt / _FOLLOWING * change
        # Friction opposes motion, a push causes it.
        opposed = np.sign(change) * self._motion < -_AGAINST
        return change, np.where(opposed, 0.0, ratio)


_REST_SHARES = (0.0, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, _OFF)


def with_rest_share(
    bound: ResidualBound,
    external: Callable[[], ExternalTorque],
    motion: Callable[[], Iterable[tuple[float, ArmState]]],
    settings: ContactSettings | None = None,
) -> ResidualBound:
    """Return the bound with a limit at rest that no torque at the start of free motion exceeds.

    A drive builds up torque before a joint breaks loose. The part of this torque that appears
    before the velocity depends on the arm, so it is learnt from free motion too.

    Parameters
    ----------
    external : callable
        Returns a new observer of the arm.
    motion : callable
        Returns times [s] and states of the free motion, from the beginning.
    """
    last = len(_REST_SHARES) - 1

    def begins(step: int) -> bool:
        tried = replace(bound, rest_share=_REST_SHARES[step])
        return _begins_at_rest(ContactDetector(external(), tried, settings), motion())

    first = next((step for step in range(last) if not begins(step)), last)
    # Friction holds another torque before each start, so few starts show less than the largest
    # change. Hence two steps more, unless no start is visible at rest.
    return replace(bound, rest_share=_REST_SHARES[min(first + 2, last) if first else 0])


def _begins_at_rest(detector: ContactDetector, motion: Iterable[tuple[float, ArmState]]) -> bool:
    """Return whether the detector reports an event at rest in a recorded motion."""
    for time, state in motion:
        detector.update(state, time)
        event = detector.event
        if event is not None and isinstance(event.reference, np.ndarray):
            return True
    return False
