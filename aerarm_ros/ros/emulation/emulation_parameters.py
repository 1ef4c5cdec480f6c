"""Parameters of an emulated arm, and the simulated arm that they describe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

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
        "seed of noise and of the arm's deviations from its nominal parameters; -1 for a nominal "
        'arm',
        minimum=-1,
        maximum=10**9,
    ),
    Parameter(
        'initial_position',
        [],
        'initial joint positions, in joint order; the home configuration if empty',
        'rad',
        -6.3,
        6.3,
        element=float,
    ),
    Parameter(
        'payload',
        [],
        'payload of the arm: mass, and x, y, z of its centre of mass in the frame of the last '
        "link's joint; none if empty",
        'kg, m',
        -10.0,
        10.0,
        element=float,
        live=True,
    ),
    Parameter(
        'backlash',
        [],
        'gear backlash at the joints, one value or one per joint; none if empty',
        'rad',
        1e-6,
        0.5,
        element=float,
    ),
    Parameter(
        'backlash_wear',
        0.0,
        'growth of the backlash per energy that the gear transmits',
        'rad/J',
        0.0,
        1.0,
    ),
    Parameter(
        'stribeck',
        0.0,
        'additional friction at rest, relative to the friction of a sliding joint; slow joints '
        'then stick and slip',
        '',
        0.0,
        5.0,
    ),
    Parameter(
        'stribeck_velocity',
        0.05,
        'velocity at which the additional static friction has fallen to 1/e',
        'rad/s',
        1e-3,
        10.0,
    ),
    Parameter(
        'base_motion_profile',
        STILL,
        "motion of the arm's base after the motors are ready; if the base moves, the node "
        'publishes imu',
        choices=tuple(BASE_PROFILES),
    ),
    Parameter(
        'encoders',
        '',
        "type of the encoders: 'incremental' (homing is needed) or 'absolute'; as in the "
        'configuration if empty',
        choices=('', *ENCODERS),
    ),
    Parameter(
        'truth_file', '', 'YAML file for the true parameters of the simulated arm; none if empty'
    ),
    Parameter(
        'fault',
        '',
        f'fault to inject when set: {FORM}, NAME one of {", ".join(FAULTS)}',
        live=True,
    ),
    Parameter(
        'hand',
        '',
        'JOINT:ANGLE: an emulated hand turns the joint once to the angle [rad], with the motors '
        'off',
        live=True,
    ),
)

# The payload is a ball of this radius [m], with a small inertia about its centre.
PAYLOAD_RADIUS = 0.03


def plant_parameters(
    config: ArmConfig,
    robot: Robot,
    seed: int | None,
    backlash: Sequence[float],
    backlash_wear: float,
    stribeck: tuple[float, float],
    payload: Sequence[float],
) -> PlantParameters:
    """Return the physical parameters of the simulated arm; raises ValueError."""
    parameters = PlantParameters.nominal(config, robot)
    if seed is not None:
        parameters = parameters.perturbed(seed)
    parameters = replace(parameters, stribeck=stribeck[0], stribeck_velocity=stribeck[1])
    if len(backlash) not in (0, 1, config.n):
        raise ValueError(
            f'backlash {list(backlash)} must have one value, or one for each of {config.n} joints'
        )
    if backlash_wear and not len(backlash):
        raise ValueError(
            f'backlash_wear is {backlash_wear:g}, but no gear has backlash: set backlash'
        )
    if len(backlash):
        play = np.broadcast_to(np.array(backlash, dtype=float), (config.n,))
        parameters = replace(parameters, backlash=play, backlash_wear=backlash_wear)
    if not payload:
        return parameters
    if len(payload) != 4 or not payload[0] >= 0.0:
        raise ValueError(
            f'payload {list(payload)} must be a mass of at least 0 [kg] and x, y, z of '
            'its centre of mass [m]'
        )
    return parameters.carrying(payload[0], payload[1:], PAYLOAD_RADIUS)
