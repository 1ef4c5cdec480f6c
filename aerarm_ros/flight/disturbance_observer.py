"""Forces on a drone, from its momentum."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import positive
from aerarm_ros.description.drone_config import GRAVITY
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.flight.mass_properties import MassProperties
from aerarm_ros.model.cross_product import cross

Array = npt.NDArray[np.float64]

_WEIGHT = np.array([0.0, 0.0, -GRAVITY])


class DisturbanceObserver:
    """Compares the momentum of drone and arm with what is known to have changed it.

    First order: `d = K (p - int(w + d) dt)`, with the momentum p of the whole taken as one rigid
    body, from odometry and gyroscope.

    Parameters
    ----------
    frequency : float
        K [rad/s].
    """

    def __init__(self, frequency: float) -> None:
        self._gain = positive('observer_frequency', frequency)
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._expected: Array | None = None
        self._estimate = np.zeros(6)

    def update(self, state: FlightState, body: MassProperties, wrench: Array, dt: float) -> Array:
        """Return the estimate, see `Disturbance`."""
        spin = body.inertia @ state.rate
        velocity = state.velocity + state.rotation @ cross(state.rate, body.centre)
        momentum = np.concatenate([body.mass * velocity, spin])
        if self._expected is None:
            self._expected = momentum
        known = np.concatenate(
            [
                state.rotation @ wrench[:3] + body.mass * _WEIGHT,
                wrench[3:] - cross(body.centre, wrench[:3]) - cross(state.rate, spin),
            ]
        )
        self._expected = self._expected + dt * (known + self._estimate)
        self._estimate = self._gain * (momentum - self._expected)
        return self._estimate
