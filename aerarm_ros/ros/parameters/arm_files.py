"""The parameters that name the files of the arm, and its names, and the arm they describe."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.ros.parameters.parameter import Parameter, grouped

ARM_FILES = grouped(
    'Which arm',
    Parameter('config', '', 'YAML file of the drive train; the packaged arm if empty'),
    Parameter('urdf', '', 'URDF of the arm, for example an identified one; the packaged if empty'),
    Parameter('tf_prefix', '', 'before the names of all links and joints on topics, as left_: for '
              'several arms in one tf tree. Files and parameters name them without it'),
)  # fmt: skip


def load_arm(values: SimpleNamespace) -> tuple[ArmConfig, Robot]:
    """Return the arm that the values of `ARM_FILES` name, under its configuration's gravity.

    This is where it gets its prefix: all names are those of the topics from here on.

    With a `DRONE_FILE` among the values gravity is that under the level drone, as its mount says.

    Raises
    ------
    ValueError
        If a file cannot be read or used, the two do not fit each other, or the prefix cannot
        stand before names; the message says what to check.
    """
    config = load_arm_config(values.config or None)
    if getattr(values, 'drone_file', ''):
        gravity = load_drone_config(values.drone_file).gravity_in_base
        config = replace(config, gravity_in_base=tuple(gravity.tolist()))
    robot = load_robot(
        values.urdf or None,
        gravity_in_base=config.gravity_in_base,
        joint_names=config.joint_names,
        prefix=values.tf_prefix,
    )
    return config.with_prefix(values.tf_prefix), robot
