"""What an IMU may say, slowly, of a predicted acceleration."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import non_negative_number, positive

Array = npt.NDArray[np.float64]

_WARM_UP = 1.0  # [s] of samples before anything is believed
_BIAS_TIME = 5.0  # [s] a drone that accelerates goes on for less
_BAND_TOP = 3.0  # [Hz] of the motion by which the trust is learned
_TRUST_TIME = 10.0  # [s] over which it is learned
_TRUST_MAX = 1.3
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

    def __init__(self, cutoff: float = 0.3, bias: float = 0.2) -> None:
        self.cutoff = positive('cutoff', cutoff)
        self._time_constant = 1.0 / (2.0 * np.pi * self.cutoff)
        self._band_time = 1.0 / (2.0 * np.pi * _BAND_TOP)
        self._bias = non_negative_number('bias', bias) * _LINEAR
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
        self.trust = np.minimum(np.maximum(self._product / self._power, 0.0), _TRUST_MAX)


def _limited(acceleration: Array) -> Array:
    return np.asarray(np.minimum(np.maximum(acceleration, -_LIMIT), _LIMIT))
