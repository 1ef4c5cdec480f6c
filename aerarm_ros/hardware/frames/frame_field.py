"""One logical field of a board's frame."""

from dataclasses import dataclass
from math import pi

_KRPM = 1000.0 * 2.0 * pi / 60.0

# SI value of one of each unit that a profile may name.
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
    """A frame profile that cannot be used; the text says which entry to check."""


@dataclass(frozen=True)
class FrameField:
    """Where one quantity travels in a frame, and in which scale.

    Attributes
    ----------
    name
        Attribute of `BoardCommand` or `BoardState` that the field carries.
    motor
        1 or 2 for a quantity of one motor, 0 for one of the whole board.
    word
        First 16-bit word, counted from 0.
    type
        'u16', 'i16', 'u32', 'i32', or 'bits' for `width` bits of a word, lowest at `bit`.
    lsb
        Value of one count [unit].
    unit
        A key of `UNITS`; values leave and enter in SI.
    overflow
        'saturate' holds a value that is too large at the end of the range, 'refuse' raises.
    nonzero
        True if the board takes 0 counts for something dangerous: encoding 0 is refused.
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
        """Check the entry; raises ProfileError."""
        where = f'frame field {self.name!r}'
        if self.type not in TYPES:
            raise ProfileError(f'{where}: type {self.type!r} is none of {", ".join(TYPES)}')
        if self.unit not in UNITS:
            raise ProfileError(f'{where}: unit {self.unit!r} is none of {", ".join(UNITS)}')
        if self.motor not in (0, 1, 2):
            raise ProfileError(f'{where}: motor is {self.motor}, must be 1, 2, or absent')
        if self.overflow not in OVERFLOW_POLICIES:
            raise ProfileError(
                f'{where}: overflow {self.overflow!r} is none of {", ".join(OVERFLOW_POLICIES)}'
            )
        if not self.lsb > 0.0:
            raise ProfileError(f'{where}: lsb is {self.lsb}, must be above 0')
        if self.word < 0:
            raise ProfileError(f'{where}: word is {self.word}, must not be negative')
        if self.bit and self.type != 'bits':
            raise ProfileError(
                f'{where}: bit {self.bit} of {self.type}: only bits begin within words'
            )
        if self.nonzero and self.is_count:
            raise ProfileError(f'{where}: nonzero is for quantities that have a unit or an lsb')
        if self.type == 'bits' and not (0 <= self.bit < self.bit + self.width <= 16):
            raise ProfileError(
                f'{where}: bits {self.bit} to {self.bit + self.width - 1} leave the 16 of a word'
            )

    @property
    def is_bits(self) -> bool:
        """True if the field is a part of a word."""
        return self.type == 'bits'

    @property
    def words(self) -> int:
        """Number of words the field touches."""
        return 1 if self.is_bits else _WHOLE_WORDS[self.type][0] // 16

    @property
    def count_range(self) -> tuple[int, int]:
        """Smallest and largest count that the field can hold."""
        bits, signed = (self.width, False) if self.is_bits else _WHOLE_WORDS[self.type]
        return (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)

    @property
    def is_count(self) -> bool:
        """True if the value is a plain unsigned integer, such as an index or a flag."""
        return self.unit == '1' and self.lsb == 1.0 and self.count_range[0] == 0

    @property
    def is_flag(self) -> bool:
        """True if the field is a single bit."""
        return self.is_bits and self.width == 1

    @property
    def si_per_count(self) -> float:
        """SI value of one count."""
        return self.lsb * UNITS[self.unit]

    @property
    def label(self) -> str:
        """The field's name with its motor, for error texts."""
        return f'{self.name} of motor {self.motor}' if self.motor else self.name
