"""Estimate of the base's motion from the drone's IMU, and fallback if the IMU fails."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion, ImuSample, Mount
from aerarm_ros.control.base.feedback_check import OscillationWatch
from aerarm_ros.control.checks import RejectedInputError, non_negative_number, positive
from aerarm_ros.motion.signals import ArmState, Array


class AccelerationEstimate:
    """Estimates acceleration as the derivative of a low-pass filtered velocity.

    Parameters
    ----------
    n : int
        Number of joints, or of axes.
    cutoff : float
        Cut-off frequency [Hz]; the estimate lags by 1 / (2 pi cutoff).

    Raises
    ------
    ValueError
        If the cutoff is not positive.
    """

    def __init__(self, n: int, cutoff: float = 20.0) -> None:
        self._time_constant = 1.0 / (2.0 * np.pi * positive('cutoff', cutoff))
        self._smooth: Array | None = None
        self._rest = np.zeros(n)

    def reset(self) -> None:
        """Reset the low-pass filter; the next velocity initializes it."""
        self._smooth = None

    def update(self, dq: Array, dt: float) -> Array:
        """Process a velocity (n,) [rad/s], `dt` [s] after the last; return the acceleration."""
        if self._smooth is None:
            self._smooth = np.array(dq)
            return self._rest
        ddq: Array = (dq - self._smooth) / (self._time_constant + dt)
        self._smooth = self._smooth + dt * ddq
        return ddq


# [s] for which a trend is extrapolated: longer than the age of a sample on a slow line, but
# shorter than a dropout, where noise would dominate.
_TREND_TIME = 0.02


class BaseMotionPrediction:
    """Extrapolates a measured base motion in time, with the measured angular velocity.

    A vector that is constant in the world rotates in base axes: `dv/dt = -w x v`. At 30 degrees
    and 0.5 Hz gravity rotates by 1.6 mrad per millisecond. Without extrapolation, the age of an
    IMU sample at 250 Hz and a command's delay would double the tracking error. If its trend is
    known, the specific force follows the trend, because a drone's thrust rotates with the base.
    The trends of force and angular acceleration last for 20 ms; then both stay constant.

    Parameters
    ----------
    angular_velocity : (3,) ndarray
        Angular velocity of the base, in base axes [rad/s]; that of `measured` is zero if the base
        is assumed still.
    force_slope : (3,) ndarray, optional
        Rate of the specific force in base axes [m/s^3]; without it the force is assumed constant
        in the world.
    jerk : (3,) ndarray, optional
        Rate of the angular acceleration in base axes [rad/s^3].
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
        """Return the base motion that is predicted for `time` [s] after the measurement.

        The rotation of vectors is exact to second order in the angle.
        """
        if time == 0.0:
            return self._measured
        vectors = self._vectors + time * (self._slopes + time * self._curvatures)
        _, force, rate, spin = self._measured
        trend_time = min(max(time, -_TREND_TIME), _TREND_TIME)
        if self._force_slope is not None:
            vectors[1] = force + trend_time * self._force_slope
        change = trend_time * self._jerk
        # After the trend's time, the last acceleration continues.
        rate = rate + time * (spin + change) - 0.5 * trend_time * change
        return BaseMotion(vectors[0], vectors[1], rate, spin + change)


NONE, ATTITUDE, FULL = 'none', 'attitude', 'full'
HOVER = 'hover'
MODES = (NONE, ATTITUDE, FULL)

# [s] in which a self-excited mode `full` fades to `attitude`; its oscillation is faster.
_CALM_TIME = 0.1
# Cut-off frequency [Hz] of the low-pass on the trends. A drone sways at 1 Hz or less; below this
# frequency the prediction gains more than the IMU's noise costs.
_TREND_CUTOFF = 3.0  # decision 20


class BaseMotionEstimator:
    """Estimates the motion of the arm's base (`BaseMotion`) from IMU samples.

    Mode 'none' uses the configured gravity. Mode 'attitude' rotates gravity with the drone and
    otherwise assumes a still base. Mode 'full' also uses angular rate and specific force. Mode
    'hover' is for feedforward to a drone; it assumes that the specific force is thrust along the
    drone's own axes. The angular acceleration is the filtered derivative of the rate, extrapolated
    by the filter's lag.

    While samples arrive, each is extrapolated by its age (see `BaseMotionPrediction`). Without
    samples, the extrapolation continues for `hold_time`; then the result stays constant and fades
    to the configured gravity. When samples return, the result fades back.

    On a light drone, 'full' can excite oscillations. If the estimator detects them, it fades to
    'attitude' permanently, because in mode 'attitude' the estimator cannot see whether the
    oscillations would return.

    Parameters
    ----------
    gravity_in_base : (3,) array_like
        Configured gravity [m/s^2], for the fallback.
    hold_time : float
        Age [s] up to which the last sample is extrapolated.
    fade_time : float
        Duration [s] of fading between two sources of the motion.
    cutoff : float
        Cut-off frequency of the angular acceleration's low-pass [Hz].
    latency : float
        Age [s] of an IMU sample at reception, set by the user.
    watch : OscillationWatch, optional
        Detector of oscillations in mode 'full'.

    Raises
    ------
    ValueError
        If the mode is unknown, a time is not positive, or the latency is negative.
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
        self._calm: BaseMotionPrediction | None = None  # from the attitude alone, if needed
        self._calm_weight = 0.0

    @property
    def uses_imu(self) -> bool:
        """Whether the estimator's mode uses IMU samples, as all modes except 'none' do."""
        return self.mode != NONE

    def status(self, now: float) -> str:
        """Return which source the base motion has at `now` [s], as text for the diagnostics."""
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
        """Return why a fallback replaces the IMU at `now` [s], or an empty string."""
        source = self.status(now)
        return '' if self.mode == NONE or source == 'IMU' else source

    def observe(self, state: ArmState, now: float) -> None:
        """Process the arm's state at `now` [s], to detect an oscillation of the joint torques."""
        if self._watch is None:
            return
        self._watch.add_torque(state.tau)
        if self._unwatched is not None:
            self._watch.add_sample(self._unwatched)
            self._unwatched = None

    def offer(self, sample: ImuSample, now: float) -> None:
        """Process an IMU sample received at `now` [s].

        Raises
        ------
        RejectedInputError
            If the sample is older than the previous one, or lacks the attitude that the mode
            needs.
        """
        if self.mode == NONE:
            return
        if self.mode == ATTITUDE and sample.attitude is None:
            raise RejectedInputError(
                "IMU: samples have no attitude, which mode 'attitude' needs; use 'full'"
            )
        step = sample.stamp - self._stamp
        # A stamp far in the past means that the clock was set back, so start again.
        if -1.0 < step <= 0.0:
            raise RejectedInputError(
                'IMU: a sample is not newer than the previous one; run only one publisher'
            )
        continues = 0.0 < step < self._hold_time
        self._prediction = self._predict(sample, step if continues else None)
        self._stamp, self._received = sample.stamp, now
        if self._watch is not None:
            self._unwatched = sample
            if self._watch.found:
                self._calm = self._predict_calm(sample)

    def motion(self, now: float, ahead: float = 0.0) -> BaseMotion:
        """Return the base motion at the time `now` + `ahead` [s]; `ahead` may be negative."""
        if self.mode == NONE:
            return self.configured
        age = now - self._received
        # After a clock was set back, an old IMU sample does not count as fresh.
        fresh = abs(age) <= self._hold_time
        # An observer requests past times in between; a step back in time changes nothing.
        elapsed = 0.0 if self._updated is None else max(now - self._updated, 0.0)
        if self._updated is None:
            self._weight = 1.0 if fresh else 0.0
        change = elapsed / self._fade_time
        self._weight = moved(self._weight, change if fresh else -change)
        if self._calm is not None:
            self._calm_weight = moved(self._calm_weight, elapsed / _CALM_TIME)
        self._updated = now
        if self._weight == 0.0:
            return self.configured
        age = min(max(age, -self._hold_time), self._hold_time)
        lead = self._latency + age + ahead
        predicted = self._prediction.after(lead)
        if self._calm is not None:
            predicted = _between(predicted, self._calm.after(lead), self._calm_weight)
        return _between(self.configured, predicted, self._weight)

    def _predict(self, sample: ImuSample, step: float | None) -> BaseMotionPrediction:
        """Return the prediction from an IMU sample that is `step` [s] newer than the last."""
        if self.mode == ATTITUDE:
            return self._predict_calm(sample)
        rotation, rest = self._mount.rotation_imu_to_base, np.zeros(3)
        rate = rotation @ sample.angular_velocity
        force = rotation @ sample.specific_force
        gravity = -force  # the best guess without attitude: the specific force is all gravity
        if sample.attitude is not None:
            gravity = self._mount.gravity_in_base(sample.attitude)
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
        """Return a prediction from attitude alone, or for a level base without attitude."""
        if sample.attitude is None:
            return BaseMotionPrediction(self.configured, np.zeros(3))
        rotation = self._mount.rotation_imu_to_base
        gravity = self._mount.gravity_in_base(sample.attitude)
        return BaseMotionPrediction(BaseMotion.still(gravity), rotation @ sample.angular_velocity)

    def _angular_acceleration(self, rate: Array, step: float | None) -> tuple[Array, Array]:
        """Return angular acceleration and its derivative, zero without a previous sample."""
        if step is None:
            self._spin.reset()
            self._jerk.reset()
            return self._spin.update(rate, 0.0), np.zeros(3)
        spin = self._spin.update(rate, step)
        jerk = self._jerk.update(spin, step)
        # The derivative is late by half a step and the low-pass, so extrapolate it.
        return spin + (0.5 * step + self._time_constant) * jerk, jerk


def moved(weight: float, change: float) -> float:
    """Return the sum of a weight and a change, limited to 0 .. 1."""
    return min(1.0, max(0.0, weight + change))


def _between(first: BaseMotion, second: BaseMotion, weight: float) -> BaseMotion:
    """Interpolate between two base motions; the second one has the weight `weight`, 0 to 1."""
    if weight == 1.0:
        return second
    pairs = zip(first, second, strict=True)
    return BaseMotion(*((1.0 - weight) * one + weight * other for one, other in pairs))
