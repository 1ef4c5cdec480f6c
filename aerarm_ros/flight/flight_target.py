"""Where the drone shall be."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.flight.flight_state import FlightState

Array = npt.NDArray[np.float64]

_ZERO = np.zeros(3)


class FlightTarget(NamedTuple):
    """A place to hover at or to pass.

    Attributes
    ----------
    position : (3,) ndarray
        Of the body frame's origin in the world [m].
    yaw : float
        Turn of the body about the vertical [rad].
    velocity, acceleration : (3,) ndarray
        Of that origin in the world [m/s], [m/s^2].
    """

    position: Array
    yaw: float
    velocity: Array = _ZERO
    acceleration: Array = _ZERO

    @classmethod
    def here(cls, state: FlightState) -> 'FlightTarget':
        """Return the place where a drone is, with its heading."""
        return cls(np.array(state.position), yaw_of(state.rotation))


def yaw_of(rotation: Array) -> float:
    """Return the heading [rad] of an attitude: where the body's x axis points to."""
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))
