"""Parameters of a `PayloadEstimator`, and its settings made from them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from aerarm_ros.online.estimator_settings import EstimatorSettings
from aerarm_ros.ros.parameters.parameter import Parameter

ESTIMATOR_PARAMETERS = (
    Parameter('payload_mass', 0.5, 'what may be picked up, as a standard deviation', 'kg', 1e-3,
              50.0),
    Parameter('payload_size', 0.15, "distance of its parts from the last joint, as one", 'm', 0.01,
              2.0),
    Parameter('tare_mass', 0.01, "by what the arm's model may be wrong at its last link, as a "
              'standard deviation', 'kg', 1e-4, 10.0),
    Parameter('friction_spread', 0.3, 'by what friction may be another than the model says, as a '
              'relative standard deviation', '', 0.01, 2.0),
    Parameter('torque_noise', 0.02, 'RMS torque that the model leaves unexplained, until it is '
              'measured', 'Nm', 1e-4, 10.0),
    Parameter('correlation_time', 0.1, 'for how long an error of the model stays what it is', 's',
              0.02, 10.0),
    Parameter('bandwidth', 30.0, 'of the low-passes on the equation of motion', '1/s', 5.0, 100.0),
    Parameter('memory', 30.0, 'in which the payload is forgotten where motion tells nothing of it',
              's', 1.0, 3600.0),
    Parameter('friction_memory', 120.0, 'the same of friction', 's', 1.0, 36000.0),
)  # fmt: skip


def estimator_settings(values: Any) -> EstimatorSettings:
    """Return the settings that an object with an attribute a parameter describes."""
    return EstimatorSettings(
        **{field.name: getattr(values, field.name) for field in fields(EstimatorSettings)}
    )
