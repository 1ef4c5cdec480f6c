"""Encoding and decoding of SPI frames, as records `BoardCommand` and `BoardState`."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping
from struct import Struct
from typing import Any, Generic, TypeVar

from aerarm_ros.hardware.frames.board_messages import BoardCommand, BoardState, crc32_mpeg2
from aerarm_ros.hardware.frames.frame_profile import (
    FRAME_BYTES,
    PAYLOAD_WORDS,
    FrameField,
    FrameLayout,
    FrameProfile,
)

Record = BoardCommand | BoardState


def unrolled_encoder(
    fields: Iterable[FrameField], slots: Mapping[int, int], packer: Struct
) -> Callable[[Record], bytes | None]:
    """Generate a function that encodes a record as payload if all values fit their fields.

    The function returns None if a value does not fit, is not a number, or is a forbidden 0; the
    caller then finds the faulty value.

    Parameters
    ----------
    fields
        Fields of the frame layout.
    slots
        Index of the struct item that starts at each word.
    packer
        Struct of the payload.
    """
    lines, checks = ['def encode(record):'], []
    known: dict[str, object] = {'pack': packer.pack, 'error': struct.error}
    parts: dict[int, list[str]] = {slot: [] for slot in sorted(set(slots.values()))}
    lines += _lists('record', fields)
    lines.append(' try:')
    for index, field in enumerate(fields):
        shift, highest = f'<< {field.bit}', field.count_range[1]
        if field.is_count:
            count = f'(({_value(field)}) {shift} & {highest << field.bit})'
        else:
            count, lowest = f'c{index}', field.count_range[0]
            known[f'k{index}'] = 1.0 / field.si_per_count
            lines.append(f'  c{index} = round({_value(field)} * k{index})')
            # `pack` itself rejects a count that does not fit into whole words.
            if field.is_bits:
                checks.append(f'{1 if field.nonzero else lowest} <= c{index} <= {highest}')
            elif field.nonzero:
                checks.append(f'c{index} > 0')
            count = f'{count} {shift}' if field.bit else count
        parts[slots[field.word]].append(count)
    lines += [f'  if not ({" and ".join(checks)}):', '   return None'] if checks else []
    items = ', '.join(' | '.join(counts) or '0' for counts in parts.values())
    lines += [
        f'  return pack({items})',
        ' except (ValueError, OverflowError, error):',
        '  return None',
    ]
    return _made('encode', lines, known)


def unrolled_decoder(
    fields: Iterable[FrameField], slots: Mapping[int, int], packer: Struct
) -> Callable[[Record, bytes], None]:
    """Generate a function that decodes a payload into a record."""
    used = sorted({slots[field.word] for field in fields})
    names = [f'i{slot}' if slot in used else '_' for slot in sorted(set(slots.values()))]
    lines = ['def fill(record, payload):', f' {", ".join(names)}, = unpack(payload)']
    known: dict[str, object] = {'unpack': packer.unpack}
    lines += _lists('record', fields)
    for index, field in enumerate(fields):
        item = f'i{slots[field.word]}'
        if field.is_flag:
            value = f'{item} & {1 << field.bit} != 0'
        else:
            value = f'({item} >> {field.bit} & {field.count_range[1]})' if field.is_bits else item
            known[f'k{index}'] = field.si_per_count
            value += '' if field.is_count else f' * k{index}'
        lines.append(f' {_value(field)} = {value}')
    return _made('fill', lines, known)


def _lists(record: str, fields: Iterable[FrameField]) -> list[str]:
    """Return source lines that assign each list attribute of the record to a local variable."""
    names = dict.fromkeys(field.name for field in fields if field.motor)
    return [f' {name} = {record}.{name}' for name in names]


def _value(field: FrameField) -> str:
    """Return the source expression for the record's value that a field carries."""
    return f'{field.name}[{field.motor - 1}]' if field.motor else f'record.{field.name}'


def _made(name: str, lines: list[str], known: Mapping[str, object]) -> Callable[..., Any]:
    """Compile source lines; return their function `name`, which has the globals `known`."""
    # From the text of a frame profile, the source contains only integers and attribute names of
    # the records; `load_profile` has checked both.
    scope: dict[str, Any] = dict(known)
    exec('\n'.join(lines), scope)  # noqa: S102
    made: Callable[..., Any] = scope[name]
    return made


_CODES = {'u16': 'H', 'i16': 'h', 'u32': 'I', 'i32': 'i', 'bits': 'H'}
_PAYLOAD_BYTES = 2 * PAYLOAD_WORDS


class FrameError(ValueError):
    """Error: a frame cannot represent a value of the record; the message names the value."""


_Kind = TypeVar('_Kind', BoardCommand, BoardState)


class FrameCodec:
    """Encoder and decoder for the frames of a profile, used by host and emulated boards.

    Encoding limits a value that its field cannot represent, unless a limited value is dangerous. A
    position out of range, a non-finite value, and a time-out or current saturation of zero or less
    raise FrameError. Decoding never raises an exception; it returns None if length or CRC are
    wrong. A decoder fills and returns the record given as second argument, which an invalid frame
    leaves unchanged, or else a new record.

    Attributes
    ----------
    encode, decode_command
        Functions from a command to its frame (34 bytes), and back, as a board does.
    decode, encode_state
        Functions from a sensor frame to the board state, and back, as an emulated board does.
    """

    def __init__(self, profile: FrameProfile) -> None:
        self.command = _LayoutCodec(profile.command, BoardCommand)
        self.sensor = _LayoutCodec(profile.sensor, BoardState)
        self.encode, self.decode_command = self.command.encode, self.command.decode
        self.decode, self.encode_state = self.sensor.decode, self.sensor.encode


class _LayoutCodec(Generic[_Kind]):
    """Encoder and decoder for the frames of one direction: commands or sensor frames."""

    def __init__(self, layout: FrameLayout, kind: type[_Kind]) -> None:
        self._kind: type[_Kind] = kind
        self._crc = _swapped_crc if layout.crc_words == 'low_first' else crc32_mpeg2
        self._struct, self._slots = _struct_of(layout)
        self._fields = layout.fields
        self._pack = unrolled_encoder(layout.fields, self._slots, self._struct)
        self._fill = unrolled_decoder(layout.fields, self._slots, self._struct)

    def encode(self, record: _Kind) -> bytes:
        """Encode a record as frame; raise FrameError if a value does not fit."""
        payload = self._pack(record) or self._pack_limited(record)
        return payload + self._crc(payload)

    def decode(self, frame: bytes, into: _Kind | None = None) -> _Kind | None:
        """Decode the record of a frame, see `FrameCodec`."""
        payload = frame[:_PAYLOAD_BYTES]
        if len(frame) != FRAME_BYTES or frame[_PAYLOAD_BYTES:] != self._crc(payload):
            return None
        record = self._kind() if into is None else into
        self._fill(record, payload)
        return record

    def _pack_limited(self, record: Record) -> bytes:
        """Encode a record as payload, with values limited to the ranges of their fields."""
        items = [0] * len(self._slots)
        for entry in self._fields:
            value = getattr(record, entry.name)
            if entry.motor:
                value = value[entry.motor - 1]
            lowest, highest = entry.count_range
            if entry.is_count:
                count = value & highest
            else:
                try:
                    count = round(value * (1.0 / entry.si_per_count))
                except (ValueError, OverflowError):
                    raise FrameError(
                        f'{entry.label} is {value}, but a frame can only carry finite numbers'
                    ) from None
                if not lowest <= count <= highest or (count <= 0 and entry.nonzero):
                    count = _limited(count, value, entry)
            items[self._slots[entry.word]] |= count << entry.bit
        return self._struct.pack(*items)


def _swapped_crc(payload: bytes) -> bytes:
    """Return the CRC of a payload, with the two words of the CRC in reverse order."""
    crc = crc32_mpeg2(payload)
    return crc[2:] + crc[:2]


def _struct_of(layout: FrameLayout) -> tuple[Struct, dict[int, int]]:
    """Return the payload's struct, and per 16-bit word the index of the item that begins there."""
    whole = {entry.word: entry for entry in layout.fields if not entry.is_bits}
    codes: list[str] = []
    slots: dict[int, int] = {}
    word = 0
    while word < PAYLOAD_WORDS:
        slots[word] = len(codes)
        entry = whole.get(word)
        codes.append(_CODES[entry.type] if entry else 'H')
        word += entry.words if entry else 1
    return Struct('>' + ''.join(codes)), slots


def _limited(count: int, value: float, entry: FrameField) -> int:
    """Return a count limited to its field's range; raise FrameError where that is dangerous."""
    lowest, highest = entry.count_range
    if entry.nonzero and count <= 0:
        raise FrameError(
            f'{entry.label} is {value:g}, which the frame rounds to 0 and the board reads as "no '
            f'limit": set {entry.si_per_count:g} or more'
        )
    if entry.overflow == 'refuse':
        raise FrameError(
            f'{entry.label} is {value:g}, outside the range +-{highest * entry.si_per_count:g} '
            'of the frame: check the reference and the zero of the encoder'
        )
    return highest if count > highest else lowest
