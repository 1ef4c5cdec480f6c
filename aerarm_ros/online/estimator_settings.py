"""What may be said of a payload, of friction and of noise before they are measured."""

from dataclasses import dataclass, fields

import numpy as np

from aerarm_ros.control.checks.gains import positive


@dataclass(frozen=True)
class EstimatorSettings:
    """Settings of a `PayloadEstimator`; all are positive.

    Attributes
    ----------
    bandwidth : float
        Of the low-passes on both sides of the equation of motion [1/s]. What is faster is noise;
        what is picked up shows after some of its time constants.
    correlation_time : float
        For how long an error of the model stays what it is [s]. Errors within it count as one.
    payload_mass, payload_size : float
        Standard deviation of what may be picked up: its mass [kg], and the distance of its parts
        from the last joint [m].
    tare_mass : float
        Standard deviation of the mass [kg] by which the arm's model may be wrong at its last link.
    friction_spread : float
        Standard deviation of friction from what the model says, relative.
    torque_noise : float
        RMS torque [Nm] that the model leaves unexplained at first; it is measured from then on.
    memory, friction_memory : float
        Time constants of forgetting [s], of payload and tare, and of friction.
    """

    bandwidth: float = 30.0
    correlation_time: float = 0.1
    payload_mass: float = 0.5
    payload_size: float = 0.15
    tare_mass: float = 0.01
    friction_spread: float = 0.3
    torque_noise: float = 0.02
    memory: float = 30.0
    friction_memory: float = 120.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for field in fields(self):
            positive(field.name, getattr(self, field.name))

    def body_scale(self, mass: float) -> np.ndarray:
        """Return standard deviations (10,) of a body of a mass [kg] and `payload_size`."""
        size = self.payload_size
        return mass * np.array([1.0, *[size] * 3, *[size**2] * 6])
