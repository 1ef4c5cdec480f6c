"""Parameters of the node `contact_estimator`, which are also options of its command line."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from aerarm_ros.description.config_reader import read_yaml
from aerarm_ros.online.contact_detector import ContactSettings
from aerarm_ros.online.external_torque import ResidualBound
from aerarm_ros.ros.parameters.parameter import Parameter

GAIN_PARAMETER = Parameter(
    'observer_gain',
    30.0,
    'bandwidth of the momentum observer that estimates the external torque (only with --free)',
    '1/s',
    1.0,
    500.0,
)

CONTACT_ESTIMATOR_PARAMETERS = (
    Parameter('confirmation', 0.02,
        'time for which the external torque must exceed its threshold to count as contact',
              's', 1e-3,
              1.0),
    Parameter('rest_share', 0.15,
        "torque change of a resting joint that counts as contact, as a fraction of the joint's dry "
        'friction', '', 0.01, 2.0),
    Parameter('payload_mass', 2.0,
        'standard deviation assumed for the mass of an undeclared payload (not in '
        'payload.inertial_parameters)',
        'kg', 1e-3, 50.0),
    Parameter('payload_size', 0.2,
        'standard deviation assumed for the distance of an undeclared payload from the last joint',
        'm',
              0.01, 2.0),
)  # fmt: skip

FILE_PARAMETERS = (
    Parameter('residuals_file', '',
        'required file residuals.yaml with contact thresholds learnt from motion without '
        'contact'),
    Parameter('model_file', '',
        "file estimate.yaml with the identified model of the arm; the URDF's model if empty"),
    Parameter('rate', 100.0, 'publishing rate of external torque and contact', 'Hz', 1.0, 1000.0),
)  # fmt: skip

RESIDUALS = 'residuals.yaml'
"""Name of the file with the contact thresholds that `contact_estimator --free` learns."""

RESIDUALS_SECTION = 'residual_bound'
"""Top-level key of the contact thresholds in the file `RESIDUALS`."""


def contact_settings(values: Any) -> ContactSettings:
    """Return the settings of a contact detector; `values` has one attribute per parameter."""
    names = [field.name for field in fields(ContactSettings) if hasattr(values, field.name)]
    return ContactSettings(**{name: getattr(values, name) for name in names})


def read_residuals(path: Path, joint_names: tuple[str, ...]) -> ResidualBound:
    """Read the learnt contact thresholds from a file; raises ValueError or OSError."""
    values = read_yaml(path)
    section = values.get(RESIDUALS_SECTION) if isinstance(values, dict) else None
    if not isinstance(section, dict):
        raise ValueError(
            f'{path} has no section {RESIDUALS_SECTION}: pass the file {RESIDUALS} that '
            'contact_estimator --free writes'
        )
    return ResidualBound.from_dict(section, joint_names, str(path))
