"""Whether a drone is heavy enough for an IMU that is fed back at once."""

import numpy as np

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics

_POSTURES = 200
# A loop whose gain is below one at every frequency is stable whatever its delay (small gain). The
# prediction of trends raises that of the IMU's path to 1.15; the margin is 1.3.
LARGEST_GAIN = 0.67


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
            f"base_motion 'full' on {drone.name} ({drone.mass:g} kg) would excite itself: what the "
            f"arm's torque does to the drone comes back by the IMU {gain:.2g} times as large, and "
            f"{LARGEST_GAIN:g} is safe: use 'free', or 'attitude'"
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
