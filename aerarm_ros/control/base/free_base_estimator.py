"""What moves a free base: its rotors by their commands, the arm by the model, the rest slowly."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.answer_correction import AnswerCorrection
from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.free_base_motion import FreeBaseMotion
from aerarm_ros.control.base.imu_sample import ImuSample
from aerarm_ros.control.base.imu_watch import ImuWatch
from aerarm_ros.control.base.mount import Mount
from aerarm_ros.control.base.rotor_wrench import RotorWrench
from aerarm_ros.control.checks.gains import non_negative_number, positive
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.arm_state import ArmState

Array = npt.NDArray[np.float64]

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
            return f'neither rotor commands nor IMU, base taken as hovering at weight: {imu}'
        if rotors:
            return f'IMU below {self.correction.sustained_cutoff:.2g} Hz alone: {rotors}'
        return f'rotor commands + IMU below {self.correction.cutoff:g} Hz'

    def problem(self, now: float) -> str:
        """Return what is wrong at `now` [s], '' if nothing."""
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
                    'IMU: a sample is not newer than the one before: one publisher only'
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
                f"the IMU's acceleration is {self.correction.disagreement:.1f} m/s^2 off "
                'what rotor commands, mass and arm bring about: check IMU, drone file and thrust'
            )
        return '' if self.correction.is_ready else 'the IMU has just begun'

    def _rotor_problem(self, now: float) -> str:
        problem = self.rotors.problem(now)
        if problem:
            return problem
        thrust, weight = self.rotors.commanded_force, self.whole.mass * self._weight
        if thrust < _FLYING * weight:
            return f'the rotors carry {100.0 * thrust / weight:.0f} % of the weight: not in flight'
        return ''


def _moved(share: float, change: float) -> float:
    return min(1.0, max(0.0, share + change))
