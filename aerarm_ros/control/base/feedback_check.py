"""Whether a drone is heavy enough for an IMU that is fed back at once."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.checks import positive
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import Array

_POSTURES = 200
# A loop whose gain is below one at every frequency is stable whatever its delay (small gain). The
# prediction of trends raises that of the IMU's path to 1.15; the margin is 1.3.
LARGEST_GAIN = 0.67  # decision 28


def largest_feedback_gain(whole: WholeBodyDynamics) -> float:
    """Return the largest `feedback_gain` over the arm's postures, as a sample of them."""
    robot = whole.robot
    low = np.maximum(robot.position_min, -np.pi)
    high = np.minimum(robot.position_max, np.pi)
    postures = np.random.default_rng(0).uniform(low, high, (_POSTURES, robot.n))
    return max(whole.feedback_gain(q) for q in postures)


def check_feedback(drone: DroneConfig, whole: WholeBodyDynamics) -> None:
    """Require that torques may answer the base's measured acceleration at once.

    Parameters
    ----------
    drone : DroneConfig
    whole : WholeBodyDynamics
        Of the drone, its arm and what that carries: a load far out counts more than its mass.

    Raises
    ------
    ValueError
        If the loop of arm torque, base acceleration, IMU and arm torque has too much gain.
    """
    gain = largest_feedback_gain(whole)
    if gain > LARGEST_GAIN:
        raise ValueError(
            f"base_motion 'full' on {drone.name} ({drone.mass:g} kg) is unstable: the IMU feeds "
            f"the arm's torque back with a gain of {gain:.2g} (limit {LARGEST_GAIN:g}); use "
            "'free' or 'attitude'"
        )


def largest_delay(gain: float, kp: float, kd: float) -> float:
    """Return the delay [s] up to which feedback of computed torque is stable on a free base.

    A base that gives way makes joints lighter than the law takes them for, by up to `1 + gain`. The
    loop is then `(1 + gain) (kd s + kp) / s^2`, and this is its phase margin over its crossover.

    Parameters
    ----------
    gain : float
        `WholeBodyDynamics.feedback_gain`; 0 for a fixed base.
    kp, kd : float
        [1/s^2], [1/s]; without both there is no feedback, and any delay will do.
    """
    stiffness, damping = (1.0 + gain) * kp, (1.0 + gain) * kd
    half = 0.5 * damping**2
    crossover = np.sqrt(half + np.hypot(half, stiffness))
    if crossover == 0.0:
        return np.inf
    return float(np.arctan2(damping * crossover, stiffness) / crossover)


# What is slower is the drone's flight or the arm's motion [Hz]. The loop's own frequency is half
# the inverse of its delay: 125 Hz with an IMU of 250 Hz, 30 Hz if that is 10 ms late.
_CUTOFF = 8.0  # decision 34
_WINDOW = 0.1  # [s]
_SAMPLES = 25  # in the window at least: fewer agree by chance
_TORQUE = 0.25  # RMS over effort_max; noise of a cheap IMU makes less
_EXPLAINED = 0.6  # of the base's motion by the torques before it; of the noise about 0
_LASTING = 0.1  # [s]
_LONGEST_STEP = 0.1  # [s]
# Motion of the base that counts as none, for each axis [m/s^2], [rad/s].
_STILL = np.repeat([0.1, 0.01], 3)
_RIDGE = 1e-3  # at half the IMU's rate two torques in a row tell the same


class OscillationWatch:
    """Looks for an oscillation of joint torques that the base answers, above 8 Hz.

    Where torques follow an IMU that their own reaction moves, both oscillate together, and
    whatever the loop's delay, each sample y of the IMU follows from the torques x before it::

        y_k = b_0 x_k + b_1 x_(k-1)

    as two samples fix a sine. Found is one if of some joint and some axis this explains most of
    the power of y, while x is a large share of what the drive can do, for 0.1 s. The torques
    follow the noise of the IMU too, but the next noise does not follow the torques; and what a
    base is driven with is slower. Powers are means over 0.1 s, or 25 samples if those are more.

    Parameters
    ----------
    effort_max : (n,) array_like
        [Nm]

    Attributes
    ----------
    found : str
        What was found, '' if nothing. It stays.
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
        self._since = np.inf  # stamp from which on it has lasted
        self.found = ''

    def add_torque(self, tau: Array) -> None:
        """Take the joint torques (n,) [Nm] of a cycle, NaN where not measured."""
        if not self.found:
            self._sum = self._sum + (tau if np.isfinite(tau.sum()) else np.nan_to_num(tau))
            self._count += 1

    def add_sample(self, sample: ImuSample) -> None:
        """Take what the IMU read after these torques."""
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
        """Return the share of each axis' power that each joint's torques explain, (n, 6)."""
        n, moments = self._n, self._moments
        now, before = slice(0, n), slice(n, 2 * n)
        power = moments.diagonal()
        x, last = power[now, None] * (1.0 + _RIDGE), power[before, None] * (1.0 + _RIDGE)
        both = moments[now, before].diagonal()[:, None]
        first, second = moments[now, 2 * n :], moments[before, 2 * n :]
        explained = last * first**2 - 2.0 * both * first * second + x * second**2
        # A joint at rest explains nothing.
        whole = (x * last - both**2 + 1e-12) * (power[2 * n :] + _STILL**2)
        return np.asarray(explained / whole)
