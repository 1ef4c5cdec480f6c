"""Parameters that several nodes share: files, surroundings, and real-time settings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
from rclpy.impl.rcutils_logger import RcutilsLogger

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.realtime.scheduling import (
    freeze_garbage_collector,
    keep_cpus_awake,
    lock_memory,
    set_affinity,
    set_fifo,
)
from aerarm_ros.ros.parameters.parameter import Parameter, grouped

if TYPE_CHECKING:  # imported at run time only by nodes with a drone or planned motion
    from aerarm_ros.description.drone_config import DroneConfig
    from aerarm_ros.excitation.excitation_setup import ExcitationSetup

ARM_FILES = grouped(
    'Arm',
    Parameter('config', '',
        'YAML file of the arm configuration (boards, motors, limits); the packaged arm if empty'),
    Parameter('urdf', '',
        'URDF file of the arm, for example identified.urdf; the packaged arm if empty'),
    Parameter('tf_prefix', '', (
        'prefix of all link and joint names on topics, for example left_, if several arms share '
        'one tf tree; names in files and parameters have no prefix'
    )),
)  # fmt: skip


SURROUNDINGS = (
    Parameter('excitation_config', '',
        'YAML file with obstacles and with the fraction of each limit that motions may use; the '
        'packaged file if empty'),
    Parameter('package_directories', [''],
        'folders in which to search for the package:// meshes of the URDF, in addition to the '
        'parent folders of the URDF'),
)  # fmt: skip


def load_setup(values: SimpleNamespace, config: ArmConfig, robot: Robot) -> ExcitationSetup:
    """Return limits and clearance checks for motions, from the values of `SURROUNDINGS`.

    With a `drone_file` the checks ignore the ground, because a flying arm does not reach it.

    Raises
    ------
    ValueError
        If the file cannot be read or used.
    """
    from aerarm_ros.excitation.excitation_setup import ExcitationSetup
    from aerarm_ros.excitation.settings import load_excitation_config

    surroundings = load_excitation_config(values.excitation_config or None)
    if getattr(values, 'drone_file', ''):
        surroundings = replace(surroundings, ground_height=None)
    folders = [Path(folder) for folder in values.package_directories if folder]
    return ExcitationSetup.of_arm(robot, config, surroundings, folders)


def load_arm(values: SimpleNamespace) -> tuple[ArmConfig, Robot]:
    """Return configuration and model of the arm, from the files in the values of `ARM_FILES`.

    The returned link and joint names have the prefix `tf_prefix`, as on the topics. With a
    `drone_file`, the direction of gravity is that of the level drone, otherwise that of the
    configuration.

    Raises
    ------
    ValueError
        If a file cannot be used, the files contradict each other, or the prefix is not a valid
        name. The message states what to check.
    """
    config = load_arm_config(values.config or None)
    if getattr(values, 'drone_file', ''):
        from aerarm_ros.description.drone_config import load_drone_config

        gravity = load_drone_config(values.drone_file).gravity_in_base
        config = replace(config, gravity_in_base=tuple(gravity.tolist()))
    robot = load_robot(
        values.urdf or None,
        gravity_in_base=config.gravity_in_base,
        joint_names=config.joint_names,
        prefix=values.tf_prefix,
    )
    return config.with_prefix(values.tf_prefix), robot


DRONE_FILE = Parameter(
    'drone_file', '', (
        'YAML file of the drone that carries the arm, for example the packaged config/drone.yaml; '
        'no drone if empty'
    ), group='Arm'
)  # fmt: skip


def load_drone(values: SimpleNamespace, config: ArmConfig, robot: Robot) -> DroneConfig | None:
    """Return the drone in the file `drone_file`, None if this parameter is empty.

    Raises
    ------
    ValueError
        If the file cannot be used, or the drone cannot lift this arm. The message states what to
        check.
    """
    if not values.drone_file:
        return None
    from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
    from aerarm_ros.description.drone_config import load_drone_config

    drone = load_drone_config(values.drone_file)
    mass, centre, _ = MovingBaseDynamics(robot).composite_inertia(np.array(config.rest_position))
    drone.check_carries(mass, centre)
    return drone


REAL_TIME_PARAMETERS = grouped(
    'Real time',
    Parameter('realtime_priority', 0,
        'SCHED_FIFO priority of the real-time thread; 0 for the ordinary scheduler',
        minimum=0, maximum=98),
    Parameter('lock_memory', False,
        'whether the process locks its memory in RAM, so that page faults cause no delay'),
    Parameter('keep_cpus_awake', False,
        'whether idle CPUs stay out of sleep states while the node runs; this setting reduces '
        'delays, but increases power consumption and heat'),
)  # fmt: skip


def prepare_thread(values: SimpleNamespace, logger: RcutilsLogger) -> None:
    """Apply the real-time settings to the calling thread and its process.

    If the system refuses a setting, the node logs a warning with advice and runs without it.

    Parameters
    ----------
    values
        Values of `REAL_TIME_PARAMETERS`. Optional attributes are `cpus` (list of CPUs to run on)
        and `freeze_gc` (whether to freeze Python's garbage collector, true by default).
    logger
        Logger of the node.
    """
    cpus = getattr(values, 'cpus', ())
    warnings = [
        set_affinity(cpus) if cpus else None,
        set_fifo(values.realtime_priority) if values.realtime_priority else None,
        lock_memory() if values.lock_memory else None,
        keep_cpus_awake() if values.keep_cpus_awake else None,
        freeze_garbage_collector() if getattr(values, 'freeze_gc', True) else None,
    ]
    for warning in filter(None, warnings):
        logger.warning(warning)
