"""What a column of a table is, by its name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from aerarm_ros.identification.recording.identification_error import IdentificationError

TIME = ('time', 'times', 't', 'stamp', 'stamps', 'timestamp', 'time_s', '__time')
"""Names of the time."""

WORDS = {
    'position': ('position', 'positions', 'pos', 'q', 'angle', 'actual_q'),
    'velocity': ('velocity', 'velocities', 'vel', 'dq', 'qd', 'qdot', 'actual_qd'),
    'effort': ('effort', 'efforts', 'eff', 'torque', 'torques', 'tau'),
    'current': ('current', 'currents', 'actual_current', 'i'),
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
_NUMBER = re.compile(r'[_.]?(?:(\d+)|[\[(](\d+)[\])])')


@dataclass(frozen=True)
class TableColumn:
    """One column that belongs to a motion.

    Attributes
    ----------
    quantity : str
        'time', or a key of `WORDS`.
    joint : str
        Empty for the time, and for a number until `named` has been called.
    number : int or None
        The joint's number, counted from 0 or 1.
    is_index : bool
        Whether the number is in brackets.
    factor : float
        Factor from the stated unit to SI units.
    unit : str
        As the name states it; empty if it does not.
    """

    quantity: str
    joint: str
    number: int | None = None
    is_index: bool = False
    factor: float = 1.0
    unit: str = ''

    def named(self, joint: str) -> TableColumn:
        """Return the column of the joint that its number means."""
        return replace(self, joint=joint, number=None)


def accepted_names() -> str:
    """Return the accepted names of columns, in words."""
    words = ', '.join(f'{name}: {"/".join(words)}' for name, words in WORDS.items())
    return f"time: {'/'.join(TIME)}, {words}; each followed by _JOINT or the joint's number"


def first_number(numbers: Iterable[int], joints: int) -> int | None:
    """Return whether numbered columns count from 0 or 1; None if the numbers do not show it.

    Parameters
    ----------
    numbers : iterable of int
        Of all columns of a table.
    joints : int
        Number of joints of the arm.
    """
    found = set(numbers)
    if 0 in found:
        return 0 if max(found) < joints else None
    return 1 if 1 in found else None


def table_column(name: str) -> TableColumn | None:
    """Return the meaning of a column, None for an unknown name.

    Known are `q_elbow`, `elbow.position`, `q1`, `q_1` and `q[0]`, each with or without a unit, as
    in `q1 [deg]`, and each with or without a path, as in `/joint_states/elbow/position`.

    Parameters
    ----------
    name : str
        As in the first line.

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
        return TableColumn('time', '', factor=unit_factor(name, 'time', unit), unit=unit)
    for shorter in _without_path(bare):
        found = _of_joint(shorter)
        if found is not None:
            return replace(found, factor=unit_factor(name, found.quantity, unit), unit=unit)
    return None


def unit_factor(name: str, quantity: str, unit: str) -> float:
    """Return the factor from a unit to SI; raises IdentificationError that names the column."""
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


def _of_joint(name: str) -> TableColumn | None:
    """Return quantity and joint, by its name or its number."""
    for quantity, words in WORDS.items():
        for word in words:
            front, back = name[: len(word)].lower(), name[-len(word) :].lower()
            rest = name[len(word) :]
            number = _NUMBER.fullmatch(rest) if front == word else None
            if number:
                return TableColumn(quantity, '', int(number[1] or number[2]), number[1] is None)
            if front == word and rest[:1] and rest[0] in _SEPARATOR:
                return TableColumn(quantity, rest[1:].strip())
            if back == word and len(name) > len(word) + 1:
                separator = name[-len(word) - 1]
                if separator in _SEPARATOR:
                    return TableColumn(quantity, name[: -len(word) - 1].strip())
    return None
