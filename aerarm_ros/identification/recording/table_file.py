"""Joint states from a table: a CSV file, or arrays in an .npz file."""

from __future__ import annotations

import itertools
import re
import warnings
import zipfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

import numpy as np

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.motion.signals import Array

TIME = ('time', 'times', 't', 'stamp', 'stamps', 'timestamp', 'time_s', '__time')
"""Accepted names of the time column."""

WORDS = {
    'position': ('position', 'positions', 'pos', 'q', 'angle', 'actual_q'),
    'velocity': ('velocity', 'velocities', 'vel', 'dq', 'qd', 'qdot', 'actual_qd'),
    'effort': ('effort', 'efforts', 'eff', 'torque', 'torques', 'tau'),
    'current': ('current', 'currents', 'actual_current', 'i'),
}
"""Accepted names of joint quantities; currents replace missing efforts."""

_DEGREE = np.pi / 180.0
# Factors to s, rad or m, rad/s or m/s, Nm or N; to A for currents.
_UNITS = {
    'time': {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9},
    'position': {'rad': 1.0, 'mrad': 1e-3, 'deg': _DEGREE, 'm': 1.0, 'mm': 1e-3},
    'velocity': {
        'rad/s': 1.0,
        'mrad/s': 1e-3,
        'deg/s': _DEGREE,
        'rpm': np.pi / 30.0,
        'm/s': 1.0,
        'mm/s': 1e-3,
        'rad': 1.0,  # as a unit of velocities, per second is meant
        'deg': _DEGREE,
    },
    'effort': {'nm': 1.0, 'mnm': 1e-3, 'n': 1.0, 'a': 1.0, 'ma': 1e-3},
    'current': {'a': 1.0, 'ma': 1e-3},
}
_SPELLINGS = (
    (r'[\s·*.]', ''),
    ('°|degrees?', 'deg'),
    ('radians?', 'rad'),
    ('^sec(onds?)?$', 's'),
    ('[µμ]s', 'us'),
)
_UNIT = re.compile(r'\s*[\[(]([^\[\]()]*)[\])]\s*$')
# A number or a joint name after the word of a quantity, or a joint name before the word.
_COLUMN = (
    r'{0}(?:[_.]?(?:(?P<number>\d+)|[\[(](?P<index>\d+)[\])])|[_./: -](?P<after>.*))'
    r'|(?P<before>.+)[_./: -]{0}'
)


@dataclass(frozen=True)
class TableColumn:
    """Meaning of one table column that contains times, positions, velocities or efforts.

    Attributes
    ----------
    quantity : str
        'time', or a key of `WORDS`.
    joint : str
        Name of the joint; empty for the time, and for a numbered joint before `named` is called.
    number : int or None
        Number of the joint in the column name, counted from 0 or 1.
    is_index : bool
        Whether the number is in brackets.
    factor : float
        Factor from the stated unit to SI units.
    unit : str
        Unit stated in the column name; empty if none.
    """

    quantity: str
    joint: str
    number: int | None = None
    is_index: bool = False
    factor: float = 1.0
    unit: str = ''


def first_number(numbers: Iterable[int], joints: int) -> int | None:
    """Return the number (0 or 1) of the first joint in column names; None if undetermined.

    Parameters
    ----------
    numbers : iterable of int
        Numbers of all columns of a table.
    joints : int
        Number of joints of the arm.
    """
    found = set(numbers)
    if 0 in found:
        return 0 if max(found) < joints else None
    return 1 if 1 in found else None


def table_column(name: str) -> TableColumn | None:
    """Return the meaning of a column, None for an unknown name.

    Recognized names are `q_elbow`, `elbow.position`, `q1`, `q_1` and `q[0]`, each with or without a
    unit, as in `q1 [deg]`, and with or without a path, as in `/joint_states/elbow/position`.

    Parameters
    ----------
    name : str
        Column name in the first line.

    Raises
    ------
    IdentificationError
        If the name states an unknown unit.
    """
    bare, unit = split_unit(name)
    if bare.lower() in TIME:
        return TableColumn('time', '', factor=unit_factor(name, 'time', unit), unit=unit)
    parts = bare.split('/')
    # The last parts of a topic-like path, or the whole name.
    for shorter in (parts[-1], '/'.join(parts[-2:])) if bare.startswith('/') else (bare,):
        if found := _of_joint(shorter):
            return replace(found, factor=unit_factor(name, found.quantity, unit), unit=unit)
    return None


def split_unit(name: str) -> tuple[str, str]:
    """Return a column name without its unit, and the unit ('' if the name states none)."""
    stated = _UNIT.search(name)
    if stated is None or stated[1].strip().isdigit():
        return name.strip(), ''
    return name[: stated.start()].strip(), stated[1].strip()


def unit_factor(name: str, quantity: str, unit: str) -> float:
    """Return the factor from a unit to SI; raises IdentificationError for an unknown unit."""
    known = _UNITS[quantity]
    short = unit.lower()
    for spelling, usual in _SPELLINGS:
        short = re.sub(spelling, usual, short)
    if short and short not in known:
        raise IdentificationError(
            f'column {name} has the unknown unit {unit}: use one of {", ".join(known)}'
        )
    return known.get(short, 1.0)


def _of_joint(name: str) -> TableColumn | None:
    """Return quantity and joint (name or number) of a column name."""
    for quantity, words in WORDS.items():
        for word in words:
            if found := re.fullmatch(_COLUMN.format(word), name, re.IGNORECASE):
                if number := found['number'] or found['index']:
                    return TableColumn(quantity, '', int(number), found['number'] is None)
                return TableColumn(quantity, (found['after'] or found['before'] or '').strip())
    return None


TABLES = ('.csv', '.npz')
"""File suffixes of tables."""

_LARGEST = 2**30  # bytes of an unpacked file: three times 40 min of 7 joints at 1 kHz


@contextmanager
def table_errors(path: Path, largest: int, kind: type[ValueError]) -> Iterator[None]:
    """Convert errors while a table is read to errors of type `kind` with one-line messages.

    Parameters
    ----------
    largest : int
        Largest size of the unpacked file in bytes.
    """
    try:
        size, unpacked = path.stat().st_size, ''
        if path.suffix.lower() == '.npz' and size <= largest:
            with zipfile.ZipFile(path) as archive:
                size = sum(entry.file_size for entry in archive.infolist())
            unpacked = ' when unpacked'
        if size > largest:
            raise kind(f'{path} is larger than {largest >> 20} MB{unpacked}: shorten the file')
        yield
    except OSError as error:
        raise kind(f'{path} cannot be read ({error.strerror or error}): check the path') from None
    except (ValueError, zipfile.BadZipFile, EOFError) as error:
        if isinstance(error, kind):
            raise
        reason = ' '.join(str(error).split())
        raise kind(f'{path} is not a table of numbers ({reason}): check the file format') from None


def column_names(
    path: Path, file: TextIO, example: str, kind: type[ValueError]
) -> tuple[list[str], str | None]:
    """Return the column names from the first line of a CSV file, and the delimiter.

    Parameters
    ----------
    example : str
        Column names, as an example for the error message.
    kind : type
        Type of the error that is raised if the line contains no names.
    """
    header = file.readline().lstrip('#').strip()
    delimiter = next((d for d in (';', '\t', ',') if d in header), None)
    names = [name.strip().strip('"') for name in header.split(delimiter)]
    if all(_is_number(name) for name in names):
        raise kind(f'the first line of {path} must name the columns, for example {example}')
    return names, delimiter


_NAMES = ('joint_names', 'names', 'joints')
_ANGLES = ('position', 'velocity')  # quantities whose unit an array `unit` states
_SHOWN = 40  # largest number of columns listed in an error


@dataclass(frozen=True)
class TableOptions:
    """Properties of a table that its column names do not specify.

    Attributes
    ----------
    rate : float or None
        Number of rows per second [Hz], for tables without a time column.
    degrees : bool
        Whether positions and velocities are in degrees, where their names state no unit.
    numbered_from : {0, 1} or None
        Number of the first joint; None to derive it from the columns.
    """

    rate: float | None = None
    degrees: bool = False
    numbered_from: int | None = None

    def __post_init__(self) -> None:
        """Validate the rate."""
        if self.rate is not None and not (np.isfinite(self.rate) and self.rate > 0.0):
            raise IdentificationError(f'--rate {self.rate:g} must be a positive frequency [Hz]')


@dataclass(frozen=True, eq=False)
class TableStates:
    """Joint states of a table; missing quantities are NaN.

    Attributes
    ----------
    stamp : (M,) ndarray
        Time [s].
    position, velocity, effort : (M, n) ndarray
        Positions [rad], velocities [rad/s], and efforts [Nm] or as recorded.
    columns : str
        Table columns of each joint; empty for a bag.
    """

    names: tuple[str, ...]
    stamp: Array
    position: Array
    velocity: Array
    effort: Array
    columns: str = ''

    def __repr__(self) -> str:
        """Return a one-line summary of the states."""
        seconds = float(np.ptp(self.stamp)) if len(self.stamp) else 0.0
        return f'<{len(self.stamp)} states over {seconds:.3g} s of {", ".join(self.names)}>'


def read_table(
    path: Path, joint_names: Sequence[str], options: TableOptions | None = None
) -> TableStates:
    """Read positions, velocities and efforts of joints from a table.

    The first line of a CSV file contains column names, for example `time, q_elbow, dq_elbow,
    tau_elbow` or `elbow.position [deg]`; see `table_column`. An .npz file contains arrays `time`
    (M,), `q`, `dq` and `tau` (M, n), or `position` and so on. The .npz file may also contain
    `joint_names` and `unit`, the unit of the angles.

    Parameters
    ----------
    joint_names : sequence of n str
        Joints of the arm, from base to tool, for numbered columns and arrays without names.

    Raises
    ------
    IdentificationError
        If the file cannot be read, lacks required columns, or is too large.
    """
    options = options or TableOptions()
    with table_errors(path, _LARGEST, IdentificationError):
        read = _npz if path.suffix.lower() == '.npz' else _csv
        columns, sources = read(path, joint_names, options)
        for (quantity, joint), values in list(columns.items()):
            if quantity == 'current':  # replaces a missing effort
                columns.setdefault(('effort', joint), values)
                del columns[quantity, joint]
    return _states(path, columns, sources, joint_names, options)


_Columns = dict[tuple[str, str], Array]
"""Columns in SI units, by quantity and joint; the time has the key ('time', '')."""
_Sources = dict[tuple[str, str], str]
"""Names of columns or arrays in the file, by quantity and joint."""


def _csv(
    path: Path, joint_names: Sequence[str], options: TableOptions
) -> tuple[_Columns, _Sources]:
    example = 'time, q_{0}, dq_{0}, tau_{0}'.format(joint_names[0])
    with path.open(encoding='utf-8-sig', errors='replace') as file:
        names, delimiter = column_names(path, file, example, IdentificationError)
        meanings = _meanings(path, names, joint_names, options)
        first = file.readline()
        count = len(first.split(delimiter))
        if first.strip() and count != len(names):
            raise ValueError(
                f'the first line has {len(names)} names, but there are {count} columns'
            )
        if not meanings:
            words = ', '.join(f'{name}: {"/".join(words)}' for name, words in WORDS.items())
            raise IdentificationError(
                f'{path} has no position of any joint (its columns are '
                f'{some_names(names, _SHOWN)}): name the columns time: {"/".join(TIME)}, {words}; '
                "each followed by _JOINT or the joint's number"
            )
        rows = itertools.chain([first], file)
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)  # without rows, there are too few states
            values = np.loadtxt(rows, delimiter=delimiter, ndmin=2, usecols=list(meanings))
    columns = {
        (meaning.quantity, meaning.joint): (
            meaning.factor if meaning.unit else _unstated(meaning.quantity, options)
        )
        * column
        for meaning, column in zip(meanings.values(), values.T, strict=True)
    }
    return columns, {
        (meaning.quantity, meaning.joint): names[place] for place, meaning in meanings.items()
    }


def _meanings(
    path: Path, names: Sequence[str], joint_names: Sequence[str], options: TableOptions
) -> dict[int, TableColumn]:
    """Return the meaning of each recognized column by its index; other columns are ignored."""
    try:
        found = {place: table_column(name) for place, name in enumerate(names)}
    except IdentificationError as error:
        raise IdentificationError(f'{path}: {error}') from None
    meanings: dict[int, TableColumn] = {}
    known: dict[tuple[str, str], str] = {}
    columns = {place: column for place, column in found.items() if column is not None}
    numbered = _numbered(path, columns, names, joint_names, options)
    for place, meaning in (columns | numbered).items():
        if meaning.number is not None:
            continue  # the column belongs to a joint that the arm lacks
        key = meaning.quantity, meaning.joint
        if key in known:
            raise IdentificationError(
                f'columns {known[key]} and {names[place]} of {path} both contain the '
                f'{" of ".join(filter(None, key))}: remove one'
            )
        known[key] = names[place]
        meanings[place] = meaning
    return meanings


def _numbered(
    path: Path,
    columns: Mapping[int, TableColumn],
    names: Sequence[str],
    joint_names: Sequence[str],
    options: TableOptions,
) -> dict[int, TableColumn]:
    """Return the columns; a numbered column receives the name of its joint."""
    named: dict[int, TableColumn] = {}
    for is_index in (False, True):
        group = {
            place: (column, column.number)
            for place, column in columns.items()
            if column.number is not None and column.is_index == is_index
        }
        if not group:
            continue
        first = options.numbered_from
        if first is None:
            first = first_number((number for _, number in group.values()), len(joint_names))
        if first is None:
            shown = [names[place] for place in group]
            raise IdentificationError(
                f'the numbers in the column names {some_names(shown, _SHOWN)} of '
                f'{path} may begin at 0 or at 1 for {len(joint_names)} joints: state the number of '
                f'{joint_names[0]} (--numbered-from 0 or 1, or numbered_from= of read_bag)'
            )
        for place, (column, number) in group.items():
            if 0 <= number - first < len(joint_names):
                named[place] = replace(column, joint=joint_names[number - first], number=None)
    return named


def some_names(names: Collection[str], most: int = 12) -> str:
    """Return names as text, truncated after `most` names."""
    shown = [name or "''" for name in list(names)[:most]]
    more = len(names) - len(shown)
    return ', '.join(shown) + (f' and {more} more' if more else '') or 'none'


def _unstated(quantity: str, options: TableOptions) -> float:
    """Return the factor to SI units of a quantity without a stated unit."""
    return np.pi / 180.0 if options.degrees and quantity in _ANGLES else 1.0


def _npz(
    path: Path, joint_names: Sequence[str], options: TableOptions
) -> tuple[_Columns, _Sources]:
    with np.load(path, allow_pickle=False) as file:
        arrays = {key: np.asarray(file[key]) for key in file.files if _is_wanted(key)}
    given = next((arrays[key] for key in _NAMES if key in arrays), None)
    names = joint_names if given is None else [str(name) for name in np.ravel(given)]
    unit = str(np.ravel(arrays.pop('unit'))[0]) if 'unit' in arrays else ''
    columns: _Columns = {}
    sources: _Sources = {}
    for words in (TIME, *WORDS.values()):
        same = [key for key in words if key in arrays]
        if len(same) > 1:
            raise IdentificationError(
                f'arrays {" and ".join(same)} of {path} contain the same quantity: remove one'
            )
    for key, array in arrays.items():
        if key in _NAMES:
            continue
        if key in TIME:
            columns['time', ''] = np.ravel(np.asarray(array, dtype=float))
            continue
        values = np.asarray(array, dtype=float)
        if values.ndim != 2 or values.shape[1] != len(names):
            raise ValueError(f'{key} has the shape {values.shape} instead of (M, {len(names)})')
        quantity = next(name for name, words in WORDS.items() if key in words)
        if unit and quantity in _ANGLES:
            values = unit_factor(f'{key} (array unit)', quantity, unit) * values
        else:
            values = _unstated(quantity, options) * values
        columns |= {(quantity, joint): values[:, i] for i, joint in enumerate(names)}
        sources |= {(quantity, joint): f'{key}[:, {i}]' for i, joint in enumerate(names)}
    return columns, sources


def _states(
    path: Path,
    columns: Mapping[tuple[str, str], Array],
    sources: Mapping[tuple[str, str], str],
    joint_names: Sequence[str],
    options: TableOptions,
) -> TableStates:
    needed = ('position', 'effort')
    names = tuple(dict.fromkeys(joint for quantity, joint in columns if quantity != 'time'))
    complete = [name for name in names if all((quantity, name) in columns for quantity in needed)]
    if complete:  # a column such as q_desired_elbow does not belong to a joint of the arm
        names = tuple(name for name in names if name in complete or name in joint_names)
    for quantity in needed:
        missing = [name for name in names if (quantity, name) not in columns]
        if missing or not names:
            word = {'position': 'q', 'effort': 'tau'}[quantity]
            raise IdentificationError(
                f'{path} has no {quantity} of {", ".join(missing) or "any joint"} (found: '
                f'{some_names(sources.values(), _SHOWN)}): name the column '
                f'{word}_{(missing or ["JOINT"])[0]}, or {word}1, {word}2 ... from the base to '
                'the tool'
            )
    count = len(columns['position', names[0]])
    if any(len(values) != count for values in columns.values()):
        raise IdentificationError(
            f'the arrays of {path} differ in length: save arrays of equal length'
        )
    stamp = columns.get(('time', ''))
    if stamp is None:
        if options.rate is None:
            raise IdentificationError(
                f"{path} has no time column: name a column 'time [s]', or pass the sampling rate "
                '(--rate, or rate= of read_bag)'
            )
        stamp = np.arange(count) / options.rate
    unknown = np.full(count, np.nan)

    def of(quantity: str) -> Array:
        return np.column_stack([columns.get((quantity, name), unknown) for name in names])

    used = (
        f'{name}: ' + ' '.join(source for key, source in sources.items() if key[1] == name)
        for name in names
    )
    return TableStates(names, stamp, of('position'), of('velocity'), of('effort'), ', '.join(used))


def _is_wanted(key: str) -> bool:
    return key in (*_NAMES, *TIME, 'unit', *itertools.chain(*WORDS.values()))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
