"""Estimate of a drone's motion from rotor commands and the arm's model, corrected by its IMU."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion, ImuSample, Mount
from aerarm_ros.control.base.base_motion_estimator import moved
from aerarm_ros.control.base.rotor_wrench import RotorWrench
from aerarm_ros.control.checks import RejectedInputError, non_negative_number, positive
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import ArmState, Array


class FreeBaseMotion(BaseMotion):
    """Base motion whose accelerations exclude the base's response to rotors and arm.

    With the response `M_bb^-1 (w - c_b - M_bj ddq)` of `WholeBodyDynamics`, the base accelerates
    by `s = s_0 + share * response`. The term s_0 consists of `specific_force` and
    `angular_acceleration`.

    Parameters
    ----------
    wrench : (6,) ndarray
        Wrench w of the rotors on the base, about the base's origin, in base axes [N], [Nm].
    share : (6,) ndarray
        Weight of the response in each component of the acceleration. With zero the base's motion
        does not depend on rotors and arm.
    """

    wrench: Array
    share: Array

    def __new__(cls, motion: BaseMotion, wrench: Array, share: Array) -> 'FreeBaseMotion':
        """Create a base motion from the rotors' wrench and the weight of the base's response."""
        free = super().__new__(cls, *motion)
        free.wrench = wrench
        free.share = share
        return free


_WARM_UP = 1.0  # [s] of samples before the estimates are used
_BIAS_TIME = 5.0  # [s]; a drone accelerates in one direction for less
_BAND_TOP = 3.0  # [Hz] upper limit of the motion from which the trust is learned
_TRUST_TIME = 10.0  # [s] memory of the learned trust
_TRUST_MAX = 1.3  # decision 28
# Smallest acceleration for learning [m/s^2], [rad/s^2]. Slow motion under a heavy drone causes
# little more, and a wrong prediction would be worse than none.
_TRUST_FLOOR = np.repeat([0.03, 0.05], 3)
_LINEAR = np.repeat([1.0, 0.0], 3)  # a gyroscope's bias is not an angular acceleration
# Limit of the slow part [m/s^2], [rad/s^2].
_LIMIT = np.repeat([6.0, 6.0], 3)


class AnswerCorrection:
    """Complementary filter of the base's predicted acceleration x and measured acceleration y.

    The accelerations x and y are deviations from hover, (6,), linear before angular. Below the
    cut-off frequency the filter uses the measurement, above it the prediction::

        s - s_hover = y_slow + trust (x - x_slow)

    A wrong mass is nearly constant in x, so it has no effect. As y enters only below the cut-off
    frequency, its latency closes no loop. Two more parts limit the effect of a wrong model:

    - The accelerometer's mean over 5 s, limited to `bias`, is its estimated bias, because a
      hovering drone's specific force is its weight.
    - `trust` is the least-squares factor from x to y between the cut-off frequency and 3 Hz over
      the last 10 s, per component, 0 to 1.3. If the prediction explains nothing (wrong inertia,
      rotors that do not follow their commands), `trust` goes to zero. Noise of y does not bias
      `trust`.

    Parameters
    ----------
    cutoff : float
        Cut-off frequency [Hz], well below the arm's motion.
    bias : float
        Largest bias of the accelerometer [m/s^2].
    trust_min : float
        Smallest trust, 0 to 1. If the drone's controller counteracts wind, the prediction looks
        wrong. In wind that is stronger than the arm's reaction, the model is still better than the
        IMU.

    Attributes
    ----------
    cutoff : float
        Cut-off frequency of the filter [Hz].
    sustained_cutoff : float
        Cut-off frequency of the mean over 5 s [Hz].
    slow : (6,) ndarray
        y_slow minus the estimated bias, limited.
    sustained : (6,) ndarray
        Mean of y over 5 s minus the estimated bias, limited. The filter uses this mean without a
        prediction, because y_slow would then be the base's delayed response.
    predicted_slow : (6,) ndarray
        x_slow.
    disagreement : float
        Difference of x and y below the cut-off frequency [m/s^2]; 0 without predictions.

    Raises
    ------
    ValueError
        If the cutoff is not positive, or the bias is negative.
    """

    def __init__(self, cutoff: float = 0.3, bias: float = 0.2, trust_min: float = 0.0) -> None:
        self.cutoff = positive('cutoff', cutoff)
        self._time_constant = 1.0 / (2.0 * np.pi * self.cutoff)
        self._band_time = 1.0 / (2.0 * np.pi * _BAND_TOP)
        self._bias = non_negative_number('bias', bias) * _LINEAR
        self._trust_min = min(non_negative_number('trust_min', trust_min), 1.0)
        self.reset()

    sustained_cutoff = 1.0 / (2.0 * np.pi * _BIAS_TIME)

    def reset(self) -> None:
        """Reset the complementary filter."""
        zero = np.zeros(6)
        self._seen = self.disagreement = 0.0
        self.predicted_slow = self._measured_slow = zero
        self._predicted_band = self._measured_band = zero
        self._mean = zero
        # Initial values as after a correct prediction of the smallest acceleration for learning.
        self._product = self._power = _TRUST_FLOOR**2
        self.trust = np.ones(6)
        self.slow = self.sustained = zero

    @property
    def is_ready(self) -> bool:
        """Whether the filter has processed samples for at least 1 s."""
        return self._seen >= _WARM_UP

    def update(self, predicted: Array | None, measured: Array, dt: float) -> None:
        """Process the base's predicted and measured acceleration, (6,) each, of the last `dt` [s].

        Without a prediction the filter learns nothing, and the next prediction starts without a
        correction.
        """
        is_predicted = predicted is not None
        if predicted is None:
            predicted = measured
        if self._seen == 0.0:
            self.predicted_slow = self._predicted_band = _LINEAR * predicted
            self._measured_slow = self._measured_band = _LINEAR * measured
        self._seen += dt
        slow, band = dt / (self._time_constant + dt), dt / (self._band_time + dt)
        self.predicted_slow = self.predicted_slow + slow * (predicted - self.predicted_slow)
        self._measured_slow = self._measured_slow + slow * (measured - self._measured_slow)
        self.disagreement = float(np.linalg.norm((self._measured_slow - self.predicted_slow)[:3]))
        self._predicted_band = self._predicted_band + band * (predicted - self._predicted_band)
        self._measured_band = self._measured_band + band * (measured - self._measured_band)
        # A plain mean at first.
        share = dt / min(max(self._seen, dt), _BIAS_TIME)
        self._mean = self._mean + share * (measured - self._mean)
        bias = np.minimum(np.maximum(self._mean, -self._bias), self._bias)
        # Angular acceleration cannot last, so its mean is zero.
        self.sustained = _limited(_LINEAR * (self._mean - bias))
        self.slow = _limited(self._measured_slow - bias)
        if self.is_ready and is_predicted:
            self._learn_trust(dt / _TRUST_TIME)

    def _learn_trust(self, share: float) -> None:
        x = self._predicted_band - self.predicted_slow
        y = self._measured_band - self._measured_slow
        floor = _TRUST_FLOOR**2
        self._product = self._product + share * (x * y + floor - self._product)
        self._power = self._power + share * (x * x + floor - self._power)
        self.trust = np.minimum(
            np.maximum(self._product / self._power, self._trust_min), _TRUST_MAX
        )


def _limited(acceleration: Array) -> Array:
    return np.asarray(np.minimum(np.maximum(acceleration, -_LIMIT), _LIMIT))


# Vibration changes the last digits of consecutive samples in flight.
_FROZEN = 0.1  # [s]
_REST = 0.1  # [m/s^2] from the gravity that a resting IMU feels
_FORCE_MAX = 50.0  # [m/s^2]; in flight the rotors cause all specific force
# Largest change by rotors and arm within a step, and the noise per time; larger steps count
# equally.
_FORCE_JUMP, _FORCE_SLOPE = 12.0, 1000.0  # [m/s^2], [m/s^3]
_RATE_JUMP, _RATE_SLOPE = 0.4, 100.0  # [rad/s], [rad/s^2]
_STEP_MAX = 0.01  # [s]
_GAP = 0.1  # [s]; samples further apart are not consecutive
# Largest difference of attitude and gyroscope over a time; a larger one is a reset of the
# autopilot's filter and is clipped.
_TURN_TIME, _TURN_ERROR, _TURN_CUT = 0.2, 1.0, 20.0  # [s], [rad/s], [rad/s]


class ImuWatch:
    """Rejects implausible IMU samples by comparison with earlier samples.

    After a jump, samples are rejected while they stay at the new value. Only `forget` accepts the
    new value, once no estimate depends on the IMU any more.
    """

    def __init__(self) -> None:
        self._previous: ImuSample | None = None  # accepted or not
        self._changed = {'acceleration': -np.inf, 'angular velocity': -np.inf}
        self._turn_error = np.zeros(3)
        self._has_varied = False
        self.forget()

    def forget(self) -> None:
        """Accept the next IMU sample without comparison with earlier samples."""
        self._taken: ImuSample | None = None

    def check(self, sample: ImuSample) -> None:
        """Check an IMU sample, and store it for later comparisons if it is plausible.

        Raises
        ------
        RejectedInputError
            If the sample is frozen, jumps from the last accepted sample, contradicts its attitude,
            or is impossible for a drone in flight.
        """
        previous, self._previous = self._previous, sample
        step = np.inf if previous is None else sample.stamp - previous.stamp
        if previous is not None and 0.0 < step < _GAP:
            self._refuse_frozen(previous, sample)
            self._refuse_turn(previous, sample, step)
        else:
            self._changed = dict.fromkeys(self._changed, sample.stamp)
            self._turn_error = np.zeros(3)
        felt = float(np.linalg.norm(sample.specific_force))
        if felt > _FORCE_MAX:
            raise RejectedInputError(
                f'IMU: the acceleration of {felt:.0f} m/s^2 is more than the rotors can cause; '
                'check mount and driver of the IMU'
            )
        if self._taken is not None:
            _refuse_jump(self._taken, sample, min(max(step, 0.0), _STEP_MAX))
        self._taken = sample

    def _refuse_frozen(self, previous: ImuSample, sample: ImuSample) -> None:
        for what, before, now in (
            ('acceleration', previous.specific_force, sample.specific_force),
            ('angular velocity', previous.angular_velocity, sample.angular_velocity),
        ):
            if np.any(now != before):
                self._changed[what] = sample.stamp
                self._has_varied = True
        what = min(self._changed, key=self._changed.__getitem__)
        since = sample.stamp - self._changed[what]
        # Before take-off, an emulated IMU without noise feels constant gravity.
        stands = abs(float(np.linalg.norm(sample.specific_force)) - 9.81) < _REST
        if since > _FROZEN and (self._has_varied or not stands):
            raise RejectedInputError(
                f'IMU: its {what} is frozen, unchanged for {since:.1f} s; check the driver'
            )

    def _refuse_turn(self, previous: ImuSample, sample: ImuSample, step: float) -> None:
        if previous.attitude is None or sample.attitude is None:
            return
        turn = _turn(previous.attitude, sample.attitude) / step
        error = turn - 0.5 * (previous.angular_velocity + sample.angular_velocity)
        error = np.minimum(np.maximum(error, -_TURN_CUT), _TURN_CUT)
        share = step / (_TURN_TIME + step)
        self._turn_error = self._turn_error + share * (error - self._turn_error)
        size = float(np.linalg.norm(self._turn_error))
        if size > _TURN_ERROR:
            raise RejectedInputError(
                f'IMU: angular velocity and attitude differ by {size:.1f} rad/s; check the '
                'driver, and that both have the same axes'
            )


def _turn(before: Array, after: Array) -> Array:
    """Return the rotation vector (3,) [rad] between two close attitudes, in the IMU's axes."""
    # Twice the vector of the product conj(before) after; numpy's cross takes ten times as long.
    (a, b, c, d), (x, y, z, w) = before.tolist(), after.tolist()
    sign = np.copysign(2.0, a * x + b * y + c * z + d * w)
    turn = (
        d * x - w * a - b * z + c * y,
        d * y - w * b - c * x + a * z,
        d * z - w * c - a * y + b * x,
    )
    return np.array([sign * part for part in turn])


def _refuse_jump(taken: ImuSample, sample: ImuSample, step: float) -> None:
    force = sample.specific_force - taken.specific_force
    rate = sample.angular_velocity - taken.angular_velocity
    for what, change, limit, unit in (
        ('angular velocity', rate, _RATE_JUMP + _RATE_SLOPE * step, 'rad/s'),
        ('acceleration', force, _FORCE_JUMP + _FORCE_SLOPE * step, 'm/s^2'),
    ):
        size = float(np.abs(change).max())
        if size > limit:
            raise RejectedInputError(
                f'IMU: its {what} jumps by {size:.2g} {unit} from one sample to the next; check '
                'cable and driver'
            )


FREE = 'free'

# [s] Shortest interval between comparisons of IMU and model; rates are differences over it.
_PERIOD = 3.5e-3
_LONGEST_STEP = 0.1  # [s]
# [m/s^2] between IMU and prediction, below the cut-off frequency: twice the effect of a mass error
# of 20 %.
_DISAGREEMENT_MAX = 5.0
_FLYING = 0.5  # of the weight; with less thrust the drone stands on the ground


class FreeBaseEstimator:
    """Estimates the motion of a drone under the arm from rotor commands, IMU and joint states.

    A control law that used the IMU's acceleration directly would close a loop with the arm's own
    reaction. The gain of that loop is about the arm's mass divided by the drone's mass. The
    estimator therefore predicts the base acceleration (`WholeBodyDynamics`, with the rotors'
    wrench from their commands). The IMU corrects the prediction far below the arm's bandwidth
    (`AnswerCorrection`). The gyroscope is used directly, because angular velocity only enters the
    centrifugal forces.

    Without valid rotor commands the estimate is the IMU's slow part. Without IMU the base is
    assumed to hover level. Changes between these cases fade.

    Parameters
    ----------
    gravity_in_base : (3,) array_like
        Gravity of a level drone [m/s^2].
    whole : WholeBodyDynamics
        An instance for this estimator alone; the caller sets its payload.
    hold_time : float
        Age [s] up to which the last IMU sample is used.
    fade_time : float
        Duration [s] of fading when an input is lost or returns.
    latency : float
        Age [s] of an IMU sample at reception.

    Attributes
    ----------
    rotors : RotorWrench
        Receives the rotor commands.
    contact : (6,) ndarray
        Known wrench of a contact on drone and arm, about the base's origin, in base axes [N], [Nm].
        It acts like a wrench of the rotors, without delay; set it whenever it changes.

    Raises
    ------
    ValueError
        If a time is not positive, or the latency is negative.
    """

    mode = FREE
    uses_imu = True

    def __init__(
        self,
        gravity_in_base: npt.ArrayLike,
        rotors: RotorWrench,
        whole: WholeBodyDynamics,
        mount: Mount,
        correction: AnswerCorrection | None = None,
        hold_time: float = 0.1,
        fade_time: float = 0.5,
        latency: float = 0.0,
    ) -> None:
        self.configured = BaseMotion.still(gravity_in_base)
        self.rotors = rotors
        self.whole = whole
        self.correction = correction or AnswerCorrection()
        self._hover = np.concatenate([self.configured.specific_force, np.zeros(3)])
        self._weight = float(np.linalg.norm(self._hover))  # of 1 kg
        self._mount = mount
        self._hold_time = positive('hold_time', hold_time)
        self._fade_rate = 1.0 / positive('fade_time', fade_time)
        self._latency = non_negative_number('latency', latency)
        self._watch = ImuWatch()
        self._zero = np.zeros(whole.n)
        self._stamp = self._received = -np.inf
        self._gravity = self.configured.gravity
        self._rate = np.zeros(3)
        self._force_sum, self._count = np.zeros(3), 0  # of the samples since the last comparison
        self._compared: tuple[float, Array, Array] | None = None
        self._updated: float | None = None
        self._imu_share = self._rotor_share = 0.0
        self.contact = np.zeros(6)

    def status(self, now: float) -> str:
        """Return text for the diagnostics: the source of the base motion at `now` [s]."""
        imu, rotors = self._imu_problem(now), self._rotor_problem(now)
        if imu:
            return (
                f'neither rotor commands nor IMU are used, and the base is assumed to hover: {imu}'
            )
        if rotors:
            return f'only the IMU, below {self.correction.sustained_cutoff:.2g} Hz: {rotors}'
        return f'rotor commands + IMU below {self.correction.cutoff:g} Hz'

    def problem(self, now: float) -> str:
        """Return a text on the input that is missing or invalid at `now` [s], or ''."""
        wrong = self._imu_problem(now) or self._rotor_problem(now)
        return self.status(now) if wrong else ''

    def offer(self, sample: ImuSample, now: float) -> None:
        """Process an IMU sample received at `now` [s]; raise RejectedInputError if invalid."""
        step = sample.stamp - self._stamp
        # A stamp far in the past means that the clock was set back, so start again.
        if -1.0 < step <= 0.0:
            raise RejectedInputError(
                'IMU: a sample is not newer than the previous one; run only one publisher'
            )
        self._watch.check(sample)
        rotation = self._mount.rotation_imu_to_base
        self._rate = rotation @ sample.angular_velocity
        self._force_sum = self._force_sum + rotation @ sample.specific_force
        self._count += 1
        if sample.attitude is not None:
            self._gravity = self._mount.gravity_in_base(sample.attitude)
        self._stamp, self._received = sample.stamp, now

    def observe(self, state: ArmState, now: float) -> None:
        """Compare the predicted with the measured base acceleration after a new IMU sample."""
        q, dq, _ = state
        if self._count == 0:
            return
        last = self._compared
        step = _LONGEST_STEP if last is None else now - last[0]
        if 0.0 <= step < _PERIOD:
            return
        force = self._force_sum / self._count
        self._force_sum, self._count = np.zeros(3), 0
        self._compared = (now, np.array(dq), self._rate)
        if last is None or not 0.0 < step < _LONGEST_STEP:
            return
        spin = (self._rate - last[2]) / step
        ddq = (dq - last[1]) / step
        force = force + self._mount.acceleration_of_base(self._rate, spin)
        measured = np.concatenate([force, spin])
        predicted = None
        if not self._rotor_problem(now):
            # The middle of the step, at the time of the measurement.
            wrench = self.rotors.wrench(now - 0.5 * step - self._latency) + self.contact
            forces = self.whole.forces(q, dq, ddq, self._rate)
            predicted = self.whole.response(q)[0] @ (wrench - forces[:6]) - self._hover
        self.correction.update(predicted, measured - self._hover, step)

    def motion(self, now: float, ahead: float = 0.0) -> FreeBaseMotion:
        """Return the base motion at the time `now` + `ahead` [s]; `ahead` may be negative."""
        self._fade(now)
        correction = self.correction
        share = self._rotor_share * correction.trust
        slow = self._rotor_share * (correction.slow - correction.sustained) + correction.sustained
        slow = self._imu_share * slow - share * correction.predicted_slow
        offset = self._hover * (1.0 - share) + slow
        # Centrifugal forces without their cause would be worse than neither.
        rate = self._rotor_share * self._rate
        motion = BaseMotion(self._gravity, offset[:3], rate, offset[3:])
        return FreeBaseMotion(motion, self.rotors.wrench(now + ahead) + self.contact, share)

    def _fade(self, now: float) -> None:
        """Fade out the effect of lost inputs, and fade in the effect of restored inputs."""
        if now == self._updated:
            return
        change = 0.0 if self._updated is None else self._fade_rate * max(now - self._updated, 0.0)
        self._updated = now
        imu = not self._imu_problem(now)
        rotors = imu and not self._rotor_problem(now)
        self._imu_share = moved(self._imu_share, change if imu else -change)
        self._rotor_share = moved(self._rotor_share, change if rotors else -change)
        if not imu and self._imu_share == 0.0:
            self._watch.forget()
            if self.correction.is_ready:
                self.correction.reset()

    def _imu_problem(self, now: float) -> str:
        age = now - self._received
        if np.isinf(age):
            return 'no IMU yet'
        # After a clock was set back, an old IMU sample does not count as fresh.
        if abs(age) > self._hold_time:
            return f'no good IMU sample for {age:.2f} s'
        if self.correction.disagreement > _DISAGREEMENT_MAX:
            return (
                f"the IMU's acceleration differs by {self.correction.disagreement:.1f} m/s^2 "
                'from that predicted by rotor commands, mass and arm; check IMU, drone file and '
                'the published thrusts'
            )
        return '' if self.correction.is_ready else 'the IMU has just started'

    def _rotor_problem(self, now: float) -> str:
        problem = self.rotors.problem(now)
        if problem:
            return problem
        thrust, weight = self.rotors.commanded_force, self.whole.mass * self._weight
        if thrust < _FLYING * weight:
            return (
                f'the rotors carry {100.0 * thrust / weight:.0f} % of the weight, so the '
                'drone is not in flight'
            )
        return ''
