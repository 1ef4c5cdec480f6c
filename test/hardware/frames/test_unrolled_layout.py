import pytest

from aerarm_ros.hardware.frames.board_messages import BoardCommand, BoardState
from aerarm_ros.hardware.frames.frame_codec import FrameCodec, unrolled_decoder, unrolled_encoder
from aerarm_ros.hardware.frames.frame_profile import load_profile


class Packer:
    """Replacement of a struct that shows its items."""

    def __init__(self, items=()):
        self._items = items

    def pack(self, *items):
        return items

    def unpack(self, payload):
        return self._items


def layout(profile='uomodri_v3'):
    fields = load_profile(profile).command.fields
    return fields, {word: word for word in range(15)}


def entry(name, motor=0):
    return next(f for f in layout()[0] if (f.name, f.motor) == (name, motor))


def packed(**values):
    return unrolled_encoder(*layout(), Packer())(BoardCommand(**values))


def test_counts_stand_where_their_fields_begin():
    velocity, index = entry('velocity', 2), entry('index')
    items = packed(velocity=[0.0, -100.0 * velocity.si_per_count], index=70001)
    assert items[velocity.word] == -100
    assert items[index.word] == 70001 & 0xFFFF


def test_a_value_at_either_end_of_its_field_is_packed_and_one_beyond_is_not():
    current = entry('current', 1)
    lowest, highest = current.count_range
    for count in (lowest, highest):
        assert packed(current=[count * current.si_per_count, 0.0])[current.word] == count
    pack = FrameCodec(load_profile()).command._pack
    for count in (lowest - 1, highest + 1):
        assert pack(BoardCommand(current=[count * current.si_per_count, 0.0])) is None


@pytest.mark.parametrize('value', [float('nan'), float('inf'), -float('inf')])
def test_non_finite_values_are_not_packed(value):
    assert packed(current=[0.0, value]) is None


def test_values_that_must_not_be_zero_are_not_packed_as_zero():
    assert packed(timeout=0.0) is None
    assert packed(timeout=entry('timeout').si_per_count) is not None


def test_bits_and_numbers_are_read_into_the_record():
    fields, slots = layout()
    enable, gain = entry('enable_motor', 2), entry('kp', 1)
    items = [0] * 15
    items[enable.word] = 1 << enable.bit
    items[gain.word] |= 7 << gain.bit
    record = BoardCommand(enable_motor=[True, False])
    unrolled_decoder(fields, slots, Packer(items))(record, b'')
    assert record.enable_motor == [False, True]
    assert record.kp[0] == 7 * gain.si_per_count


@pytest.mark.parametrize('profile', ['uomodri_v3', 'laas_power'])
def test_values_in_range_use_the_fast_path(profile, monkeypatch):
    codec = FrameCodec(load_profile(profile))
    for direction in (codec.command, codec.sensor):
        monkeypatch.setattr(direction, '_pack_limited', None)
    codec.encode(BoardCommand(position=[-3.0, 3.0], velocity=[-4.0, 4.0], current=[-1.0, 1.0]))
    codec.encode_state(BoardState(position=[-3.0, 3.0], velocity=[-4.0, 4.0], current=[-1.0, 1.0]))
