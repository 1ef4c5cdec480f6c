"""The base's motion from the drone's IMU, with a way back when the IMU fails."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion, ImuSample, Mount
from aerarm_ros.control.base.feedback_check import OscillationWatch
from aerarm_ros.control.checks import RejectedInputError, non_negative_number, positive
from aerarm_ros.motion.signals import ArmState, Array


class AccelerationEstimate:
    """Derivative of the velocity, through a first-order low-pass.

    Parameters
    ----------
    n : int
        Number of joints, or of axes.
    cutoff : float
        [Hz]; the estimate lags by 1 / (2 pi cutoff).

    Raises
    ------
    ValueError
        If the cutoff isn't positive.
    """

    def __init__(self, n: int, cutoff: float = 20.0) -> None:
        self._time_constant = 1.0 / (2.0 * np.pi * positive('cutoff', cutoff))
        self._smooth: Array | None = None
        self._rest = np.zeros(n)

    def reset(self) -> None:
        """Forget the past; the next velocity initialises the filter."""
        self._smooth = None

    def update(self, dq: Array, dt: float) -> Array:
        """Return ddq (n,) [rad/s^2] after a cycle of `dt` [s] with velocity `dq` [rad/s]."""
        if self._smooth is None:
            self._smooth = np.array(dq)
            return self._rest
        ddq: Array = (dq - self._smooth) / (self._time_constant + dt)
        self._smooth = self._smooth + dt * ddq
        return ddq


# How long a trend is believed [s]: over the age of a sample on a slow line, but not over a dropout,
# where its noise would count for more than what it says.
_TREND_TIME = 0.02


class BaseMotionPrediction:
    """Turns a measured motion on with the measured rate.

    What is constant in the world turns against the base: `dv/dt = -w x v` in base axes. At
    30 degrees and 0.5 Hz gravity turns by 1.6 mrad a millisecond, so an IMU of 250 Hz and the
    delay of a command would cost as much as the rest of a tracking error. The specific force
    follows its own trend where that is known: of a drone it is the thrust, which turns along. The
    trends of force and angular acceleration go on for 20 ms, then both stay.

    Parameters
    ----------
    measured : BaseMotion
    angular_velocity : (3,) ndarray
        Of the base, in base axes [rad/s]; that of `measured` is zero where the base is taken
        for still.
    force_slope : (3,) ndarray, optional
        Rate at which the specific force changes in the base [m/s^3]; without it the force is
        taken for constant in the world.
    jerk : (3,) ndarray, optional
        Rate at which the angular acceleration changes in the base [rad/s^3].
    """

    def __init__(
        self,
        measured: BaseMotion,
        angular_velocity: Array,
        force_slope: Array | None = None,
        jerk: Array | None = None,
    ) -> None:
        self._measured = measured
        x, y, z = angular_velocity.tolist()
        # v W = w x v for rows v; the first terms of v exp(-W t).
        turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        self._vectors = np.array(measured[:2])
        self._slopes = -self._vectors @ turn
        self._curvatures = -0.5 * self._slopes @ turn
        self._force_slope = force_slope
        self._jerk = np.zeros(3) if jerk is None else jerk

    def after(self, time: float) -> BaseMotion:
        """Return the motion `time` [s] after the measurement.

        What turns is exact to second order in the angle by which the base turns meanwhile.
        """
        if time == 0.0:
            return self._measured
        vectors = self._vectors + time * (self._slopes + time * self._curvatures)
        _, force, rate, spin = self._measured
        trend_time = min(max(time, -_TREND_TIME), _TREND_TIME)
        if self._force_slope is not None:
            vectors[1] = force + trend_time * self._force_slope
        change = trend_time * self._jerk
        # Beyond the trend's time the last acceleration goes on.
        rate = rate + time * (spin + change) - 0.5 * trend_time * change
        return BaseMotion(vectors[0], vectors[1], rate, spin + change)


NONE, ATTITUDE, FULL = 'none', 'attitude', 'full'
HOVER = 'hover'
MODES = (NONE, ATTITUDE, FULL)

# Within which what excites itself fades to the attitude [s]: its oscillation changes faster.
_CALM_TIME = 0.1
# Low-pass of what is told of the next milliseconds [Hz]: a drone sways at 1 Hz or less, and below
# this corner the prediction gains more than the IMU's noise costs.
_TREND_CUTOFF = 3.0  # decision 20


class BaseMotionEstimator:
    """Turns IMU samples into `BaseMotion`.

    Modes: 'none' uses the configured gravity; 'attitude' turns gravity with the drone and
    takes the base for still otherwise; 'full' also uses angular rate and specific force.
    'hover', for those that tell a drone of the arm, takes it for hovering: what is felt is thrust
    along its own axes, whatever it does.
    Angular acceleration is the filtered derivative of the rate, brought forward by the lag of the
    filter.

    While samples come the result follows them, each turned on with its rate for as long as
    it is old (see `BaseMotionPrediction`). When they stop this goes on for `hold_time`, then
    the result stays and fades to the configured gravity; when they come back it fades back.

    On a light drone 'full' excites itself. Where that is found, it fades to 'attitude', and stays
    there: without the loop nothing tells whether it would excite itself again.

    Parameters
    ----------
    gravity_in_base : (3,) array_like
        Configured gravity [m/s^2], the way back.
    mode : str
    mount : Mount
    hold_time : float
        Age [s] up to which the last sample is held.
    fade_time : float
        [s]
    cutoff : float
        Of the angular acceleration's low-pass [Hz].
    latency : float
        Age [s] of a sample when it is received, known to the user alone.
    watch : OscillationWatch, optional
        Looks whether 'full' excites itself.

    Attributes
    ----------
    rejections : int
        Samples not used.
    last_rejection : str
        Why the last of them wasn't.

    Raises
    ------
    ValueError
        If the mode is unknown, a time isn't positive, or the latency negative.
    """

    def __init__(
        self,
        gravity_in_base: npt.ArrayLike,
        mode: str = FULL,
        mount: Mount | None = None,
        hold_time: float = 0.1,
        fade_time: float = 0.5,
        cutoff: float = 60.0,
        latency: float = 0.0,
        watch: OscillationWatch | None = None,
    ) -> None:
        if mode not in (*MODES, HOVER):
            raise ValueError(f'mode = {mode!r} must be one of {", ".join(MODES)}')
        self.mode = mode
        self.configured = BaseMotion.still(gravity_in_base)
        self._mount = Mount.aligned() if mount is None else mount
        self._hold_time = positive('hold_time', hold_time)
        self._fade_time = positive('fade_time', fade_time)
        self._time_constant = 1.0 / (2.0 * np.pi * positive('cutoff', cutoff))
        self._latency = non_negative_number('latency', latency)
        self._spin = AccelerationEstimate(3, cutoff)
        self._jerk = AccelerationEstimate(3, _TREND_CUTOFF)
        self._force_slope = AccelerationEstimate(3, _TREND_CUTOFF)
        self._prediction = BaseMotionPrediction(self.configured, np.zeros(3))
        self._stamp = -np.inf
        self._received = -np.inf
        self._updated: float | None = None
        self._weight = 0.0
        self._watch = watch if mode == FULL else None
        self._unwatched: ImuSample | None = None
        self._calm: BaseMotionPrediction | None = None  # by attitude alone, once it is needed
        self._calm_weight = 0.0
        self.rejections = 0
        self.last_rejection = ''

    @property
    def uses_imu(self) -> bool:
        """Whether IMU samples change anything."""
        return self.mode != NONE

    def status(self, now: float) -> str:
        """Return where the motion comes from at `now` [s], for diagnostics."""
        if self.mode == NONE:
            return 'configured gravity'
        age = now - self._received
        if abs(age) <= self._hold_time:
            if self._watch is not None and self._watch.found:
                return (
                    f"IMU, only its attitude until restart: {self._watch.found}, because 'full' "
                    "is unstable on a light drone; set drone_file and base_motion 'free'"
                )
            return 'IMU'
        if np.isinf(age):
            return 'no IMU sample yet: using the configured gravity'
        return f'no IMU sample for {age:.2f} s: using the configured gravity'

    def problem(self, now: float) -> str:
        """Return the problem at `now` [s], '' if there is none."""
        source = self.status(now)
        return '' if self.mode == NONE or source == 'IMU' else source

    def observe(self, state: ArmState, now: float) -> None:
        """Take the arm's state at `now` [s], to watch its torques."""
        if self._watch is None:
            return
        self._watch.add_torque(state.tau)
        if self._unwatched is not None:
            self._watch.add_sample(self._unwatched)
            self._unwatched = None

    def reject(self, reason: str) -> None:
        """Count a sample that could not be made."""
        self.rejections += 1
        self.last_rejection = reason

    def offer(self, sample: ImuSample, now: float) -> None:
        """Take a sample received at `now` [s].

        Raises
        ------
        RejectedInputError
            If it is older than the one before, or lacks the attitude that the mode needs.
        """
        if self.mode == NONE:
            return
        if self.mode == ATTITUDE and sample.attitude is None:
            self._refuse("IMU: samples have no attitude, which mode 'attitude' needs; use 'full'")
        step = sample.stamp - self._stamp
        # A stamp far in the past is a clock that was set back: start anew.
        if -1.0 < step <= 0.0:
            self._refuse('IMU: a sample is not newer than the previous one; run only one publisher')
        continues = 0.0 < step < self._hold_time
        self._prediction = self._predict(sample, step if continues else None)
        self._stamp, self._received = sample.stamp, now
        if self._watch is not None:
            self._unwatched = sample
            if self._watch.found:
                self._calm = self._predict_calm(sample)

    def motion(self, now: float, ahead: float = 0.0) -> BaseMotion:
        """Return the base's motion `ahead` [s] of `now` [s]; a negative lead is the past."""
        if self.mode == NONE:
            return self.configured
        age = now - self._received
        # A clock that was set back doesn't make an IMU fresh.
        fresh = abs(age) <= self._hold_time
        # An observer asks for the past in between: time that went back changes nothing.
        elapsed = 0.0 if self._updated is None else max(now - self._updated, 0.0)
        if self._updated is None:
            self._weight = 1.0 if fresh else 0.0
        change = elapsed / self._fade_time
        self._weight = _moved(self._weight, change if fresh else -change)
        if self._calm is not None:
            self._calm_weight = _moved(self._calm_weight, elapsed / _CALM_TIME)
        self._updated = now
        if self._weight == 0.0:
            return self.configured
        age = min(max(age, -self._hold_time), self._hold_time)
        lead = self._latency + age + ahead
        predicted = self._prediction.after(lead)
        if self._calm is not None:
            predicted = _between(predicted, self._calm.after(lead), self._calm_weight)
        return _between(self.configured, predicted, self._weight)

    def _refuse(self, reason: str) -> None:
        self.reject(reason)
        raise RejectedInputError(reason)

    def _predict(self, sample: ImuSample, step: float | None) -> BaseMotionPrediction:
        """Return the motion from a sample on, `step` [s] after the one before."""
        rotation, rest = self._mount.rotation_imu_to_base, np.zeros(3)
        rate = rotation @ sample.angular_velocity
        force = rotation @ sample.specific_force
        if sample.attitude is None:
            gravity = -force  # the best guess without attitude: what is felt is gravity
        else:
            gravity = self._mount.gravity_in_base(sample.attitude)
        if self.mode == ATTITUDE:
            return self._predict_calm(sample)
        if self.mode == HOVER:
            thrust = self.configured.specific_force
            return BaseMotionPrediction(BaseMotion(gravity, thrust, rate, np.zeros(3)), rate, rest)
        spin, jerk = self._angular_acceleration(rate, step)
        force = force + self._mount.acceleration_of_base(rate, spin)
        motion = BaseMotion(gravity, force, rate, spin)
        if step is None:
            self._force_slope.reset()
        slope = self._force_slope.update(motion.specific_force, step or 0.0)
        return BaseMotionPrediction(motion, rate, None if step is None else slope, jerk)

    def _predict_calm(self, sample: ImuSample) -> BaseMotionPrediction:
        """Return the motion from a sample on by its attitude, level if it has none."""
        if sample.attitude is None:
            return BaseMotionPrediction(self.configured, np.zeros(3))
        rotation = self._mount.rotation_imu_to_base
        gravity = self._mount.gravity_in_base(sample.attitude)
        return BaseMotionPrediction(BaseMotion.still(gravity), rotation @ sample.angular_velocity)

    def _angular_acceleration(self, rate: Array, step: float | None) -> tuple[Array, Array]:
        """Return angular acceleration and its rate; zeros if there is no sample before."""
        if step is None:
            self._spin.reset()
            self._jerk.reset()
            return self._spin.update(rate, 0.0), np.zeros(3)
        spin = self._spin.update(rate, step)
        jerk = self._jerk.update(spin, step)
        # The derivative is that of a while ago: half a step, and the low-pass.
        return spin + (0.5 * step + self._time_constant) * jerk, jerk


def _moved(weight: float, change: float) -> float:
    return min(1.0, max(0.0, weight + change))


def _between(first: BaseMotion, second: BaseMotion, weight: float) -> BaseMotion:
    """Return what lies between two motions, the second at weight 1."""
    if weight == 1.0:
        return second
    pairs = zip(first, second, strict=True)
    return BaseMotion(*((1.0 - weight) * one + weight * other for one, other in pairs))
