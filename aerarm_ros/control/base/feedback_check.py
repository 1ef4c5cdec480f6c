"""Stability check of a controller that uses the acceleration of the drone's IMU.

On a light drone the IMU measures mainly the reaction to the arm's own torques.
"""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.checks import positive
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import Array

_POSTURES = 200
# A loop whose gain is below one at every frequency is stable with any delay (small-gain theorem).
# The prediction of trends raises the gain of the IMU's path to 1.15; the margin is 1.3.
LARGEST_GAIN = 0.67  # decision 28


def check_feedback(drone: DroneConfig, whole: WholeBodyDynamics) -> None:
    """Check that a controller that uses the base's measured acceleration is stable.

    Parameters
    ----------
    whole : WholeBodyDynamics
        Model of drone, arm and payload; a payload far from the base counts more than its mass.

    Raises
    ------
    ValueError
        If the loop of arm torque, base acceleration and IMU has too much gain.
    """
    robot = whole.robot
    low, high = np.maximum(robot.position_min, -np.pi), np.minimum(robot.position_max, np.pi)
    postures = np.random.default_rng(0).uniform(low, high, (_POSTURES, robot.n))
    gain = max(whole.feedback_gain(q) for q in postures)
    if gain > LARGEST_GAIN:
        raise ValueError(
            f"base_motion 'full' on {drone.name} ({drone.mass:g} kg) is unstable: the IMU feeds "
            f"the arm's torque back with a gain of {gain:.2g} (limit {LARGEST_GAIN:g}); use "
            "'free' or 'attitude'"
        )


# [Hz] Slower motion is the drone's flight or the arm's motion. The loop oscillates at half the
# inverse of its delay: 125 Hz with an IMU of 250 Hz, 30 Hz with 10 ms more delay.
_CUTOFF = 8.0  # decision 34
_WINDOW = 0.1  # [s]
_SAMPLES = 25  # smallest number in the window; fewer may agree by chance
_TORQUE = 0.25  # RMS over effort_max; the noise of a cheap IMU causes less
_EXPLAINED = 0.6  # explained fraction of the base's motion; about 0 for noise
_LASTING = 0.1  # [s]
_LONGEST_STEP = 0.1  # [s]
# Motion of the base below which it counts as still, per axis [m/s^2], [rad/s].
_STILL = np.repeat([0.1, 0.01], 3)
_RIDGE = 1e-3  # regularization: at half the IMU's rate two consecutive torques are collinear


class OscillationWatch:
    """Detects that joint torques and base oscillate together above 8 Hz.

    If torques follow an IMU that their own reaction moves, torques and base oscillate together.
    For any delay of the loop, each IMU sample y then follows from the torques x before it::

        y_k = b_0 x_k + b_1 x_(k-1)

    because two samples determine a sine. The detector reports an oscillation if two conditions
    hold for 0.1 s. First, the torques of a joint explain most of the power of y on an axis.
    Second, x is a large fraction of the drive's torque limit. Torques follow the IMU's noise too,
    but later noise does not follow the torques; the intended motion of a base is slower. Powers
    are means over 0.1 s, or over 25 samples if those take longer.

    Parameters
    ----------
    effort_max : (n,) array_like
        Torque limits of the drives [Nm].

    Attributes
    ----------
    found : str
        Description of the detected oscillation, or ''. The text stays after the oscillation ends.
    """

    def __init__(self, effort_max: npt.ArrayLike) -> None:
        self._effort_max = np.array(effort_max, dtype=float)
        n = self._n = len(self._effort_max)
        for value in self._effort_max:
            positive('effort_max', value)
        self._time_constant = 1.0 / (2.0 * np.pi * _CUTOFF)
        self._sum, self._count = np.zeros(n), 0
        self._stamp = -np.inf
        self._row = np.zeros(2 * n + 6)
        self._slow = self._slower = np.zeros(n + 6)
        self._moments = np.zeros((2 * n + 6, 2 * n + 6))
        self._since = np.inf  # stamp since which it has lasted
        self.found = ''

    def add_torque(self, tau: Array) -> None:
        """Add the joint torques (n,) [Nm] of a cycle; NaN marks an unmeasured torque."""
        if not self.found:
            self._sum = self._sum + (tau if np.isfinite(tau.sum()) else np.nan_to_num(tau))
            self._count += 1

    def add_sample(self, sample: ImuSample) -> None:
        """Process an IMU sample and the mean torques since the previous IMU sample."""
        if self.found or self._count == 0:
            return
        n, step = self._n, sample.stamp - self._stamp
        self._stamp = sample.stamp
        raw = np.empty(n + 6)
        raw[:n] = self._sum / (self._count * self._effort_max)
        raw[n : n + 3], raw[n + 3 :] = sample.specific_force, sample.angular_velocity
        self._sum, self._count = np.zeros(n), 0
        if not 0.0 < step < _LONGEST_STEP:
            self._begin(raw)
            return
        share = step / (self._time_constant + step)
        self._slow = self._slow + share * (raw - self._slow)
        fast = raw - self._slow
        self._slower = self._slower + share * (fast - self._slower)
        fast = fast - self._slower
        row = self._row
        row[n : 2 * n] = row[:n]
        row[:n], row[2 * n :] = fast[:n], fast[n:]
        share = min(step / _WINDOW, 1.0 / _SAMPLES)
        self._moments += share * (np.multiply.outer(row, row) - self._moments)
        self._judge()

    def _begin(self, raw: Array) -> None:
        self._slow, self._slower = raw, np.zeros(len(raw))
        self._row[:], self._moments[:] = 0.0, 0.0
        self._since = np.inf

    def _judge(self) -> None:
        power = self._moments.diagonal()[: self._n]
        if power.max() < _TORQUE**2:
            self._since = np.inf
            return
        explained = np.where(power < _TORQUE**2, 0.0, self._explained().max(axis=1))
        if explained.max() < _EXPLAINED:
            self._since = np.inf
            return
        self._since = min(self._since, self._stamp)
        if self._stamp - self._since >= _LASTING:
            joint = int(explained.argmax())
            torque = np.sqrt(power[joint]) * self._effort_max[joint]
            self.found = (
                f'the torque of joint {joint + 1} ({torque:.1f} Nm RMS above {_CUTOFF:g} Hz) '
                "oscillated together with the base's acceleration"
            )

    def _explained(self) -> Array:
        """Return the fraction (n, 6) of each IMU axis' power that each joint torque explains."""
        n, moments = self._n, self._moments
        now, before = slice(0, n), slice(n, 2 * n)
        power = moments.diagonal()
        x, last = power[now, None] * (1.0 + _RIDGE), power[before, None] * (1.0 + _RIDGE)
        both = moments[now, before].diagonal()[:, None]
        first, second = moments[now, 2 * n :], moments[before, 2 * n :]
        explained = last * first**2 - 2.0 * both * first * second + x * second**2
        # A joint at rest explains no motion.
        whole = (x * last - both**2 + 1e-12) * (power[2 * n :] + _STILL**2)
        return np.asarray(explained / whole)
