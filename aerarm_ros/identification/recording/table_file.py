"""Joint states from a table: CSV, or arrays in an .npz file."""

import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.recording.identification_error import IdentificationError

Array = npt.NDArray[np.float64]

TABLES = ('.csv', '.npz')
"""Suffixes of files that are tables."""

_LARGEST = 2**30  # bytes of a file, unpacked: 40 min of 7 joints at 1 kHz, thrice
_TIME = ('time', 'times', 't', 'stamp', 'stamps', 'timestamp', 'time_s')
_WORDS = {
    'position': ('position', 'positions', 'pos', 'q', 'angle'),
    'velocity': ('velocity', 'velocities', 'vel', 'dq', 'qd', 'qdot'),
    'effort': ('effort', 'efforts', 'torque', 'torques', 'tau', 'current'),
}
_NAMES = ('joint_names', 'names', 'joints')
_UNIT = re.compile(r'\s*[\[(]\s*([a-zA-Z/^0-9]*)\s*[\])]\s*$')
_SEPARATOR = '_./: -'


@dataclass(frozen=True)
class TableOptions:
    """What a table doesn't say of itself.

    Attributes
    ----------
    rate : float or None
        Of the rows [Hz], for tables without a column of time.
    degrees : bool
        Whether positions and velocities are in degrees.
    """

    rate: float | None = None
    degrees: bool = False

    def __post_init__(self) -> None:
        """Check the rate."""
        if self.rate is not None and not (np.isfinite(self.rate) and self.rate > 0.0):
            raise IdentificationError(f'--rate {self.rate:g} must be a positive frequency [Hz]')


@dataclass(frozen=True, eq=False)
class TableStates:
    """Joint states as a bag has them; what the table lacks is NaN.

    Attributes
    ----------
    names : tuple of n str
    stamp : (M,) ndarray
        [s]
    position, velocity, effort : (M, n) ndarray
        [rad], [rad/s], [Nm] or as recorded.
    """

    names: tuple[str, ...]
    stamp: Array
    position: Array
    velocity: Array
    effort: Array


def read_table(
    path: Path, joint_names: Sequence[str], options: TableOptions | None = None
) -> TableStates:
    """Read positions, velocities and efforts of joints.

    The first line of a CSV file names its columns, as `time, q_elbow, dq_elbow, tau_elbow` or
    `elbow.position [deg]`; `q1` or `q[0]` is of the first joint of the arm. An .npz file has arrays
    `time` (M,), `q`, `dq` and `tau` (M, n), or `position` and so on, and may have `joint_names`.

    Parameters
    ----------
    path : Path
    joint_names : sequence of n str
        The arm's joints, from base to tool: what numbers, and arrays without names, stand for.
    options : TableOptions, optional

    Raises
    ------
    IdentificationError
        If it can't be read, lacks what identification needs, or is too large.
    """
    options = options or TableOptions()
    try:
        if path.stat().st_size > _LARGEST:
            raise IdentificationError(f'{path}: larger than {_LARGEST >> 20} MB: cut it')
        columns = (
            _npz(path, joint_names) if path.suffix.lower() == '.npz' else _csv(path, joint_names)
        )
    except OSError as error:
        raise IdentificationError(f'{path}: {error.strerror or error}: check the path') from None
    except (ValueError, zipfile.BadZipFile) as error:
        if isinstance(error, IdentificationError):
            raise
        reason = ' '.join(str(error).split())
        raise IdentificationError(f'{path}: is no table of numbers ({reason})') from None
    return _states(path, columns, options)


_Columns = dict[tuple[str, str], Array]
"""Quantity and joint to values; ('time', '') to the time."""


def _csv(path: Path, joint_names: Sequence[str]) -> _Columns:
    with path.open(encoding='utf-8-sig', errors='replace') as file:
        header = file.readline().lstrip('#').strip()
        found = [d for d in (';', '\t', ',') if d in header]
        delimiter = found[0] if found else None
        names = [name.strip().strip('"') for name in header.split(delimiter)]
        if all(_is_number(name) for name in names):
            raise IdentificationError(
                f'{path}: the first line must name the columns, as time, q_{joint_names[0]}, '
                f'dq_{joint_names[0]}, tau_{joint_names[0]}'
            )
        values = np.loadtxt(file, delimiter=delimiter, ndmin=2)
    if values.shape[1] != len(names):
        raise ValueError(f'{len(names)} names for {values.shape[1]} columns')
    columns: _Columns = {}
    for name, column in zip(names, values.T, strict=True):
        unit = _UNIT.search(name)
        bare = name[: unit.start()] if unit and not unit[1].isdigit() else name
        key = _quantity(bare, joint_names)
        if key is None:
            continue
        if key in columns:
            raise IdentificationError(f'{path}: more than one column is the {" of ".join(key)}')
        in_degrees = unit is not None and unit[1].lower().startswith('deg')
        columns[key] = np.radians(column) if in_degrees else column
    return columns


def _npz(path: Path, joint_names: Sequence[str]) -> _Columns:
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > _LARGEST:
            raise IdentificationError(f'{path}: larger than {_LARGEST >> 20} MB, unpacked: cut it')
    with np.load(path, allow_pickle=False) as file:
        arrays = {key: np.asarray(file[key]) for key in file.files if _is_wanted(key)}
    given = next((arrays[key] for key in _NAMES if key in arrays), None)
    names = joint_names if given is None else [str(name) for name in np.ravel(given)]
    columns: _Columns = {}
    for key, array in arrays.items():
        if key in _NAMES:
            continue
        if key in _TIME:
            columns['time', ''] = np.ravel(np.asarray(array, dtype=float))
            continue
        values = np.asarray(array, dtype=float)
        if values.ndim != 2 or values.shape[1] != len(names):
            raise ValueError(f'{key} is {values.shape}, not (M, {len(names)})')
        quantity = next(name for name, words in _WORDS.items() if key in words)
        columns |= {(quantity, joint): values[:, i] for i, joint in enumerate(names)}
    return columns


def _states(
    path: Path, columns: Mapping[tuple[str, str], Array], options: TableOptions
) -> TableStates:
    names = tuple(dict.fromkeys(joint for quantity, joint in columns if quantity != 'time'))
    for quantity in ('position', 'effort'):
        missing = [name for name in names if (quantity, name) not in columns]
        if missing or not names:
            word = {'position': 'q', 'effort': 'tau'}[quantity]
            raise IdentificationError(
                f'{path}: no {quantity} of {", ".join(missing) or "any joint"}: name its column '
                f'{word}_{(missing or ["JOINT"])[0]}, or {word}1, {word}2 ... along the arm'
            )
    count = len(columns['position', names[0]])
    if any(len(values) != count for values in columns.values()):
        raise IdentificationError(f'{path}: its arrays differ in length')
    stamp = columns.get(('time', ''))
    if stamp is None:
        if options.rate is None:
            raise IdentificationError(
                f'{path}: no column of time: name it time [s], or give the rate of rows (--rate)'
            )
        stamp = np.arange(count) / options.rate
    unit = np.pi / 180.0 if options.degrees else 1.0
    unknown = np.full(count, np.nan)

    def of(quantity: str) -> Array:
        return np.column_stack([columns.get((quantity, name), unknown) for name in names])

    return TableStates(names, stamp, unit * of('position'), unit * of('velocity'), of('effort'))


def _quantity(column: str, joint_names: Sequence[str]) -> tuple[str, str] | None:
    """Return what a column is, and of which joint; None if it is something else."""
    if column.lower() in _TIME:
        return 'time', ''
    for quantity, words in _WORDS.items():
        for word in words:
            front, back = column[: len(word)].lower(), column[-len(word) :].lower()
            rest = column[len(word) :]
            number = re.fullmatch(r'[_.]?(?:(\d+)|\[(\d+)\])', rest) if front == word else None
            if number:
                # q1 is the first joint; q[0] is so too, as programs count.
                index = int(number[1]) - 1 if number[1] else int(number[2])
                if 0 <= index < len(joint_names):
                    return quantity, joint_names[index]
            elif front == word and rest[:1] and rest[0] in _SEPARATOR:
                return quantity, rest[1:].strip()
            elif back == word and len(column) > len(word) + 1:
                separator = column[-len(word) - 1]
                if separator in _SEPARATOR:
                    return quantity, column[: -len(word) - 1].strip()
    return None


def _is_wanted(key: str) -> bool:
    return key in _NAMES or key in _TIME or any(key in words for words in _WORDS.values())


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
