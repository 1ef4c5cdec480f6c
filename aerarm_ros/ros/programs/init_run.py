"""`arm init`: write the first configuration files of an arm from its URDF."""

from __future__ import annotations

import argparse
from pathlib import Path

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.draft.arm_draft import ArmDraft, read_drives
from aerarm_ros.draft.draft_text import MARK, arm_text, excitation_text
from aerarm_ros.excitation.design_file import write_design
from aerarm_ros.excitation.settings import load_excitation_config


def init_arm(options: argparse.Namespace) -> None:
    """Read a URDF, write an arm configuration and an excitation configuration, and print both.

    Parameters
    ----------
    options : argparse.Namespace
        `urdf`, `name`, `out`, `locked`, `gravity`, `package_directory`, `estimate` and
        `overwrite`.

    Raises
    ------
    ValueError, OSError
        If the URDF cannot be used, or an output file already exists. In both cases the program
        writes no file.
    """
    urdf: Path = options.urdf
    robot = load_robot(urdf, gravity_in_base=options.gravity, locked=options.locked)
    estimate = options.estimate
    identified = None if estimate is None else read_drives(estimate, robot.joint_names)
    draft = ArmDraft(robot, options.name, options.package_directory, identified)
    config = draft.config
    files = [options.out / f'{config.name}{end}' for end in ('.yaml', '_excitation.yaml')]
    for file in files:
        if file.exists() and not options.overwrite:
            raise ValueError(
                f'{file} already exists: pass another --name or --out, or pass --overwrite to '
                'replace the file and your changes in it'
            )
    options.out.mkdir(parents=True, exist_ok=True)
    text = arm_text(draft, urdf.name)
    write_design(files[0], text)
    write_design(files[1], excitation_text(draft, urdf.name))
    load_arm_config(files[0])
    load_excitation_config(files[1])
    source = 'URDF' if estimate is None else 'URDF or estimate'
    print(
        f'{urdf}: {robot.inertial_parameters[:, 0].sum():.2f} kg of moving mass, {config.n} '
        f'joints: {", ".join(config.joint_names)}\n'
        f'{files[0]}: {len(config.boards)} boards. {text.count(MARK)} values are guesses, because '
        f'they are not in the {source}; a comment marks each guess and states how to measure the '
        f'value\n{files[1]}: limits and obstacles for excitation motions'
    )
    _print_problem(draft)
    given = f'-p config:={files[0]} -p urdf:={urdf}'
    folders = ', '.join(f'"{folder.resolve()}"' for folder in options.package_directory)
    meshes = f" -p 'package_directories:=[{folders}]'" if folders else ''
    print(
        'Try the files on emulated boards. Run each line in a separate terminal:\n'
        f'  fake_hardware --ros-args {given}\n'
        '  arm home --wait-before unhomed --wait ready\n'
        f'  excitation --ros-args {given} -p excitation_config:={files[1]}{meshes}'
    )


def _print_problem(draft: ArmDraft) -> None:
    if not draft.problem:
        return
    config = draft.excitation
    written = (
        f'self_clearance {config.self_clearance:g}, ground_clearance {config.ground_clearance:g} '
        f'and ground_height {"null" if config.ground_height is None else config.ground_height}'
    )
    if not config.check_clearance:
        written = 'check_clearance: false, so motions are NOT checked for collisions'
    print(f'arm init: warning: {draft.problem}. The written files contain {written}')
