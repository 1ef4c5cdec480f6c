"""ROS parameters of the emulated arm, and their conversion to parameters of the simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from aerarm_ros.description.arm_config import ENCODERS, ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.emulation.fault_injection import FAULTS, FORM
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.base_profile import BASE_PROFILES, STILL

EMULATION_PARAMETERS = (
    Parameter(
        'seed',
        0,
        "seed of the sensor noise and of the emulated arm's deviations from its nominal "
        'parameters; -1 for a nominal arm',
        minimum=-1,
        maximum=10**9,
    ),
    Parameter(
        'initial_position',
        [],
        'joint positions of the emulated arm at the start, one per joint; if empty, the home '
        'configuration',
        'rad',
        -6.3,
        6.3,
        element=float,
    ),
    Parameter(
        'payload',
        [],
        'payload of the emulated arm: mass, and x, y, z of its centre of mass in the frame of the '
        'last joint; no payload if empty',
        'kg, m',
        -10.0,
        10.0,
        element=float,
        live=True,
    ),
    Parameter(
        'backlash',
        [],
        'gear backlash of the emulated arm at the joints, one value or one per joint; no backlash '
        'if empty',
        'rad',
        1e-6,
        0.5,
        element=float,
    ),
    Parameter(
        'stribeck',
        0.0,
        'additional static friction of the emulated joints, relative to their sliding '
        'friction; it makes slow joints stick and slip',
        '',
        0.0,
        5.0,
    ),
    Parameter(
        'stribeck_velocity',
        0.05,
        'joint velocity at which the additional static friction (stribeck) has decreased to 1/e',
        'rad/s',
        1e-3,
        10.0,
    ),
    Parameter(
        'base_motion_profile',
        STILL,
        "motion of the emulated arm's base once the motors hold the arm; if the base moves, the "
        'node publishes imu',
        choices=tuple(BASE_PROFILES),
    ),
    Parameter(
        'encoders',
        '',
        "type of the emulated encoders: 'incremental' (the arm needs homing) or 'absolute'; if "
        'empty, the type in the configuration',
        choices=('', *ENCODERS),
    ),
    Parameter(
        'truth_file',
        '',
        'YAML file to which the node writes the true parameters of the simulated arm; no file if '
        'empty',
    ),
    Parameter(
        'fault',
        '',
        f'fault to inject into the emulated boards: {FORM}, with NAME one of {", ".join(FAULTS)}',
        live=True,
    ),
    Parameter(
        'hand',
        '',
        'joint that an emulated hand turns once, as JOINT:ANGLE with the final angle [rad]; the '
        'motors must be off',
        live=True,
    ),
)

# The payload is a ball of this radius [m], with a small inertia about its centre.
PAYLOAD_RADIUS = 0.03


def plant_parameters(
    config: ArmConfig, robot: Robot, values: SimpleNamespace, payload: Sequence[float]
) -> PlantParameters:
    """Return the simulated arm's physical parameters, or raise ValueError for invalid values.

    `values` contains the values of `EMULATION_PARAMETERS`. `payload` replaces the value of the
    parameter with this name.
    """
    parameters = PlantParameters.nominal(config, robot)
    if values.seed >= 0:
        parameters = parameters.perturbed(values.seed)
    backlash = values.backlash
    parameters = replace(
        parameters, stribeck=values.stribeck, stribeck_velocity=values.stribeck_velocity
    )
    if len(backlash) not in (0, 1, config.n):
        raise ValueError(
            f'the parameter backlash {list(backlash)} has {len(backlash)} values: set one value, '
            f'or one for each of the {config.n} joints'
        )
    if len(backlash):
        of_joints = np.broadcast_to(np.array(backlash, dtype=float), (config.n,))
        parameters = replace(parameters, backlash=of_joints)
    if not payload:
        return parameters
    if len(payload) != 4 or not payload[0] >= 0.0:
        raise ValueError(
            f'the parameter payload {list(payload)} must be a mass of at least 0 [kg] and x, y, z '
            'of its centre of mass [m]'
        )
    return parameters.carrying(payload[0], payload[1:], PAYLOAD_RADIUS)
