"""Parameters of the node `payload_estimator`."""

from dataclasses import fields
from typing import Any

from aerarm_ros.online.payload_estimator import EstimatorSettings
from aerarm_ros.ros.parameters.parameter import Parameter

ESTIMATOR_PARAMETERS = (
    Parameter('payload_mass', 0.5, 'standard deviation assumed for the mass of a payload', 'kg',
              1e-3, 50.0),
    Parameter('payload_size', 0.15,
        'standard deviation assumed for the distance of the parts of a payload from the last joint',
        'm', 0.01, 2.0),
    Parameter('tare_mass', 0.01,
        "standard deviation assumed for the mass error of the arm's model at the last link", 'kg',
        1e-4, 10.0),
    Parameter('torque_noise', 0.02,
        'RMS torque residual that the estimator assumes until it has measured the residual', 'Nm',
        1e-4, 10.0),
    Parameter('model_error', 0.01, (
        "standard deviation assumed for the model's gravity and inertia torques, as a fraction "
        'of these torques; the estimator does not attribute smaller torque errors to a payload'
    ), '', 1e-4, 0.5),
    Parameter('memory', 30.0,
        'time after which the estimator forgets the payload if no informative motion confirms it',
        's', 1.0, 3600.0),
)  # fmt: skip


def estimator_settings(values: Any) -> EstimatorSettings:
    """Return the settings of a payload estimator; `values` has one attribute per parameter."""
    names = [field.name for field in fields(EstimatorSettings) if hasattr(values, field.name)]
    return EstimatorSettings(**{name: getattr(values, name) for name in names})
