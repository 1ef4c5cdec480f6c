"""External joint torque from a momentum observer, and an upper bound of the model errors in it."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import positive
from aerarm_ros.control.compensation import MomentumObserver
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.motion.signals import ArmState, Array
from aerarm_ros.online.joint_friction import JointFriction
from aerarm_ros.online.replay import KnownArm, recorded_states

FEATURES = (
    'constant', 'dry friction', 'dry friction at low speed', 'speed', 'gravity', 'acceleration',
    'jerk',
)  # fmt: skip
"""Quantities from which `ResidualBound` computes the bound, in the order of `shares`."""

LONGEST_GAP = 0.1
"""Longest gap between joint states [s] after which posture and friction count as unchanged."""

WINDOW = 5e-3
"""Length of the windows over which joint states are averaged [s]."""

_CREEPING = 0.012  # [rad/s] below which dry friction may have another direction or be static
_SLOW = 0.05  # [rad/s] below which the model of dry friction may be inaccurate

_LOST = 2.5  # cycles without a state, in which states were lost


class MeanState(NamedTuple):
    """Mean joint state of a window of consecutive cycles.

    Attributes
    ----------
    state : ArmState
        Mean position and velocity, and the torque that acted between this and the former mean.
    dt : float
        Duration [s].
    states : int
        Number of averaged states.
    """

    state: ArmState
    dt: float
    states: int = 1


class StateWindow:
    """Averaging of joint states over windows of 5 ms.

    The velocity of one state has the noise of the encoder's resolution. The mean velocity of a
    window is its travelled distance, in which this noise cancels. The change of mean momentum from
    window to window is the mean force, weighted with a triangle over both windows, so the torque
    has the same weights. States with a longer period pass unchanged.
    """

    def __init__(self) -> None:
        self._states: list[ArmState] = []
        self._cycle = 0.0  # [s], smoothed
        self.reset()

    def reset(self) -> None:
        """Discard the states of the present window, as after a gap in the states."""
        self._states.clear()
        self._lasted = 0.0
        self._former: Array | None = None

    def has_lost(self, dt: float) -> bool:
        """Return whether joint states were lost in the `dt` [s] since the last state."""
        self._cycle = self._cycle or min(dt, LONGEST_GAP)
        is_late = dt > max(WINDOW, _LOST * self._cycle)
        self._cycle += 0.05 * (min(dt, 2.0 * self._cycle) - self._cycle)
        return is_late

    def update(self, state: ArmState, dt: float) -> MeanState | None:
        """Add a joint state after a cycle of `dt` [s]; return the mean of a complete window."""
        self._states.append(state)
        self._lasted += dt
        if self._lasted < WINDOW - 0.5 * dt:
            return None
        count, lasted = len(self._states), self._lasted
        states = np.array(self._states).reshape(count, -1)
        plain, later = np.array([np.ones(count), np.arange(count) / count]) @ states / count
        q, dq, tau = plain.reshape(3, -1)
        later = later.reshape(3, -1)[2]
        former, self._former = self._former, later
        self._states.clear()
        self._lasted = 0.0
        torque = tau - later + (later if former is None else former)
        return MeanState(ArmState(q, dq, torque), lasted, count)


class Unexplained(NamedTuple):
    """Joint torque that the model does not explain, at the time of a joint state.

    Attributes
    ----------
    residual : (n,) ndarray
        Joint torque beyond drives, model and friction [Nm], positive along +q.
    features : (n, 7) ndarray
        Features for the bound of the residual in free motion, see `FEATURES` [Nm or rad/s].
    friction : (n,) ndarray
        Modelled friction, as a magnitude [Nm].
    dry : (n,) ndarray
        Dry friction that may act at rest [Nm].
    """

    residual: Array
    features: Array
    friction: Array
    dry: Array


_STAGE = 1.7  # bandwidth of each of two low-pass filters with the rise time of one of bandwidth 1
_JERK = np.exp(-1.0)  # largest response of two equal low-pass filters to an impulse, of that of one


class ExternalTorque:
    """Momentum observer of external joint torque, with features for the bound of its error.

    A second low-pass filter removes the encoder noise that the observer differentiates. Both are
    1.7 times faster than `gain`, so that a step rises to 90 % in the time of one filter.

    Errors of friction near zero velocity, of inertia and of the torque's timing decay in the
    observer within some time constants, at first slowly because of the two filters. The features
    therefore decay exponentially, delayed by a low-pass filter as fast as one of the two.

    Parameters
    ----------
    gain : float
        Gain K of the observer [1/s].
    dynamics : MovingBaseDynamics, optional
        Model of this arm, by default a new one. Pass it to set a payload.

    Raises
    ------
    ValueError
        If the gain is not positive.
    """

    def __init__(
        self, arm: KnownArm, gain: float, dynamics: MovingBaseDynamics | None = None
    ) -> None:
        self.gain = positive('observer_gain', gain)
        self.dynamics = dynamics or MovingBaseDynamics(arm.robot, arm.rotor_inertia)
        self.n = arm.robot.n
        self._friction = JointFriction(arm)
        self.stage = _STAGE * self.gain
        stages = np.full(self.n, self.stage)
        self._observer = MomentumObserver(self.dynamics, stages, self._friction)
        self.reset()

    def reset(self) -> None:
        """Reset the observer and the features for the bound of its error."""
        self._observer.reset()
        self._momentum: Array | None = None
        self._residual = self._lagging = self._change = self._torque = np.zeros(self.n)
        self._held = self._decaying = np.zeros((self.n, 4))

    def carry(self, payload: npt.ArrayLike) -> None:
        """Set the payload that the user declares; raise ValueError if it is not physical."""
        self.dynamics.carry(payload)
        if self._momentum is not None:
            self.rebase(*self._last)

    def rebase(self, q: Array, dq: Array, base: BaseMotion | None) -> None:
        """Keep the residual unchanged across lost states or the declaration of a payload."""
        if self._momentum is None:
            return
        self._observer.rebase(q, dq, base)
        self._last = q, dq, base
        gained = self.dynamics.fixed.inertia_matrix(q) @ dq - self._momentum
        self._momentum = self._momentum + gained
        self._lagging = self._lagging + gained

    def update(self, window: MeanState, base: BaseMotion | None = None) -> Unexplained:
        """Process a window of joint states; return the unexplained torque at the window's end."""
        state, dt, count = window
        q, dq, tau = state
        self._last = q, dq, base
        share = dt * self.stage / (1.0 + dt * self.stage)
        observed = self._observer.update(state, dt, base)
        self._residual = self._residual + share * (observed - self._residual)
        # One state may contain the torque of another cycle; in a mean this changes little. A change
        # of torque then is an impulse, as is a change of acceleration.
        timing = 1.0 if count == 1 else _JERK / count
        momentum = self.dynamics.fixed.inertia_matrix(q) @ dq
        if self._momentum is None:
            self._momentum = self._lagging = momentum
            self._torque = tau
        change = momentum - self._momentum
        self._lagging = (self._lagging + dt * self.gain * momentum) / (1.0 + dt * self.gain)
        impulse = dt * np.abs(tau - self._torque)
        load = self.dynamics.bias(q, dq, base)
        dry = self._friction.dry(load)
        now = np.column_stack(
            [
                dry * np.maximum(1.0 - np.abs(dq) / _CREEPING, self._friction.deficit(dq)),
                dry * np.maximum(0.0, 1.0 - np.abs(dq) / _SLOW),
                self.gain * np.abs(momentum - self._lagging),
                timing * self.gain * np.maximum(np.abs(change - self._change), impulse),
            ]
        )
        self._momentum, self._change, self._torque = momentum, change, tau
        self._held = np.maximum(now, np.exp(-0.5 * self.gain * dt) * self._held)
        delayed = self._decaying + share * (self._held - self._decaying)
        self._decaying = np.maximum(self._held, delayed)
        creeping, slow, acceleration, jerk = self._decaying.T
        features = np.column_stack(
            [np.ones(self.n), creeping, slow, np.abs(dq), np.abs(load), acceleration, jerk]
        )
        friction = np.abs(self._friction.torque(dq, load))
        return Unexplained(self._residual, features, friction, dry)


_STATIC = 1.25  # smallest ratio of static friction to friction at low speed
_ASYNCHRONOUS = 1.25  # of the jerk: torque and velocity of a sample may differ in time
_SETTLED = 10.0  # time constants of the observer until its start has decayed
_FEWEST = 200  # smallest number of states to learn from
_RESTING = 0.005  # [rad/s]
_FLOOR = 1e-9  # [Nm]
_LEAST = 0.05  # of the residual's RMS, for the constant part


@dataclass(frozen=True, eq=False)
class ResidualBound:
    """Bound of the unexplained joint torque in contact-free motion, as a function of the motion.

    `|residual| <= margin (shares @ features) + friction_spread |friction|`. The shares are the
    smallest that bound every residual of a free motion (one linear program per joint). Friction
    varies with temperature and time more than one recording shows; the term with `friction_spread`
    covers this variation.

    Attributes
    ----------
    shares : (n, 7) ndarray
        Coefficients of the features, not negative, in the order of `FEATURES`.
    noise : (n,) ndarray
        RMS of the residual's changes at rest [Nm].
    gain : float
        Gain of the observer during learning [1/s].
    margin : float
        Factor for motions that differ from the learnt one.
    friction_spread : float
        Relative deviation of friction from the model.
    rest_share : float
        Change of torque at rest at the start of a free motion, as a fraction of dry friction.
    """

    shares: Array
    noise: Array
    gain: float
    margin: float = 1.5
    friction_spread: float = 0.15
    rest_share: float = 0.0

    @classmethod
    def learnt(cls, rows: Iterable[Unexplained], gain: float) -> 'ResidualBound':
        """Learn the tightest bound from the unexplained torque of a contact-free motion.

        Parameters
        ----------
        rows : iterable of Unexplained
            Results of a motion without contact.
        gain : float
            Gain of the observer [1/s].

        Raises
        ------
        IdentificationError
            If there are too few rows.
        """
        kept = list(rows)
        if len(kept) < _FEWEST:
            raise IdentificationError(
                f'{len(kept)} states of free motion are too few to learn thresholds: record at '
                f'least {_FEWEST}, and 20 s of motion that covers the workspace'
            )
        residual = np.array([row.residual for row in kept])
        features = np.array([row.features for row in kept])
        shares = [
            _tightest(np.abs(residual[:, joint]), features[:, joint])
            for joint in range(residual.shape[1])
        ]
        return cls(np.array(shares), _noise(residual, features[:, :, 3].max(axis=1)), gain)

    @property
    def constant(self) -> Array:
        """Constant part (n,) [Nm] of the bound, which does not depend on the motion."""
        return self.margin * self.shares[:, 0]

    def threshold(self, unexplained: Unexplained) -> Array:
        """Return the bound (n,) [Nm]: the largest residual in contact-free motion."""
        features = unexplained.features
        bound = np.einsum('jf,jf->j', features, self.shares)
        dry = features[:, 1] * self.shares[:, 1]  # dry friction has its own margin
        spread = self.friction_spread * unexplained.friction
        return np.asarray(self.margin * (bound - dry) + dry + spread)

    def to_dict(self, joint_names: tuple[str, ...]) -> dict[str, Any]:
        """Return the bound as a dictionary for a YAML file."""
        return {
            'joint_names': list(joint_names),
            'features': list(FEATURES),
            'shares': self.shares.round(6).tolist(),
            'noise': self.noise.round(9).tolist(),
            'observer_gain': self.gain,
            'margin': self.margin,
            'friction_spread': self.friction_spread,
            'rest_share': self.rest_share,
        }

    @classmethod
    def from_dict(
        cls, values: Mapping[str, Any], joint_names: tuple[str, ...], name: str
    ) -> 'ResidualBound':
        """Create a bound from a dictionary by `to_dict`; raise ValueError if it is invalid."""
        advice = 'learn the bound again with contact_estimator --free'
        if values.get('features') != list(FEATURES):
            raise ValueError(f'{name} contains no thresholds of contact detection: {advice}')
        if values.get('joint_names') != list(joint_names):
            raise ValueError(
                f'{name} contains thresholds for the joints {values.get("joint_names")}, not for '
                f'{", ".join(joint_names)}: {advice} for this arm'
            )
        n = len(joint_names)
        try:
            shares = np.array(values['shares'], dtype=float).reshape(n, len(FEATURES))
            noise = np.array(values['noise'], dtype=float).reshape(n)
            keys = ('observer_gain', 'margin', 'friction_spread', 'rest_share')
            numbers = gain, margin, spread, rest = [float(values[key]) for key in keys]
        except (KeyError, TypeError, ValueError):
            raise ValueError(f'a value of {name} is missing or is not a number: {advice}') from None
        every = np.concatenate([shares.ravel(), noise, numbers])
        if not (np.isfinite(every).all() and (every >= 0.0).all() and gain * margin > 0.0):
            raise ValueError(f'values of {name} must be finite and not negative: {advice}')
        return cls(shares, noise, gain, margin, spread, rest)


def free_rows(
    external: ExternalTorque, recording: Recording, is_stopped: Callable[[], bool] = lambda: False
) -> Iterator[Unexplained]:
    """Yield the unexplained torque of a contact-free motion, once the observer has settled.

    Raises
    ------
    IdentificationError
        If the recording has no velocities.
    """
    external.reset()
    last = float(recording.time[0])
    begin, window = last + _SETTLED / external.gain, StateWindow()
    for count, (time, state) in enumerate(recorded_states(recording, is_stopped)):
        dt = time - last if count else float(np.median(np.diff(recording.time)))
        last = time
        if dt > LONGEST_GAP:
            external.reset()
            window.reset()
        elif window.has_lost(dt):  # the torque of this time is unknown
            window.reset()
            external.rebase(state.q, state.dq, None)
            continue
        mean = window.update(state, dt)
        if mean is not None:
            row = external.update(mean)
            if time > begin:
                yield row


def _noise(residual: Array, speed: Array) -> Array:
    """Return the RMS (n,) [Nm] of the residual's fast changes, preferably while joints rest."""
    steps = np.diff(residual, axis=0)
    rests = speed[1:] < _RESTING
    if rests.sum() >= _FEWEST // 4:
        return np.asarray(np.sqrt(np.mean(steps[rests] ** 2, axis=0)) + _FLOOR)
    return np.asarray(np.percentile(np.abs(steps), 30.0, axis=0) + _FLOOR)


def _tightest(size: Array, features: Array) -> Array:
    """Return the coefficients of the bound that has the smallest mean and exceeds all residuals."""
    from scipy.optimize import linprog  # slow import, needed only to learn a bound

    scale = np.maximum(features.max(axis=0), 1e-9)
    least = np.zeros(len(FEATURES))
    least[0] = max(_LEAST * float(np.sqrt(np.mean(size**2))), 1e-6)
    least[1], least[-1] = _STATIC, _ASYNCHRONOUS
    scaled = features / scale
    # A bound that the smallest coefficients already satisfy is not a constraint.
    kept = size > features @ least
    if not kept.any():
        return least
    solution = linprog(
        scaled.mean(axis=0),
        A_ub=-scaled[kept],
        b_ub=-size[kept],
        bounds=[(low, None) for low in least * scale],
        method='highs',
    )
    if solution.x is None:
        raise IdentificationError(
            'no thresholds can be learnt from the free motion, because its effort or velocity is '
            'unusable: record the motion again'
        )
    return np.asarray(solution.x / scale)
