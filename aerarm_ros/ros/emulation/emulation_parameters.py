"""Parameters of an emulated arm, and what it is made of by them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aerarm_ros.description.arm_config import ENCODERS, ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.emulation.fault_injection import FAULTS, FORM
from aerarm_ros.ros.parameters.parameter_table import Parameter
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.base_profile import BASE_PROFILES, STILL

EMULATION_PARAMETERS = (
    Parameter(
        'seed',
        0,
        "seed of the arm's deviations from the drawing and of noise; -1 for an arm as drawn",
        minimum=-1,
        maximum=10**9,
    ),
    Parameter(
        'initial_position',
        [],
        "joint angles at the start, in the joints' order; the home configuration if empty",
        'rad',
        -6.3,
        6.3,
        element=float,
    ),
    Parameter(
        'payload',
        [],
        "what the arm carries: mass, and x, y, z of its centre in the frame of the last link's "
        'joint; nothing if empty',
        'kg, m',
        -10.0,
        10.0,
        element=float,
        live=True,
    ),
    Parameter(
        'backlash',
        [],
        'how far the links may turn while their rotors rest, one or one a joint; none if empty',
        'rad',
        1e-6,
        0.5,
        element=float,
    ),
    Parameter(
        'backlash_wear',
        0.0,
        'growth of the backlash per energy that a gear passes on',
        'rad/J',
        0.0,
        1.0,
    ),
    Parameter(
        'base_motion_profile',
        STILL,
        "what the arm's base does once the motors are ready; unless it is still, its IMU is "
        'published on imu',
        choices=tuple(BASE_PROFILES),
    ),
    Parameter(
        'encoders',
        '',
        "kind of the boards' encoders: incremental ones count from where the arm stands at the "
        "start, so it has to be homed, absolute ones need not; the configuration's if empty",
        choices=('', *ENCODERS),
    ),
    Parameter('truth_file', '', "YAML file to write the arm's true parameters to"),
    Parameter(
        'fault',
        '',
        f'fault to inject, at once when it is set: {FORM}, NAME one of {", ".join(FAULTS)}',
        live=True,
    ),
    Parameter(
        'hand',
        '',
        'JOINT:ANGLE: with the motors off, a hand carries the arm and turns that joint to that '
        'angle [rad], once when it is set',
        live=True,
    ),
)

# The payload is a ball of this radius [m]: its own inertia, small beside that of its place.
PAYLOAD_RADIUS = 0.03


def plant_parameters(
    config: ArmConfig,
    robot: Robot,
    seed: int | None,
    backlash: Sequence[float],
    backlash_wear: float,
    payload: Sequence[float],
) -> PlantParameters:
    """Return what the simulated arm is made of; raises ValueError for what no arm has."""
    parameters = PlantParameters.nominal(config, robot)
    if seed is not None:
        parameters = parameters.perturbed(seed)
    if len(backlash) not in (0, 1, config.n):
        raise ValueError(
            f'backlash {list(backlash)}: give one, or one for each of {config.n} joints'
        )
    if backlash_wear and not len(backlash):
        raise ValueError(
            f'backlash_wear {backlash_wear:g}: no gear has any play that could grow, give backlash'
        )
    if len(backlash):
        play = np.broadcast_to(np.array(backlash, dtype=float), (config.n,))
        parameters = replace(parameters, backlash=play, backlash_wear=backlash_wear)
    if not payload:
        return parameters
    if len(payload) != 4 or not payload[0] >= 0.0:
        raise ValueError(
            f'payload {list(payload)}: give a mass not below 0 [kg] and x, y, z of its centre [m]'
        )
    return parameters.carrying(payload[0], payload[1:], PAYLOAD_RADIUS)
