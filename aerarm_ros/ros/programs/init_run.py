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


class InitRun:
    """Read a URDF, and write an arm configuration and an excitation configuration.

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

    def __init__(self, options: argparse.Namespace) -> None:
        self._urdf: Path = options.urdf
        robot = load_robot(options.urdf, gravity_in_base=options.gravity, locked=options.locked)
        identified = None
        if options.estimate is not None:
            identified = read_drives(options.estimate, robot.joint_names)
        self._is_guessed = identified is None
        self._folders: list[Path] = options.package_directory
        self._draft = ArmDraft(robot, options.name, self._folders, identified)
        self._mass = float(robot.inertial_parameters[:, 0].sum())
        name = self._draft.config.name
        self._arm_file = options.out / f'{name}.yaml'
        self._excitation_file = options.out / f'{name}_excitation.yaml'
        for file in (self._arm_file, self._excitation_file):
            if file.exists() and not options.overwrite:
                raise ValueError(
                    f'{file} already exists: pass another --name or --out, or pass --overwrite to '
                    'replace the file and your changes in it'
                )

    def run(self) -> None:
        """Write the files, check them by reading them again, and print the next steps."""
        draft = self._draft
        self._arm_file.parent.mkdir(parents=True, exist_ok=True)
        text = arm_text(draft, self._urdf.name)
        write_design(self._arm_file, text)
        write_design(self._excitation_file, excitation_text(draft, self._urdf.name))
        load_arm_config(self._arm_file)
        load_excitation_config(self._excitation_file)
        joints = draft.config.joint_names
        print(
            f'{self._urdf}: {self._mass:.2f} kg of moving mass, {len(joints)} joints: '
            f'{", ".join(joints)}'
        )
        print(
            f'{self._arm_file}: {len(draft.config.boards)} boards. {text.count(MARK)} values are '
            f'guesses, because they are not in the URDF'
            f'{"" if self._is_guessed else " or estimate"}; a comment marks each guess and states '
            'how to measure the value'
        )
        print(f'{self._excitation_file}: limits and obstacles for excitation motions')
        if draft.problem:
            config = draft.excitation
            written = (
                f'self_clearance {config.self_clearance:g}, ground_clearance '
                f'{config.ground_clearance:g} and ground_height '
                f'{"null" if config.ground_height is None else config.ground_height}'
            )
            if not config.check_clearance:
                written = 'check_clearance: false, so motions are NOT checked for collisions'
            print(f'arm init: warning: {draft.problem}. The written files contain {written}')
        files = f'-p config:={self._arm_file} -p urdf:={self._urdf}'
        folders = ', '.join(f'"{folder.resolve()}"' for folder in self._folders)
        meshes = f" -p 'package_directories:=[{folders}]'" if folders else ''
        print(
            'Try the files on emulated boards. Run each line in a separate terminal:\n'
            f'  fake_hardware --ros-args {files}\n'
            '  arm home --wait-before unhomed --wait ready\n'
            f'  excitation --ros-args {files} -p excitation_config:={self._excitation_file}{meshes}'
        )
