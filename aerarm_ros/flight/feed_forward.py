"""What a flight controller takes from its arm at one instant."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.flight.mass_properties import MassProperties

Array = npt.NDArray[np.float64]


class FeedForward(NamedTuple):
    """Mass properties of drone and arm, and what the arm's motion does to the drone.

    In body axes, moments about the body frame's origin.

    Attributes
    ----------
    body : MassProperties
        When a command of now acts.
    wrench, wrench_now : (6,) ndarray
        Of the joints' motion on the drone when a command of now acts, and now: force [N], moment
        [Nm].
    force_rate, force_curvature : (3,) ndarray
        Derivatives of its force by time, now [N/s] and when a command acts [N/s^2]: a drone leans
        for such a force, which it does by turning.
    """

    body: MassProperties
    wrench: Array
    wrench_now: Array
    force_rate: Array
    force_curvature: Array

    @classmethod
    def at_rest(cls, body: MassProperties) -> 'FeedForward':
        """Return what an arm at rest does: nothing but weigh."""
        zero = np.zeros(3)
        return cls(body, np.zeros(6), np.zeros(6), zero, zero)
