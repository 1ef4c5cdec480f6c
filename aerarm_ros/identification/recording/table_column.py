"""What a column of a table is, by its name."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.recording.identification_error import IdentificationError

TIME = ('time', 'times', 't', 'stamp', 'stamps', 'timestamp', 'time_s', '__time')
"""Names of the time."""

WORDS = {
    'position': ('position', 'positions', 'pos', 'q', 'angle'),
    'velocity': ('velocity', 'velocities', 'vel', 'dq', 'qd', 'qdot'),
    'effort': ('effort', 'efforts', 'torque', 'torques', 'tau'),
    'current': ('current', 'currents'),
}
"""Names of what is recorded of joints; currents are efforts where there are no others."""

_DEGREE = np.pi / 180.0
# To s, rad or m, rad/s or m/s, Nm or N; of currents to A.
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
        'rad': 1.0,  # of a velocity only per second can be meant
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
_SEPARATOR = '_./: -'


@dataclass(frozen=True)
class TableColumn:
    """One column that tells something of a motion.

    Attributes
    ----------
    quantity : str
        'time', or a key of `WORDS`.
    joint : str
        Empty for the time.
    factor : float
        That makes SI units of the values.
    unit : str
        As the name states it; empty if it doesn't.
    """

    quantity: str
    joint: str
    factor: float = 1.0
    unit: str = ''


def table_column(name: str, joint_names: Sequence[str]) -> TableColumn | None:
    """Return what a column is, None if it is something else.

    Known are `q_elbow`, `elbow.position`, `q1` and `q[0]` (of the first joint), each with a unit
    behind it or not, as `q1 [deg]`, and each behind a path, as `/joint_states/elbow/position`.

    Parameters
    ----------
    name : str
        As the first line has it.
    joint_names : sequence of str
        The arm's joints, from base to tool: what numbers stand for.

    Raises
    ------
    IdentificationError
        If it states a unit that is not known.
    """
    stated = _UNIT.search(name)
    if stated is None or stated[1].strip().isdigit():
        bare, unit = name, ''
    else:
        bare, unit = name[: stated.start()], stated[1].strip()
    if bare.lower() in TIME:
        return TableColumn('time', '', _factor(name, 'time', unit), unit)
    for shorter in _without_path(bare):
        found = _of_joint(shorter, joint_names)
        if found is not None:
            quantity, joint = found
            return TableColumn(quantity, joint, _factor(name, quantity, unit), unit)
    return None


def _factor(name: str, quantity: str, unit: str) -> float:
    known = _UNITS[quantity]
    short = unit.lower()
    for spelling, usual in _SPELLINGS:
        short = re.sub(spelling, usual, short)
    if short and short not in known:
        raise IdentificationError(
            f'column {name}: unit {unit} is not known: give one of {", ".join(known)}'
        )
    return known.get(short, 1.0)


def _without_path(name: str) -> Iterator[str]:
    """Yield what may be meant: of a name that begins as a topic does, its end."""
    parts = name.split('/')
    if name.startswith('/'):
        yield parts[-1]
        yield '/'.join(parts[-2:])
    else:
        yield name


def _of_joint(name: str, joint_names: Sequence[str]) -> tuple[str, str] | None:
    """Return quantity and joint."""
    for quantity, words in WORDS.items():
        for word in words:
            front, back = name[: len(word)].lower(), name[-len(word) :].lower()
            rest = name[len(word) :]
            number = re.fullmatch(r'[_.]?(?:(\d+)|\[(\d+)\])', rest) if front == word else None
            if number:
                # q1 is the first joint; q[0] is so too, as programs count.
                index = int(number[1]) - 1 if number[1] else int(number[2])
                if 0 <= index < len(joint_names):
                    return quantity, joint_names[index]
            elif front == word and rest[:1] and rest[0] in _SEPARATOR:
                return quantity, rest[1:].strip()
            elif back == word and len(name) > len(word) + 1:
                separator = name[-len(word) - 1]
                if separator in _SEPARATOR:
                    return quantity, name[: -len(word) - 1].strip()
    return None
