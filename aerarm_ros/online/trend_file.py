"""Friction records in a small text file."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from aerarm_ros.description.whole_file import write_whole
from aerarm_ros.online.friction_trend import MOST, FrictionRecord, FrictionTrend

_KINDS = ('viscous', 'coulomb', 'load')
_LARGEST = 1000 * MOST  # bytes: so many records of some joints are smaller


class TrendFileError(ValueError):
    """A file that holds no trend of this arm; the text says what to check."""


def read_trend(path: Path, joint_names: Sequence[str] | None = None) -> FrictionTrend:
    """Return the trend that `write_trend` has left, an empty one if there is no such file.

    Parameters
    ----------
    path : Path
    joint_names : sequence of str, optional
        Of the arm; whatever the file names if not given, and then there has to be one.

    Raises
    ------
    TrendFileError
        If it holds anything else, or is of another arm.
    OSError
        If it can't be read.
    """
    if joint_names is not None and not path.exists():
        return FrictionTrend(joint_names)
    if path.stat().st_size > _LARGEST:
        raise TrendFileError(f'{path}: is too large for a trend of friction: give another file')
    lines = path.read_text(errors='replace').splitlines()
    names = _names(lines[0] if lines else '')
    if not names or lines[0] != _header(names):
        raise TrendFileError(f'{path}: is no trend of friction: give a new file, or that of before')
    if joint_names is not None and names != tuple(joint_names):
        raise TrendFileError(
            f'{path}: is of joints {", ".join(names)}, not {", ".join(joint_names)}: each arm has '
            'a file of its own'
        )
    records = []
    for number, line in enumerate(lines[1:], 2):
        try:
            records.append(_record(line, len(names)))
        except ValueError:
            raise TrendFileError(
                f'{path}: line {number} is no record of friction: take the line out'
            ) from None
    return FrictionTrend(names, records)


def write_trend(path: Path, trend: FrictionTrend) -> None:
    """Put a trend into the file's place, whole or not at all; raises OSError."""
    lines = [_header(trend.joint_names)]
    for record in trend.records:
        date = datetime.fromtimestamp(record.time, UTC).isoformat(timespec='seconds')
        values = np.stack([record.friction, record.std]).ravel()
        lines.append(','.join([date, *(f'{value:.6g}' for value in values)]))
    write_whole(path, '\n'.join(lines) + '\n')


def _header(joint_names: Sequence[str]) -> str:
    columns = [f'{kind} {joint}' for kind in _KINDS for joint in joint_names]
    return ','.join(['date', *columns, *(f'std {column}' for column in columns)])


def _names(header: str) -> tuple[str, ...]:
    first = f'{_KINDS[0]} '
    columns = header.split(',')
    return tuple(column.removeprefix(first) for column in columns if column.startswith(first))


def _record(line: str, n: int) -> FrictionRecord:
    date, *columns = line.split(',')
    when = datetime.fromisoformat(date)
    if when.tzinfo is None:
        when = when.replace(tzinfo=UTC)
    values = np.array(columns, dtype=float).reshape(2, 3, n)
    if not np.isfinite(values).all() or not (values[1] > 0.0).all():
        raise ValueError('no numbers that can be used')
    return FrictionRecord(when.timestamp(), values[0], values[1])
