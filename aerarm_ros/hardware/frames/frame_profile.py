"""Frame profile: layout of a board type's SPI frames, read from a YAML file."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from math import pi
from pathlib import Path
from typing import Any

from aerarm_ros.description.arm_config import ENCODERS
from aerarm_ros.description.config_reader import ConfigError, read_plain
from aerarm_ros.description.resources import resource
from aerarm_ros.hardware.frames.board_messages import BoardCommand, BoardState

_KRPM = 1000.0 * 2.0 * pi / 60.0

# Value of each unit that a profile may use, in the SI unit of its quantity.
UNITS: dict[str, float] = {
    '1': 1.0,
    'turn': 2.0 * pi,
    'krpm': _KRPM,
    'A': 1.0,
    'A/turn': 1.0 / (2.0 * pi),
    'A/krpm': 1.0 / _KRPM,
    'A/(turn s)': 1.0 / (2.0 * pi),
    'ms': 1e-3,
    'ohm': 1.0,
    'V': 1.0,
}

# Bits and signedness of the types that fill whole words.
_WHOLE_WORDS: dict[str, tuple[int, bool]] = {
    'u16': (16, False),
    'i16': (16, True),
    'u32': (32, False),
    'i32': (32, True),
}

TYPES = (*_WHOLE_WORDS, 'bits')
OVERFLOW_POLICIES = ('saturate', 'refuse')


class ProfileError(ValueError):
    """Error: a frame profile is invalid; the message names the entry to check."""


@dataclass(frozen=True)
class FrameField:
    """Position and scale of one quantity in a 34-byte SPI frame.

    Attributes
    ----------
    name
        Attribute of `BoardCommand` or `BoardState` that the field carries.
    motor
        1 or 2 for a quantity of one motor, 0 for a quantity of the board.
    word
        First 16-bit word, counted from 0.
    type
        'u16', 'i16', 'u32', 'i32', or 'bits' for `width` bits of a word, lowest at `bit`.
    lsb
        Value of one count [unit].
    unit
        Unit of `lsb`, a key of `UNITS`; values are converted to and from SI units.
    overflow
        'saturate' limits an out-of-range value, 'refuse' raises an error.
    nonzero
        True if 0 counts are dangerous for the board; encoding 0 is then rejected.
    """

    name: str
    word: int
    type: str
    lsb: float = 1.0
    unit: str = '1'
    motor: int = 0
    bit: int = 0
    width: int = 16
    overflow: str = 'saturate'
    nonzero: bool = False

    def __post_init__(self) -> None:
        """Validate the entry; raises ProfileError."""
        where = f'frame field {self.name!r}'
        choices = {'type': TYPES, 'unit': UNITS, 'motor': (0, 1, 2), 'overflow': OVERFLOW_POLICIES}
        for key, allowed in choices.items():
            value = getattr(self, key)
            if value not in allowed:
                raise ProfileError(
                    f'{key} {value!r} of {where} is unknown: choose one of '
                    f'{", ".join(str(one) for one in allowed if one != 0)}, or omit the key'
                )
        if not self.lsb > 0.0:
            raise ProfileError(f'lsb {self.lsb} of {where} must be above 0')
        if self.word < 0:
            raise ProfileError(f'word {self.word} of {where} must not be negative')
        if self.bit and self.type != 'bits':
            raise ProfileError(
                f"bit {self.bit} of {where} needs the type 'bits', not {self.type}: all "
                'other types begin at a word'
            )
        if self.nonzero and self.is_count:
            raise ProfileError(f'nonzero of {where} needs a quantity with a unit or an lsb')
        if self.type == 'bits' and not (0 <= self.bit < self.bit + self.width <= 16):
            raise ProfileError(
                f'bits {self.bit} to {self.bit + self.width - 1} of {where} exceed the '
                '16 bits of a word'
            )

    @property
    def is_bits(self) -> bool:
        """Whether the field is a bit field inside a 16-bit word of the frame."""
        return self.type == 'bits'

    @property
    def words(self) -> int:
        """Number of 16-bit words that the field occupies."""
        return 1 if self.is_bits else _WHOLE_WORDS[self.type][0] // 16

    @property
    def count_range(self) -> tuple[int, int]:
        """Smallest and largest integer count that the field can represent."""
        bits, signed = (self.width, False) if self.is_bits else _WHOLE_WORDS[self.type]
        return (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)

    @property
    def is_count(self) -> bool:
        """Whether the field's value is a plain unsigned integer, such as an index or a flag."""
        return self.unit == '1' and self.lsb == 1.0 and self.count_range[0] == 0

    @property
    def is_flag(self) -> bool:
        """Whether the frame field is a single bit."""
        return self.is_bits and self.width == 1

    @property
    def si_per_count(self) -> float:
        """SI value of one count of the field."""
        return self.lsb * UNITS[self.unit]

    @property
    def label(self) -> str:
        """Name of the field with its motor number, for error messages."""
        return f'{self.name} of motor {self.motor}' if self.motor else self.name


PAYLOAD_WORDS = 15
FRAME_BYTES = 2 * PAYLOAD_WORDS + 4
CRC_ORDERS = ('high_first', 'low_first')

_MOST_EXTENDED = 8  # largest number of profiles in a chain of `extends`
_POWER_OF_TWO = re.compile(r'2\^(-?\d{1,3})')
_FIELD_KEYS = frozenset(item.name for item in fields(FrameField))


@dataclass(frozen=True)
class FrameLayout:
    """Layout of the frames of one direction: fields, and order of the two CRC words."""

    fields: tuple[FrameField, ...]
    crc_words: str

    def __post_init__(self) -> None:
        """Check that the fields fit into the frame without overlap; raise ProfileError if not."""
        if self.crc_words not in CRC_ORDERS:
            raise ProfileError(f'crc_words is {self.crc_words!r}: choose one of {CRC_ORDERS}')
        owners: dict[int, FrameField] = {}
        for entry in self.fields:
            for bit in _bits(entry):
                if bit >= 16 * PAYLOAD_WORDS:
                    raise ProfileError(
                        f'word {entry.word} of {entry.label} is beyond the '
                        f'{PAYLOAD_WORDS} payload words'
                    )
                if bit in owners:
                    raise ProfileError(f'{entry.label} and {owners[bit].label} use the same bits')
                owners[bit] = entry

    def has(self, name: str) -> bool:
        """Return whether the frame carries the quantity `name`."""
        return any(entry.name == name for entry in self.fields)

    def largest(self, name: str) -> float:
        """Return a quantity's largest SI value in a frame, 0 if the frame has no such field."""
        sizes = [e.count_range[1] * e.si_per_count for e in self.fields if e.name == name]
        return min(sizes, default=0.0)

    def count_of(self, name: str) -> float:
        """Return the SI value of one count of a quantity, 0 if the frame has no such field."""
        return max((e.si_per_count for e in self.fields if e.name == name), default=0.0)


@dataclass(frozen=True)
class FrameProfile:
    """Frame profile: frame layouts and error codes of a board type.

    Attributes
    ----------
    command, sensor
        Layouts from host to board and from board to host.
    errors
        Meaning of each error code, and what to check.
    errors_until_power_cycle
        Whether the board keeps an error until its supply is switched off and on.
    encoders
        'incremental' or 'absolute', for boards whose configuration does not specify it.
    """

    name: str
    command: FrameLayout
    sensor: FrameLayout
    errors: Mapping[int, tuple[str, str]]
    errors_until_power_cycle: bool
    encoders: str = 'incremental'

    def __post_init__(self) -> None:
        """Validate the encoder type; raises ProfileError."""
        if self.encoders not in ENCODERS:
            raise ProfileError(f'encoders is {self.encoders!r}: choose one of {ENCODERS}')

    def error_text(self, code: int) -> str:
        """Return a text with the meaning of a board's error code and what to check."""
        name, advice = self.errors.get(code, ('unknown', 'see the list of errors of the firmware'))
        text = f'error {code} ({name}): {advice}'
        return f'{text}; then power-cycle it' if self.errors_until_power_cycle else text


def load_profile(name_or_path: str | Path = 'uomodri_v3') -> FrameProfile:
    """Read a frame profile, given by a file path or its name in `config/profiles/`.

    Raises
    ------
    ProfileError
        If the file is missing or a field is invalid; the text names the field.
    """
    document = _read(name_or_path)
    try:
        return FrameProfile(
            name=str(document['name']),
            command=_layout(document['command'], BoardCommand),
            sensor=_layout(document['sensor'], BoardState),
            errors={
                int(code): (str(entry['name']), str(entry['advice']))
                for code, entry in document.get('errors', {}).items()
            },
            errors_until_power_cycle=bool(document['errors_until_power_cycle']),
            encoders=document.get('encoders', 'incremental'),
        )
    except ProfileError as error:
        raise ProfileError(f'frame profile {name_or_path}: {error}') from None
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ProfileError(
            f'frame profile {name_or_path} is invalid ({error!r}): compare with '
            'config/profiles/uomodri_v3.yaml'
        ) from None


def _read(name_or_path: str | Path, depth: int = 0) -> dict[str, Any]:
    """Return the content of a profile file, merged with the profile named in its key 'extends'."""
    if depth > _MOST_EXTENDED:
        raise ProfileError(
            f"frame profile {name_or_path} extends itself, or the chain of 'extends' is too long"
        )
    path = Path(name_or_path)
    try:
        is_file = path.suffix in ('.yaml', '.yml')
        document = read_plain(path) if is_file else _packaged(f'{name_or_path}.yaml')
    except (OSError, ConfigError) as error:
        raise ProfileError(
            f'frame profile {name_or_path} cannot be read ({error}): check the name or path'
        ) from None
    if not isinstance(document, dict):
        raise ProfileError(f'frame profile {path} must be a mapping with name, command and sensor')
    document = dict(document)
    base_name = document.pop('extends', None)
    if base_name is None:
        return document
    if base_name == document.get('name'):
        raise ProfileError(f'frame profile {path} extends itself')
    base = _read(str(base_name), depth + 1)
    try:
        return _extended(base, document)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ProfileError(
            f'frame profile {path} is invalid ({error!r}): check its fields'
        ) from None


@cache
def _packaged(file: str) -> Any:
    """Return the content of a packaged profile file, which is read once per process."""
    return read_plain(resource('config', 'profiles', file))


def _extended(base: dict[str, Any], document: dict[str, Any]) -> dict[str, Any]:
    """Return the profile `base` with the fields of `document`, which replace overlapping ones."""
    merged = {**base, **document}
    merged['errors'] = {**base.get('errors', {}), **document.get('errors', {})}
    for direction in ('command', 'sensor'):
        own = document.get(direction, {})
        taken = {bit for entry in own.get('fields', ()) for bit in _bits(_field(entry))}
        kept = [
            entry
            for entry in base[direction]['fields']
            if not taken.intersection(_bits(_field(entry)))
        ]
        merged[direction] = {**base[direction], **own, 'fields': [*kept, *own.get('fields', ())]}
    return merged


def _layout(document: Mapping[str, Any], record: type) -> FrameLayout:
    blank = record()
    known = {item.name: getattr(blank, item.name) for item in fields(record)}
    entries = tuple(_field(entry) for entry in document['fields'])
    for entry in entries:
        if entry.name not in known:
            raise ProfileError(f'{record.__name__} has no field {entry.name!r}: check the name')
        value = known[entry.name]
        if isinstance(value, list) != bool(entry.motor):
            whose = 'each motor, 1 or 2' if isinstance(value, list) else 'the whole board'
            raise ProfileError(f"{entry.name} belongs to {whose}: check its key 'motor'")
        if entry.is_count and isinstance(value[0] if entry.motor else value, float):
            raise ProfileError(f'{entry.name} is a physical quantity: set its unit and lsb')
    return FrameLayout(entries, document['crc_words'])


def _field(entry: Mapping[str, Any]) -> FrameField:
    unknown = set(entry) - _FIELD_KEYS
    if unknown:
        raise ProfileError(
            f'field {entry.get("name")!r} has the unknown keys {sorted(unknown)}: remove them'
        )
    values = dict(entry)
    power = _POWER_OF_TWO.fullmatch(str(values.get('lsb', '')))
    if power:
        values['lsb'] = 2.0 ** int(power[1])
    if 'unit' in values:
        values['unit'] = str(values['unit'])
    return FrameField(**values)


def _bits(entry: FrameField) -> range:
    """Return the numbers of the bits that a field occupies, from the start of the frame."""
    first = 16 * entry.word
    if entry.is_bits:
        return range(first + entry.bit, first + entry.bit + entry.width)
    return range(first, first + 16 * entry.words)
