"""What moves a free base: its rotors by their commands, the arm by the model, the rest slowly."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion, ImuSample, Mount
from aerarm_ros.control.base.rotor_wrench import RotorWrench
from aerarm_ros.control.checks import RejectedInputError, non_negative_number, positive
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import ArmState, Array


class FreeBaseMotion(BaseMotion):
    """A `BaseMotion` whose accelerations lack how the base answers.

    With the answer `M_bb^-1 (w - c_b - M_bj ddq)` of `WholeBodyDynamics`, the base accelerates by
    `s = s_0 + share * answer`: s_0 is `specific_force` and `angular_acceleration`.

    Parameters
    ----------
    motion : BaseMotion
    wrench : (6,) ndarray
        w, of the rotors on the base at its origin, in base axes [N], [Nm].
    share : (6,) ndarray
        How much of the answer is believed, for each component of the acceleration. With none
        the base is moved, whatever rotors and arm do.

    Attributes
    ----------
    wrench, share
        As given.
    """

    wrench: Array
    share: Array

    def __new__(cls, motion: BaseMotion, wrench: Array, share: Array) -> 'FreeBaseMotion':
        """Return a motion with its answer."""
        free = super().__new__(cls, *motion)
        free.wrench = wrench
        free.share = share
        return free


_WARM_UP = 1.0  # [s] of samples before anything is believed
_BIAS_TIME = 5.0  # [s] a drone that accelerates goes on for less
_BAND_TOP = 3.0  # [Hz] of the motion by which the trust is learned
_TRUST_TIME = 10.0  # [s] over which it is learned
_TRUST_MAX = 1.3  # decision 28
# Acceleration below which there is nothing to learn [m/s^2], [rad/s^2]: slow motion under a heavy
# drone is little more, and a prediction that is wrong there costs more than none.
_TRUST_FLOOR = np.repeat([0.03, 0.05], 3)
_LINEAR = np.repeat([1.0, 0.0], 3)  # a gyroscope's bias is no angular acceleration
# What the slow part may add at most [m/s^2], [rad/s^2].
_LIMIT = np.repeat([6.0, 6.0], 3)


class AnswerCorrection:
    """Complementary filter of predicted (x) and measured (y) acceleration of a base.

    Both are deviations from hover, (6,), linear before angular. Below the cutoff counts what is
    measured, above it what is predicted::

        s - s_hover = y_slow + trust (x - x_slow)

    A wrong mass is nearly constant in x, so it stays out; and as y enters below the cutoff only,
    its latency closes no loop. Two more things keep a wrong model from doing harm:

    - What the accelerometer reads on average over 5 s, where that is within `bias`, is taken for
      its bias: a hovering drone feels its weight.
    - `trust` is the least-squares factor from x to y between the cutoff and 3 Hz over the last
      10 s, for each component, 0 to 1.3. Where the prediction explains nothing (wrong inertia,
      commands that rotors do not follow) it fades out; noise of y does not bias it.

    Parameters
    ----------
    cutoff : float
        [Hz]; well below the arm's motion.
    bias : float
        Of the accelerometer, at most [m/s^2].
    trust_min : float
        Least trust, 0 to 1. Wind that the drone's controller answers makes the prediction look
        wrong: where wind is stronger than what the arm does, the model is the better witness.

    Attributes
    ----------
    cutoff : float
        [Hz]
    sustained_cutoff : float
        That of the mean [Hz].
    trust : (6,) ndarray
    slow : (6,) ndarray
        y_slow without bias, limited.
    sustained : (6,) ndarray
        The mean over 5 s without bias, limited: what is left where nothing is predicted. There
        y_slow would be the base's answer, late.
    predicted_slow : (6,) ndarray
        x_slow.
    disagreement : float
        By how much x and y differ below the cutoff [m/s^2]; 0 without predictions.

    Raises
    ------
    ValueError
        If the cutoff isn't positive, or the bias negative.
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
        """Forget everything."""
        zero = np.zeros(6)
        self._seen = self.disagreement = 0.0
        self.predicted_slow = self._measured_slow = zero
        self._predicted_band = self._measured_band = zero
        self._mean = zero
        # As if as much had been seen as there is nothing to learn from, and it was right.
        self._product = self._power = _TRUST_FLOOR**2
        self.trust = np.ones(6)
        self.slow = self.sustained = zero

    @property
    def is_ready(self) -> bool:
        """Whether enough was seen."""
        return self._seen >= _WARM_UP

    def update(self, predicted: Array | None, measured: Array, dt: float) -> None:
        """Take x and y (6,) [m/s^2], [rad/s^2] over the last `dt` [s].

        Without a prediction there is nothing to learn of it, and the next one begins without a
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
        # Nothing turns faster and faster for long.
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


# A drone in flight shakes: the last digits of two samples differ.
_FROZEN = 0.1  # [s]
_FORCE_MAX = 50.0  # [m/s^2]; in flight nothing but the rotors is felt
# What rotors and arm do to a drone within a step, and the share of noise; steps above count alike.
_FORCE_JUMP, _FORCE_SLOPE = 12.0, 1000.0  # [m/s^2], [m/s^3]
_RATE_JUMP, _RATE_SLOPE = 0.4, 100.0  # [rad/s], [rad/s^2]
_STEP_MAX = 0.01  # [s]
_GAP = 0.1  # [s] samples further apart are not neighbours
# How far attitude and gyroscope may differ over some time; what is cut is a filter that was reset.
_TURN_TIME, _TURN_ERROR, _TURN_CUT = 0.2, 1.0, 20.0  # [s], [rad/s], [rad/s]


class ImuWatch:
    """Compares samples with the ones before.

    A reading that jumps is refused for as long as it stays there: only `forget` makes it
    believable, once nothing depends on it any more.
    """

    def __init__(self) -> None:
        self._previous: ImuSample | None = None  # taken or not
        self._changed = {'acceleration': -np.inf, 'angular velocity': -np.inf}
        self._turn_error = np.zeros(3)
        self.forget()

    def forget(self) -> None:
        """Compare the next sample with none taken before."""
        self._taken: ImuSample | None = None

    def check(self, sample: ImuSample) -> None:
        """Take a sample if it is plausible.

        Raises
        ------
        RejectedInputError
            If it repeats what came before for too long, jumps away from the last one taken, turns
            otherwise than its attitude, or is of no drone in flight.
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
                'check its mount and driver'
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
        what = min(self._changed, key=self._changed.__getitem__)
        since = sample.stamp - self._changed[what]
        if since > _FROZEN:
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
    """Return the small turn (3,) [rad], in the IMU's axes, from one quaternion to another."""
    # Twice the vector of the product conj(before) after: numpy's cross costs ten times as much.
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

# IMU samples are compared with the model at most this often [s]; rates are differences over it.
_PERIOD = 3.5e-3
_LONGEST_STEP = 0.1  # [s]
# Between IMU and prediction, below the cutoff [m/s^2]: twice what a mass 20 % wrong makes.
_DISAGREEMENT_MAX = 5.0
_FLYING = 0.5  # of the weight: with less thrust the drone stands on something


class FreeBaseEstimator:
    """Turns rotor commands, IMU samples and joint states into `FreeBaseMotion`.

    An IMU that told a law the base's acceleration as it is would close a loop with the arm's own
    reaction, of a gain of about the arm's mass over the drone's. So the acceleration is predicted
    (`WholeBodyDynamics`, with the rotors' wrench from their commands), and the IMU corrects the
    prediction far below the arm's bandwidth (`AnswerCorrection`). Its gyroscope is used as it is:
    angular velocity enters by centrifugal forces alone.

    Without usable rotor commands the IMU's slow part is all there is; without IMU the base is
    taken as hovering at its weight, level. What is lost or comes back fades.

    Parameters
    ----------
    gravity_in_base : (3,) array_like
        Of a level drone [m/s^2].
    rotors : RotorWrench
    whole : WholeBodyDynamics
        An instance of its own, to be told of a payload.
    mount : Mount
    correction : AnswerCorrection
    hold_time : float
        Age [s] up to which the last IMU sample is believed.
    fade_time : float
        [s]
    latency : float
        Age [s] of a sample when it is received.

    Attributes
    ----------
    rejections : int
        Samples and commands not used.
    last_rejection : str
        Why the last of them wasn't.

    Raises
    ------
    ValueError
        If a time isn't positive, or the latency negative.
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
        self.rejections = 0
        self.last_rejection = ''

    def status(self, now: float) -> str:
        """Return where the base's motion comes from at `now` [s], for diagnostics."""
        imu, rotors = self._imu_problem(now), self._rotor_problem(now)
        if imu:
            return f'neither rotor commands nor IMU, the base is assumed to hover: {imu}'
        if rotors:
            return f'only the IMU, below {self.correction.sustained_cutoff:.2g} Hz: {rotors}'
        return f'rotor commands + IMU below {self.correction.cutoff:g} Hz'

    def problem(self, now: float) -> str:
        """Return the problem at `now` [s], '' if there is none."""
        wrong = self._imu_problem(now) or self._rotor_problem(now)
        return self.status(now) if wrong else ''

    def reject(self, reason: str) -> None:
        """Count a sample that could not be made."""
        self.rejections += 1
        self.last_rejection = reason

    def offer(self, sample: ImuSample, now: float) -> None:
        """Take an IMU sample received at `now` [s]; raises RejectedInputError if it is faulty."""
        step = sample.stamp - self._stamp
        try:
            # A stamp far in the past is a clock that was set back: start anew.
            if -1.0 < step <= 0.0:
                raise RejectedInputError(
                    'IMU: a sample is not newer than the previous one; run only one publisher'
                )
            self._watch.check(sample)
        except RejectedInputError as error:
            self.reject(str(error))
            raise
        rotation = self._mount.rotation_imu_to_base
        self._rate = rotation @ sample.angular_velocity
        self._force_sum = self._force_sum + rotation @ sample.specific_force
        self._count += 1
        if sample.attitude is not None:
            self._gravity = self._mount.gravity_in_base(sample.attitude)
        self._stamp, self._received = sample.stamp, now

    def offer_rotors(self, names: Sequence[str], thrust: Array, stamp: float, now: float) -> None:
        """Take a command of the rotors, see `RotorWrench.offer`."""
        try:
            self.rotors.offer(names, thrust, stamp, now)
        except RejectedInputError as error:
            self.reject(str(error))
            raise

    def observe(self, state: ArmState, now: float) -> None:
        """Compare prediction and IMU, if a sample came, at the arm's state of `now` [s]."""
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
            # In the middle of the step, when what is compared was measured.
            wrench = self.rotors.wrench(now - 0.5 * step - self._latency)
            forces = self.whole.forces(q, dq, ddq, self._rate)
            predicted = self.whole.response(q)[0] @ (wrench - forces[:6]) - self._hover
        self.correction.update(predicted, measured - self._hover, step)

    def motion(self, now: float, ahead: float = 0.0) -> FreeBaseMotion:
        """Return the base's motion `ahead` [s] of `now` [s]; a negative lead is the past."""
        self._fade(now)
        correction = self.correction
        share = self._rotor_share * correction.trust
        slow = self._rotor_share * (correction.slow - correction.sustained) + correction.sustained
        slow = self._imu_share * slow - share * correction.predicted_slow
        offset = self._hover * (1.0 - share) + slow
        # Centrifugal forces without what turns the base would be worse than neither.
        rate = self._rotor_share * self._rate
        motion = BaseMotion(self._gravity, offset[:3], rate, offset[3:])
        return FreeBaseMotion(motion, self.rotors.wrench(now + ahead), share)

    def _fade(self, now: float) -> None:
        """Let what is lost or comes back fade."""
        if now == self._updated:
            return
        change = 0.0 if self._updated is None else self._fade_rate * max(now - self._updated, 0.0)
        self._updated = now
        imu = not self._imu_problem(now)
        rotors = imu and not self._rotor_problem(now)
        self._imu_share = _moved(self._imu_share, change if imu else -change)
        self._rotor_share = _moved(self._rotor_share, change if rotors else -change)
        if not imu and self._imu_share == 0.0:
            self._watch.forget()
            if self.correction.is_ready:
                self.correction.reset()

    def _imu_problem(self, now: float) -> str:
        age = now - self._received
        if np.isinf(age):
            return 'no IMU yet'
        # A clock that was set back doesn't make an IMU fresh.
        if abs(age) > self._hold_time:
            return f'no good IMU sample for {age:.2f} s'
        if self.correction.disagreement > _DISAGREEMENT_MAX:
            return (
                f"the IMU's acceleration differs by {self.correction.disagreement:.1f} m/s^2 "
                'from that predicted by rotor commands, mass and arm; check IMU, drone file and '
                'thrust'
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


def _moved(share: float, change: float) -> float:
    return min(1.0, max(0.0, share + change))
