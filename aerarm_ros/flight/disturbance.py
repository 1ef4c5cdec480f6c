"""Forces on a drone that nobody has told it of."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.flight.mass_properties import MassProperties

Array = npt.NDArray[np.float64]


class Disturbance(Protocol):
    """What estimates the wrench on drone and arm beside rotors and weight."""

    def reset(self) -> None:
        """Begin anew."""

    def update(self, state: FlightState, body: MassProperties, wrench: Array, dt: float) -> Array:
        """Return force in the world and moment in body axes about the centre of mass, (6,).

        Parameters
        ----------
        state : FlightState
        body : MassProperties
        wrench : (6,) ndarray
            Of all that is known over the last `dt` [s], in body axes about the origin.
        """
        ...
