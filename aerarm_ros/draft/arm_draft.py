"""A whole arm's configuration, as far as a URDF and guesses go."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.board_config import BoardConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.draft.drive_draft import DriveDraft, require_turning
from aerarm_ros.draft.gains_draft import draft_gains
from aerarm_ros.draft.rest_posture import RestPosture
from aerarm_ros.excitation.settings.excitation_config import ExcitationConfig
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.joint_loads import JointLoads
from aerarm_ros.model.drive_train import DriveTrain
from aerarm_ros.model.gravity_load import largest_gravity_load

Array = npt.NDArray[np.float64]

PROFILE = 'uomodri_v3'
_CLOCK, _MODE = 8_000_000, 0
_CHIP_SELECTS = 2  # of a bus


class ArmDraft:
    """What can be written down of an arm before anybody has measured it.

    Parameters
    ----------
    robot : Robot
        Under the gravity that it will feel.
    name : str, optional
        Of the arm; that of the URDF if not given.
    package_directories : sequence of Path
        Where `package://` meshes are looked for, besides the folders above the URDF.

    Attributes
    ----------
    config : ArmConfig
        Checked as a bridge checks it: the boards' frames hold its gains, its drives hold the arm.
    guesses : tuple of frozenset of str
        Of each joint, the fields that the URDF does not say.
    excitation : ExcitationConfig
        About the home configuration.
    problem : str
        What of clearances could not be kept or looked at; else ''.

    Raises
    ------
    ValueError
        If no drive can be guessed for it; the message says what of the URDF to check.
    """

    def __init__(
        self, robot: Robot, name: str = '', package_directories: Sequence[Path] = ()
    ) -> None:
        require_turning(robot)
        loads = largest_gravity_load(robot)
        drives = [DriveDraft.of(robot, number, float(load)) for number, load in enumerate(loads)]
        self.guesses = tuple(drive.guesses for drive in drives)
        joints = tuple(drive.joint for drive in drives)
        config = ArmConfig(
            name=name or re.sub(r'\W+', '_', str(robot.model.name)).strip('_') or 'arm',
            joints=joints,
            boards=tuple(_board(number) for number in range((len(joints) + 1) // 2)),
            profile=PROFILE,
            gravity_in_base=tuple(robot.gravity_in_base.tolist()),
            rest_position=tuple(0.5 * (j.position_min + j.position_max) for j in joints),
            emulated_only=True,
        )
        config = _with_dynamics(config, robot)
        # An arm that hangs has its ground somewhere else.
        hangs = robot.gravity_in_base[2] > 0.0 or not robot.gravity_in_base.any()
        surroundings = ExcitationConfig(ground_height=None if hangs else 0.0)
        rest = RestPosture(
            robot,
            config.column('effort_max'),
            (config.column('position_min'), config.column('position_max')),
            surroundings,
            package_directories,
        )
        posture = tuple(rest.posture.tolist())
        self.config = replace(config, rest_position=posture)
        self.excitation = replace(rest.surroundings, bias=posture)
        self.problem = rest.problem


def _board(number: int) -> BoardConfig:
    bus, chip = divmod(number, _CHIP_SELECTS)
    return BoardConfig(f'board{number}', f'/dev/spidev{bus}.{chip}', _CLOCK, _MODE)


def _with_dynamics(config: ArmConfig, robot: Robot) -> ArmConfig:
    """Return the configuration with gains and acceleration limits that suit the arm's inertia."""
    loads = JointLoads(config, robot)
    drive = DriveTrain(config)
    gains = draft_gains(robot, drive.reflected_inertia, loads.damping_min)
    stiffness, damping = map(drive.joint_to_motor_gain, gains)
    profile = load_profile(config.profile)
    rows = zip(
        config.joints,
        _rounded_down(loads.deceleration),
        _rounded_down(np.minimum(stiffness, profile.command.largest('kp'))),
        _rounded(np.minimum(damping, profile.command.largest('kd'))),
        strict=True,
    )
    joints = tuple(
        replace(joint, acceleration_max=acceleration, board_kp=kp, board_kd=kd)
        for joint, acceleration, kp, kd in rows
    )
    config = replace(config, joints=joints)
    reach = BridgeSettings().position_error_max
    MotorReferences(config, profile, reach, loads.damping_min)
    return config


def _rounded(values: Array) -> list[float]:
    return [float(f'{value:.3g}') for value in values]


def _rounded_down(values: Array) -> list[float]:
    unit = 10.0 ** (np.floor(np.log10(values)) - 1.0)
    return _rounded(np.floor(values / unit) * unit)
