"""Forces on a drone as its IMU feels them."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import positive
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.flight.mass_properties import MassProperties
from aerarm_ros.model.cross_product import cross

Array = npt.NDArray[np.float64]


class IncrementalEstimate:
    """What incremental dynamic inversion adds to the last command, as a `Disturbance`.

    INDI commands `w_f + M (a_wanted - a_f)`, with the rotors' wrench w and the measured
    acceleration a through one filter (Smeur, Chu and de Croon, J. Guid. Control Dyn. 2016). That
    is `M a_wanted - d` with the disturbance `d = M a_f - w_f`, second order here.

    Parameters
    ----------
    drone : DroneConfig
        For the place of its IMU.
    frequency : float
        Of the filter, critically damped [rad/s].
    """

    def __init__(self, drone: DroneConfig, frequency: float) -> None:
        self._imu = np.array(drone.imu.position)
        self._frequency = positive('observer_frequency', frequency)
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._rate: Array | None = None
        self._once = self._twice = np.zeros(6)

    def update(self, state: FlightState, body: MassProperties, wrench: Array, dt: float) -> Array:
        """Return the estimate, see `Disturbance`."""
        rate, before = state.rate, self._rate
        self._rate = rate
        if before is None or dt <= 0.0 or state.specific_force is None:
            return self._twice
        spin = (rate - before) / dt
        lever = body.centre - self._imu
        felt = state.specific_force + cross(spin, lever)
        felt = felt + cross(rate, cross(rate, lever))
        momentum = body.inertia @ rate
        moment = wrench[3:] - cross(body.centre, wrench[:3])
        disturbance = np.concatenate(
            [
                state.rotation @ (body.mass * felt - wrench[:3]),
                body.inertia @ spin + cross(rate, momentum) - moment,
            ]
        )
        gain = 1.0 - np.exp(-self._frequency * dt)
        self._once = self._once + gain * (disturbance - self._once)
        self._twice = self._twice + gain * (self._once - self._twice)
        return self._twice
