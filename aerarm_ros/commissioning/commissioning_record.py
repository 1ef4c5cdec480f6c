"""Record of a commissioned arm, a YAML file next to its configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from math import isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.config_reader import ConfigError, read_yaml
from aerarm_ros.description.drive_config import JointConfig
from aerarm_ros.description.resources import write_whole

_FORMAT = 1
_HEADER = (
    '# What `arm commission` found of this arm, see docs/how-to/commissioning.md.\n'
    '# The bridge reads pulse_offset; edit nothing, commission again.\n'
)
_DIGITS = 9  # significant digits
_SAME = 1e-6  # relative difference
_ADVICE = "run 'arm commission'"


@dataclass(frozen=True)
class JointRecord:
    """Commissioning result of one joint.

    Attributes
    ----------
    date
        Date of the entry.
    findings
        Problems found; empty for a joint that passed.
    measured
        Numbers by name: pulse_offset [rad], reduction, delivered, friction [Nm], load [Nm].
    configuration
        Values of the joint's configuration at that time.
    """

    date: datetime
    findings: tuple[str, ...]
    measured: Mapping[str, float]
    configuration: Mapping[str, float]

    @classmethod
    def of(
        cls,
        joint: JointConfig,
        date: datetime,
        findings: Sequence[str],
        measured: Mapping[str, float],
    ) -> JointRecord:
        """Return the record of a joint from its configuration and findings."""
        return cls(date, tuple(findings), dict(measured), _configuration(joint))

    @property
    def passed(self) -> bool:
        """Whether the joint passed commissioning."""
        return not self.findings

    @property
    def has_pulse_offset(self) -> bool:
        """Whether the angle of the joint's index pulses was measured."""
        return 'pulse_offset' in self.measured


@dataclass(frozen=True)
class CommissioningRecord:
    """Commissioning result of an arm.

    Attributes
    ----------
    arm
        Name of the arm.
    emulated
        Whether its boards were emulated.
    date
        Date of the last entry; None without one.
    joints
        Entries by joint name, without the topic prefix.
    """

    arm: str
    emulated: bool = False
    date: datetime | None = None
    joints: Mapping[str, JointRecord] = field(default_factory=dict)

    def problem(self, config: ArmConfig, emulated: bool = False) -> str:
        """Return why an arm counts as not commissioned, with the remedy; '' if commissioned."""
        if self.arm != config.name:
            return f'the commissioning record is of {self.arm}, not of {config.name}: {_ADVICE}'
        if self.emulated and not emulated:
            return f'the commissioning record is of an emulated arm: {_ADVICE}'
        names = config.joint_names
        missing = [name for name in names if name not in self.joints]
        if missing:
            return f'{", ".join(missing)} not commissioned: {_ADVICE}'
        failed = [name for name in names if not self.joints[name].passed]
        if failed:
            finding = self.joints[failed[0]].findings[0]
            return f'{", ".join(failed)} did not pass the commissioning ({finding}): {_ADVICE}'
        bare = [name for name in names if not self.joints[name].has_pulse_offset]
        if bare:
            return f'the record has no pulse_offset of {", ".join(bare)}: {_ADVICE}'
        for joint in config.joints:
            key = self.changed_key(joint)
            if key:
                return f'{key} of {joint.name} has changed since the commissioning: {_ADVICE}'
        return ''

    def changed_key(self, joint: JointConfig) -> str:
        """Return the changed configuration key of a recorded joint, '' if none has changed."""
        then, now = self.joints[joint.name].configuration, _configuration(joint)
        changed = [
            key
            for key, value in now.items()
            if abs(then.get(key, np.inf) - value) > _SAME * abs(value)
        ]
        return next(iter(changed), '')

    def open_joints(self, config: ArmConfig) -> list[int]:
        """Return the numbers of the joints that must be commissioned, including changed ones."""
        return [
            i
            for i, joint in enumerate(config.joints)
            if joint.name not in self.joints
            or not self.joints[joint.name].passed
            or not self.joints[joint.name].has_pulse_offset
            or self.changed_key(joint)
        ]

    def pulse_offset(self, config: ArmConfig) -> NDArray[np.float64]:
        """Return the motor angles of the index pulses modulo a turn, (n,) [rad].

        The value is 0 for a joint without measured pulses, or whose drive configuration has
        changed; `problem` names that joint.
        """
        offsets = np.zeros(config.n)
        for i, joint in enumerate(config.joints):
            entry = self.joints.get(joint.name)
            if entry is not None and entry.has_pulse_offset and not self.changed_key(joint):
                offsets[i] = entry.measured['pulse_offset']
        return offsets

    def with_prefix(self, prefix: str) -> CommissioningRecord:
        """Return the record with joint names as on the topics."""
        named = {f'{prefix}{name}': entry for name, entry in self.joints.items()}
        return replace(self, joints=named)

    def without_prefix(self, prefix: str) -> CommissioningRecord:
        """Return the record with joint names as in files; the inverse of `with_prefix`."""
        named = {name.removeprefix(prefix): entry for name, entry in self.joints.items()}
        return replace(self, joints=named)

    def save(self, path: Path) -> None:
        """Write the record, completely or not at all; raises OSError."""
        joints = {name: _plain(entry) for name, entry in self.joints.items()}
        document = {
            'format': _FORMAT,
            'arm': self.arm,
            'emulated': self.emulated,
            'date': self.date.isoformat(timespec='seconds') if self.date else '',
            'joints': joints,
        }
        write_whole(path, _HEADER + yaml.safe_dump(document, sort_keys=False, allow_unicode=True))


def record_path(config_path: Path, emulated: bool = False) -> Path:
    """Return the path of the record that belongs to a configuration."""
    kind = '.emulated' if emulated else ''
    return config_path.with_name(f'{config_path.stem}{kind}.commissioning.yaml')


def load_record(path: Path) -> CommissioningRecord:
    """Read a commissioning record.

    Raises
    ------
    ConfigError
        If the file cannot be read or is not a valid record; one line, with file and key.
    """
    document = read_yaml(path)
    try:
        if document.get('format') != _FORMAT:
            raise ConfigError(f'format = {document.get("format")!r}, must be {_FORMAT}')
        joints = {str(name): _entry(entry) for name, entry in _mapping(document, 'joints').items()}
        date = document.get('date')
        return CommissioningRecord(
            str(document.get('arm', '')),
            document.get('emulated') is True,
            _date(date) if date else None,
            joints,
        )
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}: {_ADVICE} again, or remove the file') from None


def _configuration(joint: JointConfig) -> dict[str, float]:
    return {
        'board': joint.board,
        'channel': joint.channel,
        'sign': joint.sign,
        'offset': joint.offset,
        'reduction': 1.0 / joint.gear.ratio,
        'torque_constant': joint.motor.torque_constant,
    }


def _plain(entry: JointRecord) -> dict[str, Any]:
    def rounded(values: Mapping[str, float]) -> dict[str, float]:
        return {
            key: value if isinstance(value, int) else float(f'{value:.{_DIGITS}g}')
            for key, value in values.items()
        }

    return {
        'passed': entry.passed,
        'date': entry.date.isoformat(timespec='seconds'),
        **rounded(entry.measured),
        'findings': list(entry.findings),
        'configuration': rounded(entry.configuration),
    }


def _entry(entry: Any) -> JointRecord:
    if not isinstance(entry, dict):
        raise ConfigError(f'joints: {entry!r} is not the entry of a joint')
    findings = entry.get('findings')
    if not isinstance(findings, list) or entry.get('passed') is not (not findings):
        raise ConfigError('joints: passed contradicts findings')
    measured = {key: value for key, value in entry.items() if isinstance(value, float | int)}
    measured.pop('passed', None)
    _check_numbers(measured)
    offset = measured.get('pulse_offset', 0.0)
    if not 0.0 <= offset < 2.0 * pi + _SAME:
        raise ConfigError(f'joints: pulse_offset = {offset} is not from 0 to 2 pi')
    configuration = _mapping(entry, 'configuration')
    _check_numbers(configuration)
    return JointRecord(_date(entry.get('date')), tuple(map(str, findings)), measured, configuration)


def _check_numbers(values: Mapping[Any, Any]) -> None:
    for key, value in values.items():
        if not isinstance(value, float | int) or not isfinite(value):
            raise ConfigError(f'joints: {key} = {value!r} is not a number')


def _mapping(document: Mapping[str, Any], key: str) -> dict[str, Any]:
    value = document.get(key)
    if not isinstance(value, dict):
        raise ConfigError(f'{key} = {value!r} is not a mapping')
    return value


def _date(value: Any) -> datetime:
    if isinstance(value, datetime):  # YAML converts an unquoted date
        return value
    try:
        return datetime.fromisoformat(value)
    except (TypeError, ValueError):
        raise ConfigError(f'date = {value!r} is not a date') from None
