"""Postures and measurements from a CSV file."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from aerarm_ros.calibration.observations import CalibrationError
from aerarm_ros.calibration.plateaus import Track, rotations
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.table_file import (
    TableColumn,
    column_names,
    some_names,
    split_unit,
    table_column,
    table_errors,
)
from aerarm_ros.motion.signals import Array

LENGTH_UNITS = {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3, 'um': 1e-6}
_ANGLE_UNITS = {'rad': 1.0, 'mrad': 1e-3, 'deg': np.pi / 180.0, '°': np.pi / 180.0}
_LARGEST = 2**28  # bytes
# More rows with smaller intervals [s] are samples of a motion.
_MOVING_ROWS, _MOVING_INTERVAL = 200, 0.2
_AXIS = r'(?P<axis>qx|qy|qz|qw|phi[xyz]|roll|pitch|yaw|[xyz])'
# Accepted forms: x1, qx_1, x[1]; marker1.x, tool_x, m1/qx; x alone.
_FORMS = (
    re.compile(rf'^{_AXIS}[_.]?(?P<name>\d+)$', re.IGNORECASE),
    re.compile(rf'^{_AXIS}\[(?P<name>\d+)\]$', re.IGNORECASE),
    re.compile(rf'^(?P<name>.*[^_./: -])[_./: -]{_AXIS}$', re.IGNORECASE),
    re.compile(rf'^{_AXIS}(?P<name>)$', re.IGNORECASE),
)
_SAME = {'phix': 'roll', 'phiy': 'pitch', 'phiz': 'yaw'}
_ANGLES = ('roll', 'pitch', 'yaw')
_UNSEEN = ('', 'nan', 'none', 'null', 'na')  # cell contents that mean a missing measurement


@dataclass(eq=False)
class PostureTable:
    """Joint positions and measurements read from a table with one posture per row.

    Attributes
    ----------
    joints : dict of str to (M,) ndarray
        Positions [rad], for prismatic joints [m].
    measured : dict of str to Track
        Measurements by name of marker or body, in M rows; a missing measurement is NaN.
    mapping : list of str
        Meaning of each column, as text.
    unused : list of str
        Names of columns that the calibration does not use.
    """

    joints: dict[str, Array] = field(default_factory=dict)
    measured: dict[str, Track] = field(default_factory=dict)
    mapping: list[str] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)


def read_postures(
    path: Path,
    known_joints: Collection[str],
    length_unit: str = '',
    degrees: bool = False,
    rename: Mapping[str, str] | None = None,
    prismatic: Collection[str] = (),
) -> PostureTable:
    """Read joint positions, markers and poses from a table.

    A column with joint positions has the joint's name (`elbow`) or a name that the identifier
    accepts (`q_elbow`, `elbow.position [deg]`). Markers have columns `x1, y1, z1` or `tip.x [mm],
    tip.y [mm], tip.z [mm]`. Poses have additional columns `qx, qy, qz, qw` or `roll, pitch, yaw`
    (also `phix1 ...`). Empty cells mean missing measurements.

    Parameters
    ----------
    known_joints : collection of str
        Driven joints of the URDF.
    length_unit : str
        Unit of marker positions if the column states none: 'm' (also if empty), 'cm' or 'mm'.
    degrees : bool
        Whether an angle is in degrees if its column states no unit.
    rename : mapping, optional
        Maps joint names in the table to joint names in the URDF.
    prismatic : collection of str
        Prismatic joints, whose positions are lengths [m]; `degrees` does not apply to them.

    Raises
    ------
    CalibrationError
        If the file cannot be read, or contains no joint or no measurements.
    """
    wrong: dict[str, str] = {}
    with table_errors(path, _LARGEST, CalibrationError):
        columns = _csv_columns(path, wrong)
    _check_rest(path, columns)
    reader = _Reader(path, known_joints, length_unit, degrees, rename or {}, prismatic)
    table = reader.table(columns)
    for name, problem in wrong.items():
        if name not in table.unused:
            raise CalibrationError(f'{path}: column {name}: {problem}')
    return table


def _check_rest(path: Path, columns: Mapping[str, Array]) -> None:
    """Raise CalibrationError if the rows are samples of a motion instead of resting postures."""
    for name, values in columns.items():
        column = _known_column(name)
        if column is None or column.quantity != 'time' or len(values) <= _MOVING_ROWS:
            continue
        interval = column.factor * float(np.nanmedian(np.diff(values)))
        if interval < _MOVING_INTERVAL:
            raise CalibrationError(
                f'the rows of {path} are {interval:.2g} s apart, so the table records a motion: '
                'pass one row per posture in which the arm rests, or a bag'
            )


class _Reader:
    """Assignment of table columns to joints, markers and poses."""

    def __init__(
        self,
        path: Path,
        known: Collection[str],
        length_unit: str,
        degrees: bool,
        rename: Mapping[str, str],
        prismatic: Collection[str],
    ) -> None:
        self._path, self._known, self._rename = path, known, rename
        self._length_unit = length_unit or 'm'
        self._angle_unit = 'deg' if degrees else 'rad'
        self._prismatic = prismatic
        self._table = PostureTable()
        self._axes: dict[str, dict[str, tuple[str, Array, float]]] = {}

    def table(self, columns: Mapping[str, Array]) -> PostureTable:
        table = self._table
        for name, values in columns.items():
            if not (self._joint(name, values) or self._place(name, values)):
                table.unused.append(name)
        if not table.joints:
            self._number_joints(columns)
        for thing, axes in self._axes.items():
            self._thing(thing, axes)
        if not table.joints:
            raise CalibrationError(
                f'none of the columns of {self._path} ({some_names(columns)}) is a joint of the '
                f'URDF ({some_names(self._known)}): name the columns like the joints, or pass '
                '--rename COLUMN=JOINT'
            )
        if not table.measured:
            raise CalibrationError(
                f'{self._path} has no marker columns (its columns are {some_names(columns)}): '
                'name marker columns x1, y1, z1 [m]'
            )
        return table

    def _number_joints(self, columns: Mapping[str, Array]) -> None:
        """Assign columns `q1 ... qn` to the joints of the URDF in order."""
        found = [(_known_column(name), name) for name in self._table.unused]
        numbered = sorted(
            (column.number, name)
            for column, name in found
            if column and column.quantity == 'position' and column.number is not None
        )
        if len(numbered) == len(self._known):
            for joint, (_, name) in zip(self._known, numbered, strict=True):
                self._joint(name, columns[name], joint)
                self._table.unused.remove(name)

    def _joint(self, name: str, values: Array, joint: str = '') -> bool:
        bare, unit = split_unit(name)
        joint, column = joint or self._rename.get(bare, bare), _known_column(name)
        if joint not in self._known and column is not None and column.quantity == 'position':
            joint = self._rename.get(column.joint, column.joint)
        if joint not in self._known:
            return False
        if joint in self._table.joints:
            raise CalibrationError(
                f'{self._path} has two columns of joint {joint}, the second is {name}: remove one'
            )
        if unit and column is not None:
            factor = column.factor
        else:
            unit = unit or ('m' if joint in self._prismatic else self._angle_unit)
            factor = self._factor(name, unit, {**_ANGLE_UNITS, **LENGTH_UNITS})
        self._table.joints[joint] = factor * values
        self._table.mapping.append(f'joint {joint}: column {name} [{unit}]')
        return True

    def _factor(self, name: str, unit: str, units: Mapping[str, float]) -> float:
        if unit.lower() not in units:
            raise CalibrationError(
                f'column {name} of {self._path} has the unknown unit {unit}: use one of '
                f'{", ".join(units)}'
            )
        return units[unit.lower()]

    def _place(self, name: str, values: Array) -> bool:
        bare, unit = split_unit(name)
        match = next((found for form in _FORMS if (found := form.match(bare))), None)
        if match is None:
            return False
        axis = match['axis'].lower()
        axis = _SAME.get(axis, axis)
        if axis in 'xyz':
            if unit and unit.lower() not in LENGTH_UNITS:
                return False
            factor = LENGTH_UNITS[(unit or self._length_unit).lower()]
        else:
            factor = 1.0
            if not axis.startswith('q'):
                factor = self._factor(name, unit or self._angle_unit, _ANGLE_UNITS)
        thing = self._axes.setdefault(match['name'] or '1', {})
        if axis in thing:
            raise CalibrationError(
                f'columns {thing[axis][0]} and {name} of {self._path} contain the same quantity: '
                'remove one of these columns'
            )
        thing[axis] = (name, values, factor)
        return True

    def _thing(self, thing: str, axes: Mapping[str, tuple[str, Array, float]]) -> None:
        missing = [axis for axis in 'xyz' if axis not in axes]
        names = [column for column, _, _ in axes.values()]
        if len(missing) == 3 or (missing and thing in ('', '1') and len(axes) == 1):
            self._table.unused += names
            return
        if missing:
            raise CalibrationError(
                f'marker {thing} of {self._path} has no {missing[0]}, only {", ".join(names)}: '
                'add the column, or remove the marker'
            )
        for keys in ('xyz', _ANGLES):
            if len({axes[key][2] for key in keys if key in axes}) > 1:
                listed = ', '.join(axes[key][0] for key in keys if key in axes)
                raise CalibrationError(
                    f'columns {listed} of {self._path} have different units: state the same unit '
                    'in each of them'
                )
        position = np.column_stack([axes[axis][2] * axes[axis][1] for axis in 'xyz'])
        rotation = _rotation(axes)
        label = thing if not thing.isdigit() else f'marker{thing}'
        used = ', '.join(column for column, _, _ in axes.values())
        unit = split_unit(axes['x'][0])[1] or self._length_unit
        kind = 'marker' if rotation is None else 'pose'
        self._table.mapping.append(f'{kind} {label}: columns {used} [{unit}]')
        rows = np.arange(float(len(position)))
        self._table.measured[label] = Track(label, rows, position, rotation)


def _known_column(name: str) -> TableColumn | None:
    try:
        return table_column(name)
    except IdentificationError:
        return None


def _rotation(axes: Mapping[str, tuple[str, Array, float]]) -> Array | None:
    """Return rotations (M, 3, 3) from quaternions, or from roll, pitch and yaw; None if missing."""
    for keys in (('qx', 'qy', 'qz', 'qw'), _ANGLES):
        if not axes.keys() >= set(keys):
            continue
        values = np.column_stack([axes[key][2] * axes[key][1] for key in keys])
        if keys is _ANGLES:
            values = Rotation.from_euler('xyz', values).as_quat()
        return rotations(values)
    return None


def _csv_columns(path: Path, wrong: dict[str, str]) -> dict[str, Array]:
    """Return the columns of a CSV file; for a non-numeric column, `wrong` receives the reason."""
    with path.open(encoding='utf-8-sig', errors='replace') as file:
        example = 'x1, y1, z1, joint1, joint2'
        names, delimiter = column_names(path, file, example, CalibrationError)
        rows = [line.rstrip('\r\n').split(delimiter) for line in file if line.strip()]
    if not rows:
        raise CalibrationError(f'{path} has no rows below its first line: add the measurements')
    for number, row in enumerate(rows, start=2):
        if len(row) != len(names):
            raise CalibrationError(
                f'line {number} of {path} has {len(row)} values, but there are '
                f'{len(names)} columns: correct the line'
            )
    seen = [name for name in names if name]
    twice = next((name for name in seen if names.count(name) > 1), None)
    if twice is not None:
        raise CalibrationError(f'{path} has two columns with the name {twice}: remove one')
    columns = {}
    for place, name in enumerate(names):
        texts = [row[place].strip().strip('"') for row in rows]
        if not name and not any(texts):
            continue
        values = np.array([_number(text) for text in texts])
        for line, (text, value) in enumerate(zip(texts, values, strict=True), start=2):
            if np.isnan(value) and text.lower() not in _UNSEEN:
                wrong[name] = f"'{text}' in line {line} is not a number: leave the cell empty"
                break
        columns[name or f'column {place + 1}'] = values
    return columns


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float('nan')
