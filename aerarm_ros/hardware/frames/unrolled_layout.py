"""A frame's layout as straight-line Python: no loop over fields in a loop of 1 kHz."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from struct import Struct
from typing import Any

from aerarm_ros.hardware.frames.board_command import BoardCommand
from aerarm_ros.hardware.frames.board_state import BoardState
from aerarm_ros.hardware.frames.frame_field import FrameField

Record = BoardCommand | BoardState


def unrolled_encoder(
    fields: Iterable[FrameField], slots: Mapping[int, int], packer: Struct
) -> Callable[[Record], bytes | None]:
    """Return a function that packs a record whose values all fit their fields.

    It returns None where one does not, where one is no number, or is 0 and may not be: then it is
    to be found out which one.

    Parameters
    ----------
    fields
        The layout.
    slots
        Item of the struct that starts at each word.
    packer
        The payload's struct.
    """
    lines, checks = ['def encode(record):'], []
    known: dict[str, object] = {'pack': packer.pack}
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
            checks.append(f'{1 if field.nonzero else lowest} <= c{index} <= {highest}')
            count = f'{count} {shift}' if field.bit else count
        parts[slots[field.word]].append(count)
    lines += [' except (ValueError, OverflowError):', '  return None']
    lines += [f' if not ({" and ".join(checks)}):', '  return None'] if checks else []
    items = ', '.join(' | '.join(counts) or '0' for counts in parts.values())
    lines.append(f' return pack({items})')
    return _made('encode', lines, known)


def unrolled_decoder(
    fields: Iterable[FrameField], slots: Mapping[int, int], packer: Struct
) -> Callable[[Record, bytes], None]:
    """Return a function that writes a payload's values into a record; parameters as above."""
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
    """Return lines that look the records' lists up, once each."""
    names = dict.fromkeys(field.name for field in fields if field.motor)
    return [f' {name} = {record}.{name}' for name in names]


def _value(field: FrameField) -> str:
    """Return where a field's value is in a record."""
    return f'{field.name}[{field.motor - 1}]' if field.motor else f'record.{field.name}'


def _made(name: str, lines: list[str], known: Mapping[str, object]) -> Callable[..., Any]:
    """Return the function of that name whose source the lines are; it knows some names."""
    # Of a profile's text nothing is in the source but names of the records' attributes, which
    # `load_profile` has compared with them, and whole numbers.
    scope: dict[str, Any] = dict(known)
    exec('\n'.join(lines), scope)  # noqa: S102
    made: Callable[..., Any] = scope[name]
    return made
