"""Flying the drone that carries the arm: what the arm adds to it, and a controller.

In come odometry, IMU samples, a set point, the joints' motion and the drone's description; out go
what may be fed forward of the arm, the thrusts of the rotors, and what is wrong with the sensors.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'allocation': ['Allocation'],
        'arm_feed_forward': ['ArmFeedForward'],
        'arm_forecast': ['ArmForecast'],
        'arm_load': ['ArmLoad', 'at_drone_centre'],
        'arm_load_model': ['ArmLoadModel'],
        'disturbance': ['Disturbance'],
        'disturbance_observer': ['DisturbanceObserver'],
        'feed_forward': ['FeedForward'],
        'flight_control': ['FlightControl'],
        'flight_estimator': ['FlightEstimator'],
        'flight_gains': ['FlightGains'],
        'flight_path': ['FlightPath'],
        'flight_state': ['FlightState'],
        'flight_target': ['FlightTarget'],
        'incremental_estimate': ['IncrementalEstimate'],
        'mass_properties': ['MassProperties'],
        'odometry_sample': ['OdometrySample'],
    },
)
