"""What the designer's command line says, as objects."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import numpy as np

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.planning.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings.excitation_config import (
    ExcitationConfig,
    load_excitation_config,
)
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.excitation.settings.motion_limits import one_a_joint
from aerarm_ros.motion.float_array import FloatArray


def whole_periods(duration: float, fundamental: float) -> int:
    """Return how many periods of 1 / fundamental [Hz] the duration [s] holds.

    Raises
    ------
    ExcitationError
        If it is not a whole number of them.
    """
    for name, value in (('fundamental', fundamental), ('duration', duration)):
        if not (math.isfinite(value) and value > 0.0):
            raise ExcitationError(f'{name} must be positive, got {value}')
    periods = duration * fundamental
    whole = round(periods)
    if whole < 1 or abs(periods - whole) > 1e-6:
        near = [n / fundamental for n in (math.floor(periods), math.ceil(periods)) if n > 0]
        raise ExcitationError(
            f'the duration ({duration:g} s) is no multiple of the period '
            f'({1.0 / fundamental:g} s), and a part of a period spoils the filtering: '
            f'take {" or ".join(f"{value:g} s" for value in near)}'
        )
    return whole


def torque_noise(options: argparse.Namespace, joints: int) -> FloatArray | None:
    """Return each joint's standard deviation of the torque [Nm], None if it is not given.

    Raises
    ------
    ExcitationError
        If there are neither 1 nor `joints` values, or one is not positive.
    """
    if options.torque_noise is None:
        return None
    noise = one_a_joint('torque noise', options.torque_noise, joints)
    if not (np.isfinite(noise) & (noise > 0.0)).all():
        raise ExcitationError(f'torque noise must be positive, got {noise.tolist()} Nm')
    return noise


def excitation_setup(options: argparse.Namespace) -> ExcitationSetup:
    """Return the packaged arm, or another one from its URDF with or without a drive train.

    Raises
    ------
    ValueError
        If a file cannot be used, or an option does not go with the others.
    """
    other = options.urdf is not None
    if options.excitation_config or not other:
        config = load_excitation_config(options.excitation_config)
    else:
        config = ExcitationConfig()
    if options.bias:
        config = replace(config, bias=tuple(options.bias))
    names = ('acceleration_limit', 'current_limit', 'torque_per_ampere')
    given = {name: values for name in names if (values := getattr(options, name)) is not None}
    if options.config or not other:
        if given:
            raise ExcitationError(
                f'--{", --".join(given).replace("_", "-")}: for an arm without a drive train; '
                'otherwise the limits are those of --config'
            )
        arm = load_arm_config(options.config)
        robot = load_robot(
            options.urdf, gravity_in_base=arm.gravity_in_base, joint_names=arm.joint_names
        )
        return ExcitationSetup.of_arm(robot, arm, config)
    robot = load_robot(options.urdf, locked=options.locked)
    return ExcitationSetup.of_robot(robot, config, options.package_directory, **given)
