"""Identification from a single bag of a fleet, as a row of a table."""

from __future__ import annotations

import argparse
import platform
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import numpy as np

from aerarm_ros.identification.assessment import BagAssessment
from aerarm_ros.identification.identification_result import IdentificationResult, judge, read_limits
from aerarm_ros.ros.programs.identifier_run import IdentifierRun

Row = dict[str, str | float | int | bool | None]

OK, FAILED = 'ok', 'failed'
STD = '_std'
"""Suffix of the columns with standard deviations."""
KEYS = ('bag', 'arm', 'date', 'status', 'reason')
"""First columns of every row, and the only ones of `failed_row`."""
_PACKAGE = 'aerarm_ros'


def identify(bag: Path, settings: argparse.Namespace) -> Row:
    """Identify an arm from one bag; without side effects, so that a run can be repeated.

    Parameters
    ----------
    bag : Path
        Recording; its last fraction `settings.holdout` is used for validation only.
    settings : argparse.Namespace
        Options of the identifier, and `arm_of_folder`: whether an arm's name is that of the bag's
        directory instead of the URDF's.

    Returns
    -------
    dict
        Value by column name, None for a missing value. Parameters have the names of the regressor's
        columns, and their standard deviations the suffix `_std`.

    Raises
    ------
    BagError, ConfigError, DescriptionError, IdentificationError
        If the bag cannot be used for identification.
    """
    options = argparse.Namespace(**{**vars(settings), 'bag': [bag]})
    result, start, seconds = IdentifierRun(options).identified()
    estimate = result.recommended.estimate
    row = first_columns(bag, settings, result.robot.model.name)
    row['date'] = _date(start)
    row['status'] = OK
    row |= {
        'samples': result.samples,
        'seconds': seconds,
        'cutoff': result.conditioner.cutoff,
        'condition_number': _number(result.thesis_base.condition_number),
        'physically_consistent': estimate.physically_consistent,
    }
    for role in ('identification', 'validation'):
        for solver in ('cad_friction', 'sdp'):
            assessed = getattr(result.solutions[solver], role)
            row |= _errors(f'{role}_{solver}', assessed)
    row['verdict'] = _verdict(result, settings)
    row['warnings'] = len(result.warnings)
    row['first_warning'] = result.warnings[0] if result.warnings else None
    std = np.full(len(estimate.theta), np.nan) if estimate.std is None else estimate.std
    for name, value, deviation in zip(estimate.model.columns, estimate.theta, std, strict=True):
        row[name], row[name + STD] = float(value), _number(float(deviation))
    row[f'{_PACKAGE}_version'], row['python_version'] = _version(), platform.python_version()
    return row


def first_columns(bag: Path, settings: argparse.Namespace, robot: str = '') -> Row:
    """Return the columns that every row has, for a bag that has not been read."""
    arm = bag.resolve().parent.name if settings.arm_of_folder else robot
    return {'bag': str(bag), 'arm': arm, 'date': None, 'status': FAILED, 'reason': None}


def _errors(name: str, assessed: list[BagAssessment]) -> Row:
    bag = assessed[0] if assessed else None
    return {
        f'{name}_filtered': None if bag is None else bag.filtered,
        f'{name}_raw': None if bag is None else bag.raw,
    }


def _verdict(result: IdentificationResult, settings: argparse.Namespace) -> bool | None:
    if not settings.verify:
        return None
    return judge(result, read_limits(settings.verify)).passed


def _date(start: float) -> str | None:
    """Return the start of a recording as text; None for tables, whose time begins at 0."""
    day = 86400.0
    if start < day:
        return None
    return datetime.fromtimestamp(start, UTC).isoformat(timespec='seconds')


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _version() -> str:
    try:
        return metadata.version(_PACKAGE)
    except metadata.PackageNotFoundError:
        return 'not installed'
