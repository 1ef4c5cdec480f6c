"""An arm and bags of it, as options of a command line describe them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from aerarm_msgs_py.storage.read_limits import ReadLimits
from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import STANDARD_GRAVITY, Robot, load_robot
from aerarm_ros.identification.recording.bag_facts import BagFacts
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.recording.recording import JointMapping, Recording
from aerarm_ros.identification.recording.table_file import TABLES, TableOptions
from aerarm_ros.ros.programs.identifier_bags import IdentifierBags, RecordedBag, bag_names

_MB = 2**20  # bytes


class RecordedArm:
    """The URDF, the drives, and what was recorded of them.

    Parameters
    ----------
    options : argparse.Namespace
        With the options of `identifier_options.add_arm_options`.
    paths : sequence of Path
        All bags that will be read, for their names.

    Attributes
    ----------
    config : ArmConfig or None
        None for the URDF of another arm without a configuration.
    robot : Robot
    messages : list of str
        What reading the bags warned of; it may be added to.
    read : dict
        Name of a bag to the RecordedBag that was read of it.

    Raises
    ------
    IdentificationError, DescriptionError, ConfigError
        If an option, the URDF or the configuration is wrong.
    """

    def __init__(self, options: argparse.Namespace, paths: Sequence[Path]) -> None:
        self._names = bag_names(paths)
        tables = any(path.suffix.lower() in TABLES for path in paths)
        given = {
            '--degrees': options.degrees,
            '--rate': options.rate is not None,
            '--numbered-from': options.numbered_from is not None,
        }
        for option in () if tables else [name for name, is_given in given.items() if is_given]:
            raise IdentificationError(
                f'{option} is for tables (.csv, .npz), and there is none: bags have stamps and '
                'joint names, and are in rad'
            )
        self.config = _load_config(options)
        self.robot = _load_robot(options, self.config)
        limits = ReadLimits(_MB * options.bag_part, options.bag_ratio)
        table = TableOptions(options.rate, options.degrees, options.numbered_from)
        self._bags = IdentifierBags(
            options.topic, self.robot.joint_names, _mapping(options), limits, table
        )
        self.messages = self._bags.messages
        self.read: dict[str, RecordedBag] = {}

    def name(self, path: Path) -> str:
        """Return a bag's short name."""
        return self._names[path]

    def recording(self, path: Path) -> Recording:
        """Read a bag; raises BagError or IdentificationError with what to check."""
        name = self._names[path]
        self.read[name] = self._bags.read(path, name)
        return self.read[name].recording

    def facts(self) -> dict[str, BagFacts]:
        """Return how complete the bags are that were read."""
        return {name: bag.facts for name, bag in self.read.items()}


def pair(text: str, option: str) -> tuple[str, str]:
    """Return both sides of LEFT=RIGHT; raises IdentificationError for anything else."""
    left, equals, right = text.partition('=')
    if not (left and equals and right):
        raise IdentificationError(f'{option} {text}: write it as LEFT=RIGHT')
    return left, right


def _load_config(options: argparse.Namespace) -> ArmConfig | None:
    # Another arm's URDF says nothing about this package's motors.
    if options.config is None and options.urdf is not None:
        return None
    return load_arm_config(options.config)


def _load_robot(options: argparse.Namespace, config: ArmConfig | None) -> Robot:
    gravity = options.gravity
    if gravity is None:
        gravity = config.gravity_in_base if config else STANDARD_GRAVITY
    return load_robot(options.urdf, gravity_in_base=gravity, locked=options.lock)


def _mapping(options: argparse.Namespace) -> JointMapping:
    return JointMapping(
        rename=dict(pair(text, '--rename') for text in options.rename),
        prefix=options.tf_prefix,
        ignored=tuple(options.ignore),
        locked=tuple(options.lock),
        effort_gain={
            joint: _number(gain, '--effort-gain')
            for joint, gain in (pair(text, '--effort-gain') for text in options.effort_gain)
        },
    )


def _number(text: str, option: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float('nan')
    if not np.isfinite(value) or value == 0.0:
        raise IdentificationError(f'{option}: {text} must be a number other than zero')
    return value
