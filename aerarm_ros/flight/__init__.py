"""Flying the drone that carries the arm: a plain position and attitude controller.

In come odometry, IMU samples, a set point and the drone's description; out go the thrusts of the
rotors, and what is wrong with the sensors.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'allocation': ['Allocation'],
        'flight_control': ['FlightControl'],
        'flight_estimator': ['FlightEstimator'],
        'flight_gains': ['FlightGains'],
        'flight_state': ['FlightState'],
        'flight_target': ['FlightTarget'],
        'mass_properties': ['MassProperties'],
        'odometry_sample': ['OdometrySample'],
    },
)
